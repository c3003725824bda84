"""One module: what it takes for the outcome of its attempt, and what it does when fenced off."""

from dataclasses import replace
from math import inf
from typing import Any

import pytest

from cubepath.agents.free.config import OwnMove
from cubepath.agents.free.mover import (
    AGAIN_S,
    AGAIN_S_MAX,
    REST_S,
    REST_S_MAX,
    RETRY_S,
    RETRY_S_MAX,
    THINK_S,
    Mover,
    Pace,
)
from cubepath.agents.free.sensing import Sensing
from cubepath.agents.local.observation import View, observe
from cubepath.agents.local.random_streams import HESITATE, PACE, stream
from cubepath.agents.rules.rule import Choice, FreeRule, InitialKnowledge, Rule
from cubepath.agents.rules.uniform import RANDOM
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.free_messages import (
    Attempt,
    Commit,
    Decision,
    Entered,
    EnterRequest,
    Occupant,
    PlaceState,
    TileUpdate,
)
from cubepath.protocol.wire.keys import Tiles
from exploration.keeper_world import Dealt

SCENE = scene_from_spec("agv:graph=S3,n=1")
SITE = SCENE.start[0]
TILES = Tiles(SCENE.system, 1)


def _moves_on(view: View) -> int:
    return int(view.mask.nonzero()[0][-1])


def _alone(epoch: int, pace: Pace) -> tuple[Mover, Sensing]:
    """Return a module that has just entered, and moves wherever it can."""
    rule = replace(RANDOM, make=lambda _: _moves_on, free=FreeRule("it relies on nothing"))
    mover = Mover(SCENE, TILES, rule, 0, incarnation=epoch, seed=1, pace=pace)
    sensing = Sensing(SCENE.system, TILES)
    (tile,) = mover.needs
    sensing.need([tile], 0.0)
    sensing.take(TileUpdate(0, tile, 0, [PlaceState(SITE, 0, SITE, 0)], whole=True), 0.0)
    assert mover.step(0.0, sensing) == [(0, EnterRequest(0, epoch))]
    mover.entered(Entered(epoch, SITE, Occupant(0, epoch, epoch, 0, [], 0)), 0.0)
    return mover, sensing


def _pending(epoch: int) -> tuple[Mover, Sensing, Attempt]:
    """Return a module of an epoch that has just sent its first attempt."""
    mover, sensing = _alone(epoch, Pace())
    ((_, asked),) = mover.step(0.0, sensing)
    assert isinstance(asked, Attempt)
    return mover, sensing, asked


def test_what_changes_while_it_thinks_lets_it_choose_again() -> None:
    """It attempts nothing that it knows to be refused, and thinks anew."""
    mover, sensing = _alone(1, Pace(1.0))
    assert mover.step(0.0, sensing) == []
    assert (mover.state, mover.due_s) == ("thinking", THINK_S)
    attempt = mover._attempt
    assert attempt is not None
    (target,) = [unit for unit, _ in attempt.sensed if unit != SITE]
    sensing.know([PlaceState(target, 1, target, 7, [], 1)])
    assert mover.step(THINK_S, sensing) == []
    assert (mover.state, mover.due_s) == ("thinking", 2 * THINK_S)
    ((_, asked),) = mover.step(2 * THINK_S, sensing)
    assert isinstance(asked, Attempt)
    assert target not in dict(asked.sensed)


def test_who_is_halted_while_it_thinks_gives_that_up() -> None:
    """It asks nobody, rests, and chooses anew when it continues."""
    mover, sensing = _alone(1, Pace(1.0))
    mover.step(0.0, sensing)
    mover.halted = True
    assert mover.step(0.0, sensing) == []
    assert mover.rests
    mover.halted = False
    mover.step(2.0, sensing)
    assert mover.state == "thinking"


def test_only_the_decision_of_this_very_attempt_is_its_outcome() -> None:
    """One of another epoch may have the same number, and one of another number comes late."""
    mover, _, attempt = _pending(2)
    assert (attempt.epoch, attempt.number) == (2, 1)
    for epoch, number in ((1, 1), (3, 1), (2, 0), (2, 2)):
        for why in ("no", "fenced off: module_0 is in epoch 2"):
            mover.decided(Decision(0, epoch, number, reason=why), 100.0)
            assert mover.state == "pending"
    mover.decided(Decision(0, 2, 1, reason="no"), 100.0)
    assert mover.state == "resting"


def test_a_register_that_is_no_note_of_the_rule_is_not_heard() -> None:
    """Keepers hold whatever another process has written, so it must not end this one."""
    heard: list[dict[Site, tuple[int, ...]]] = []
    register: list[tuple[int, ...] | None] = []

    def choose(view: View) -> int:
        heard.append(dict(view.notes))
        register.append(view.register)
        return 0

    scene = scene_from_spec("agv:graph=P3,n=3")
    free = FreeRule("it relies on nothing", lambda _: choose, lambda modules: modules - 1)
    mover = Mover(
        scene, Tiles(scene.system, 1), replace(RANDOM, free=free), 1, incarnation=1, seed=1
    )
    sensing = Sensing(scene.system, Tiles(scene.system, 1))
    (tile,) = mover.needs
    sensing.need([tile], 0.0)
    notes = ([7, 8], [1], [1, 2, 3])
    places = [PlaceState(at, 0, at, number, notes[number]) for number, at in enumerate(scene.start)]
    sensing.take(TileUpdate(0, tile, 0, places, whole=True), 0.0)
    mover.entered(Entered(1, scene.start[1], Occupant(1, 1, 1, 0, [1], 0)), 0.0)
    mover.step(0.0, sensing)
    assert heard == [{scene.start[0]: (7, 8)}]
    assert register == [None]


def test_a_module_that_is_fenced_off_says_nothing_more() -> None:
    """Another process has entered for it; two would fence each other off for ever."""
    mover, sensing, attempt = _pending(1)
    mover.decided(
        Decision(0, 1, attempt.number, reason="fenced off: module_0 is in epoch 2"), 100.0
    )
    assert mover.due_s == inf
    mover.dirty = True
    assert mover.step(1e9, sensing) == []
    mover.entered(Entered(1, SITE, Occupant(0, 1, 1, 0, [], 0)), 1e9)
    assert mover.step(2e9, sensing) == []


def test_what_was_shown_before_an_answer_that_came_late_is_known() -> None:
    """A module that entered, and was taken elsewhere before it heard of that, stands there."""
    scene = scene_from_spec("agv:graph=P3,n=1")
    rule = replace(RANDOM, free=FreeRule("it relies on nothing"))
    first, second, third = scene.system.places
    late = Entered(1, first, Occupant(0, 1, 1, 0, [], 0))
    for again in (False, True):
        mover = Mover(scene, Tiles(scene.system, 1), rule, 0, incarnation=1, seed=1)
        mover.taken_to(third, 2)
        mover.taken_to(second, 1)
        mover.entered(late, 0.0)
        assert mover.site == third
        mover.entered(Entered(1, second, Occupant(0, 1, 1, 0, [], 3 if again else 1)), 0.0)
        assert mover.site == (second if again else third)


PATH = scene_from_spec("agv:graph=P3,n=3")
FIRST, SECOND, THIRD = PATH.start
PATH_TILES = Tiles(PATH.system, 1)
AT_ONCE = Pace()


def _entered(
    choose: Any = None, *, alone: bool = True, pace: Pace = AT_ONCE, seed: int = 1, **other: Any
) -> tuple[Mover, Sensing]:
    """Return the module in the middle of a path that has entered, with or without neighbours."""
    rule = replace(RANDOM, free=FreeRule("it relies on nothing", lambda _: choose, lambda _: 1))
    mover = Mover(PATH, PATH_TILES, rule, 1, incarnation=1, seed=seed, pace=pace, **other)
    sensing = Sensing(PATH.system, PATH_TILES)
    (tile,) = mover.needs
    sensing.need([tile], 0.0)
    near = [] if alone else [PlaceState(at, 0, at, n, [n]) for n, at in ((0, FIRST), (2, THIRD))]
    places = [PlaceState(SECOND, 0, SECOND, 1), *near]
    sensing.take(TileUpdate(0, tile, 0, places, whole=True), 0.0)
    mover.entered(Entered(1, SECOND, Occupant(1, 1, 1, 0, [], 0)), 0.0)
    return mover, sensing


def _commit(
    mover: Mover, asked: Attempt, level: int, target: Site = THIRD, version: int = 1
) -> None:
    """Let its attempt be committed."""
    motion = [(1, asked.site, target, version)] if asked.generator is not None else []
    notes: list[tuple[Site, int, int, list[int] | None]] = [
        (asked.site, 1, version, new) for _, _, new in asked.notes if new is not None
    ]
    moved = Commit(
        0, 1, 1, 1, asked.number, 1, level, asked.generator, asked.at, motion=motion, notes=notes
    )
    mover.decided(Decision(1, 1, asked.number, commit=moved), 0.0)
    assert (mover.state, mover.due_s) == ("resting", 0.0)


def _own(target: Site, after: list[tuple[Site, int, int | None]]) -> OwnMove:
    """Return the move of a schedule from the middle of the path."""
    (move,) = [m for m in PATH.system.moves(SECOND) if m is not None and m.target == target]
    return OwnMove(GeneratorPlacement(move.generator, move.at), after)


@pytest.mark.parametrize(
    ("after", "begins"),
    [
        ([], True),
        ([(THIRD, 2, 3)], True),
        ([(THIRD, 2, None)], True),
        ([(THIRD, 1, 3)], False),
        ([(THIRD, 2, 2)], False),
        ([(THIRD, 1, None)], False),
        ([(SECOND, 0, 0), (THIRD, 2, 3)], True),
        ([(SECOND, 0, 1)], False),
    ],
)
def test_a_move_of_a_schedule_waits_for_those_before_it(
    after: list[tuple[Site, int, int | None]], begins: bool
) -> None:
    """Until its units were written, and where it is said read, as often as they are to be."""
    own = _own(THIRD, after)
    mover, sensing = _entered(own=[own])
    sensing.know([PlaceState(THIRD, 2, reads=[(THIRD, 2, 3)])])
    asks = mover.step(0.0, sensing)
    assert len(asks) == begins
    for keeper, asked in asks:
        assert keeper == 0
        assert isinstance(asked, Attempt)
        assert (asked.generator, asked.at) == (own.placed.generator, own.placed.at)
        assert (asked.epoch, asked.number, asked.turn, asked.site) == (1, 1, 1, SECOND)
        assert asked.after == after


def test_a_schedule_ends_after_its_last_move() -> None:
    """Nothing more is attempted, and what does not begin where it stands is not either."""
    mover, sensing = _entered(own=[_own(THIRD, []), _own(FIRST, [])])
    ((_, asked),) = mover.step(0.0, sensing)
    assert isinstance(asked, Attempt)
    _commit(mover, asked, 4)
    sensing.know([PlaceState(SECOND, 1), PlaceState(THIRD, 1, THIRD, 1, [], 1)])
    assert mover.step(9.0, sensing) == []
    mover, sensing = _entered(own=[_own(THIRD, []), _own(FIRST, [])])
    for number, target in enumerate((THIRD, FIRST), 1):
        ((_, asked),) = mover.step(float(number), sensing)
        assert isinstance(asked, Attempt)
        assert target in dict(asked.sensed)
        _commit(mover, asked, 4, SECOND, number)  # it was taken back meanwhile
        sensing.know([PlaceState(SECOND, number, SECOND, 1, [], number)])
    assert mover.step(9.0, sensing) == []
    assert mover.step(99.0, sensing) == []


def _last(view: View) -> Choice:
    return Choice(int(view.mask.nonzero()[0][-1]))


def test_who_stays_again_and_again_rests_longer_and_longer() -> None:
    """Twice as long each time, up to a second, and from the start after an attempt."""
    stays = [True] * 11 + [False] + [True] * 2
    mover, sensing = _entered(lambda view: Choice() if stays.pop(0) else _last(view))
    now_s, rests_s = 7.0, list[float]()
    while stays:
        for _, asked in mover.step(now_s, sensing):
            mover.decided(Decision(1, 1, 1, reason="no"), now_s)
            assert asked.module == 1
        rests_s.append(mover.due_s - now_s)
        now_s = mover.due_s
    expected = [min(REST_S * 2**times, REST_S_MAX) for times in range(11)]
    assert rests_s[:11] == pytest.approx(expected)
    assert rests_s[12:] == pytest.approx([REST_S, 2 * REST_S])


def test_who_is_refused_again_and_again_tries_less_and_less_often() -> None:
    """It draws the time from a range that doubles; no news wake it sooner. A commit ends that."""
    mover, sensing = _entered(_last, seed=5)
    pace, now_s = stream(5, 1, PACE), 5.0
    for number in range(1, 12):
        ((_, asked),) = mover.step(now_s, sensing)
        assert isinstance(asked, Attempt)
        assert asked.number == number
        mover.decided(Decision(1, 1, number, reason="no"), now_s)
        waits_s = min(RETRY_S * 2**number, RETRY_S_MAX) * pace.fraction()
        assert mover.due_s == pytest.approx(now_s + waits_s)
        mover.dirty = True
        assert mover.step(now_s + waits_s / 2, sensing) == []
        now_s = mover.due_s
    ((_, asked),) = mover.step(now_s, sensing)
    assert isinstance(asked, Attempt)
    _commit(mover, asked, 1)
    sensing.know([PlaceState(SECOND, 1), PlaceState(THIRD, 1, THIRD, 1, [], 1)])
    mover.due_s, mover.dirty = now_s + 1, True
    assert len(mover.step(now_s, sensing)) == 1


def test_nothing_more_is_an_outcome_once_it_is_fenced_off() -> None:
    """Not even that very attempt, whose commit a keeper told before it heard of the later epoch."""
    mover, _, attempt = _pending(1)
    for reason in ("fenced off: a later epoch has begun", "no"):
        mover.decided(Decision(0, 1, attempt.number, reason=reason), 0.0)
        assert (mover.state, mover.due_s) == ("superseded", inf)


def test_who_halts_rests_when_its_attempt_is_decided() -> None:
    """It begins nothing, is not woken for a second, and chooses at once when it continues."""
    mover, sensing, attempt = _pending(1)
    mover.halted = True
    assert not mover.rests
    mover.decided(Decision(0, 1, attempt.number, reason="no"), 5.0)
    assert mover.rests
    for now_s in (5.0, 9.0):
        assert mover.step(now_s, sensing) == []
        assert mover.due_s == now_s + REST_S_MAX
    mover.halted = False
    assert not mover.rests


def test_it_asks_every_keeper_for_its_place_until_one_answers() -> None:
    """Less and less often, every four seconds at the least."""
    rule = replace(RANDOM, free=FreeRule("it relies on nothing"))
    mover = Mover(SCENE, Tiles(SCENE.system, 3), rule, 0, incarnation=4, seed=1)
    sensing, now_s = Sensing(SCENE.system, TILES), 0.0
    for times in range(8):
        assert mover.step(now_s, sensing) == [(me, EnterRequest(0, 4)) for me in range(3)]
        assert mover.due_s == now_s + min(AGAIN_S * 2**times, AGAIN_S_MAX)
        assert mover.step(now_s, sensing) == []
        now_s = mover.due_s


def test_it_does_not_take_another_module_for_itself() -> None:
    """One that stood where it is now, and has moved as often as it."""
    mover, sensing = _entered(_last)
    sensing.know([PlaceState(THIRD, 1, THIRD, 2, [], 1)])
    mover.taken_to(THIRD, 1)
    assert mover.step(0.0, sensing) == []
    assert not mover.turns
    sensing.know([PlaceState(THIRD, 3, THIRD, 1, [], 1), PlaceState(SECOND, 1)])
    assert len(mover.step(mover.due_s, sensing)) == 1


def test_what_is_near_are_places() -> None:
    """Nothing is shown of obstacles, so it does not wait for that."""
    scene = scene_from_spec("sliding:n=2")
    system, tiles = scene.system, Tiles(scene.system, 1)
    mover = Mover(scene, tiles, RANDOM, 0, incarnation=1, seed=1)
    place = system.place_of(mover.site)
    around = {place, *system.sensed(place), *system.reach(place)}
    assert around & system.filled
    assert mover.near == around - system.filled - {None}
    assert mover.needs == {tiles.tile_of(each) for each in mover.near}


def test_it_does_not_choose_before_its_own_change_is_shown() -> None:
    """What it wrote into its register counts, too."""
    notes: list[tuple[int, ...] | None] = []

    def choose(view: View) -> Choice:
        notes.append(view.register)
        return Choice(note=(len(notes),))

    mover, sensing = _entered(choose)
    ((_, asked),) = mover.step(0.0, sensing)
    assert isinstance(asked, Attempt)
    assert asked.notes == [(SECOND, [], [1])]
    _commit(mover, asked, 0, version=2)
    assert (mover.site, mover._version) == (SECOND, 2)
    assert mover.step(9.0, sensing) == []
    assert notes == [None]
    sensing.know([PlaceState(SECOND, 0, SECOND, 1, [1], 2)])
    assert len(mover.step(99.0, sensing)) == 1
    assert notes == [None, (1,)]


def test_a_register_that_changes_while_it_thinks_lets_it_choose_again() -> None:
    """As any other thing that it heeds."""
    mover, sensing = _entered(
        lambda view: Choice(note=(7,), heeds=tuple(view.notes)), alone=False, pace=Pace(1.0)
    )
    assert mover.step(0.0, sensing) == []
    ((_, asked),) = mover.step(1.0, sensing)
    assert isinstance(asked, Attempt)
    mover.decided(Decision(1, 1, 1, reason="no"), 1.0)
    assert mover.step(2.0, sensing) == []
    assert mover.state == "thinking"
    sensing.know([PlaceState(FIRST, 0, FIRST, 0, [9], 1)])
    assert mover.step(3.0, sensing) == []
    assert mover.state == "thinking"
    assert [turn.number for turn in mover.turns] == [1, 2, 2]


def _of(spec: str, module: int = 0, choose: Any = _last, **other: Any) -> tuple[Mover, Sensing]:
    """Return a module of a scene that has entered, and senses all at the start."""
    scene = scene_from_spec(spec)
    rule = replace(RANDOM, free=FreeRule("it relies on nothing", lambda _: choose, lambda _: 1))
    tiles = Tiles(scene.system, 1)
    mover = Mover(scene, tiles, rule, module, incarnation=1, seed=1, **other)
    sensing = Sensing(scene.system, tiles)
    sensing.need(mover.needs, 0.0)
    for tile in mover.needs:
        sensing.take(TileUpdate(0, tile, 0, [], whole=True), 0.0)
    start = enumerate(scene.start)
    sensing.know(PlaceState(scene.system.place_of(at), 0, at, n, [n]) for n, at in start)
    mover.entered(Entered(1, scene.start[module], Occupant(module, 1, 1, 0, [], 0)), 0.0)
    return mover, sensing


KINDS = pytest.mark.parametrize(
    ("spec", "module"),
    [("hex:n=4", 0), ("agv-labelled:graph=P3,n=2", 1), ("words:presentation=free2", 1)],
)


@KINDS
def test_a_move_of_a_schedule_is_attempted_as_one_of_a_rule(spec: str, module: int) -> None:
    """With the same sensed; one that begins elsewhere, or is not possible now, is not."""
    mover, sensing = _of(spec, module)
    ((_, chosen),) = mover.step(0.0, sensing)
    assert isinstance(chosen, Attempt)
    assert chosen.generator is not None
    on = {*mover._scene.start} | mover._system.filled
    moves = [each for each in mover._system.moves(mover.site) if each is not None]
    asks = {(each.generator, each.at): each.possible(on) for each in moves}
    asks[chosen.generator, "elsewhere"] = False
    for placed, possible in asks.items():
        mover, sensing = _of(spec, module, own=[OwnMove(GeneratorPlacement(*placed), [])])
        found = mover.step(0.0, sensing)
        assert len(found) == possible
        if placed == (chosen.generator, chosen.at):
            assert found == [(0, chosen)]


@KINDS
def test_it_is_shown_what_it_senses_and_its_goals(spec: str, module: int) -> None:
    """As in a run with rounds, whoever is there."""
    views: list[View] = []

    def choose(view: View) -> Choice:
        views.append(view)
        return Choice()

    mover, sensing = _of(spec, module, choose)
    mover.step(0.0, sensing)
    scene = mover._scene
    expected = observe(
        scene.system,
        mover.site,
        {scene.system.place_of(at): at for at in scene.start},
        goals=frozenset(scene.goals[module] if scene.goals else ()),
    )
    assert views[0].numbers.tolist() == expected["observation"].tolist()
    assert views[0].mask.tolist() == expected["action_mask"].tolist()


def test_its_rule_begins_where_it_enters() -> None:
    """Which may be anywhere; it fails by name, and that is in its turn."""
    starts: list[Site] = []

    def make(knowledge: InitialKnowledge) -> Rule:
        starts.append(knowledge.start)

        def choose(view: View) -> Choice:
            raise InputError("no idea")

        return choose

    rule = replace(RANDOM, free=FreeRule("it relies on nothing", make))
    mover = Mover(PATH, PATH_TILES, rule, 1, incarnation=1, seed=1)
    sensing = Sensing(PATH.system, PATH_TILES)
    sensing.need(mover.needs, 0.0)
    for tile in mover.needs:
        places = [PlaceState(THIRD, 1, THIRD, 1, [], 1)]
        sensing.take(TileUpdate(0, tile, 0, places, whole=True), 0.0)
    mover.entered(Entered(1, THIRD, Occupant(1, 1, 1, 0, [], 1)), 0.0)
    assert mover.step(0.0, sensing) == []
    assert starts == [THIRD]
    (turn,) = mover.turns
    assert (turn.failed or "").startswith("rule 'random', module_1: no idea at test_mover.py:")


def test_what_it_exchanges_is_in_its_turn() -> None:
    """With the note that it writes itself."""
    mover, sensing = _entered(lambda _: Choice(note=(7,), exchanges={FIRST: (8,)}), alone=False)
    mover.step(0.0, sensing)
    (turn,) = mover.turns
    assert (turn.note, turn.exchanges) == ([7], [(FIRST, [8])])


@KINDS
def test_any_unit_that_changes_while_it_thinks_lets_it_choose_again(spec: str, module: int) -> None:
    """Whatever a unit of the system is; if none does, it attempts what it thought of."""
    changes: list[PlaceState | None] = [None]
    for change in changes:
        mover, sensing = _of(spec, module, pace=Pace(1.0))
        system = mover._system
        mover.step(0.0, sensing)
        attempt = mover._attempt
        assert attempt is not None
        if change is None:
            for unit, shown in attempt.sensed:
                place: Site = unit if system.labels else system.place_of(unit)
                other: Site = (place, 0) if system.labels else unit
                if place != system.place_of(mover.site):
                    changes.append(PlaceState(place, 1, None if shown else other, 7))
            assert mover.step(THINK_S, sensing) == [(0, attempt)]
        else:
            sensing.know([change])
            assert mover.step(THINK_S, sensing) == []
            assert mover._attempt is not attempt
    assert len(changes) > 1


def test_who_is_carried_off_while_it_thinks_chooses_again() -> None:
    """Once it has been shown where it is."""
    mover, sensing = _entered(_last, pace=Pace(1.0))
    mover.step(0.0, sensing)
    mover.taken_to(FIRST, 1)
    assert mover.step(THINK_S, sensing) == []
    assert (mover.state, mover.due_s) == ("resting", THINK_S + AGAIN_S)
    sensing.know([PlaceState(SECOND, 1), PlaceState(FIRST, 1, FIRST, 1, [], 1)])
    mover.dirty = True
    mover.step(THINK_S, sensing)
    assert mover.state == "thinking"


def test_its_turn_says_which_versions_it_sensed_and_heard() -> None:
    """Of each place in order, -1 where there is none; registers with the version of the module."""
    mover, sensing = _of("agv:graph=P3,n=3", choose=lambda _: Choice(note=(4,)))
    sensing.know([PlaceState(SECOND, 3, SECOND, 1, [8], 5), PlaceState(THIRD, 2)])
    ((_, asked),) = mover.step(0.0, sensing)
    (turn,) = mover.turns
    assert (turn.sensed, turn.received) == ([3, -1], [(3, 5), (2, 0)])
    assert (turn.module, turn.epoch, turn.turn, turn.action, turn.note) == (0, 1, 1, 0, [4])
    assert isinstance(asked, Attempt)
    assert (asked.epoch, asked.number, asked.turn, asked.site) == (1, 1, 1, FIRST)
    mover, sensing = _of("agv:graph=S4,n=2", 1)
    mover.step(0.0, sensing)
    assert mover.turns[0].sensed == [0, -1, -1, -1]


def test_what_it_relied_on_is_in_its_turn() -> None:
    """Guards and what it heeds, for those who check its choice."""

    def choose(view: View) -> Choice:
        return Choice(int(view.mask.nonzero()[0][-1]), guards=(FIRST,), heeds=(FIRST,))

    mover, sensing = _entered(choose, alone=False)
    sensing.know([PlaceState(THIRD, 1)])
    mover.step(0.0, sensing)
    (turn,) = mover.turns
    assert (turn.guards, turn.heeds) == ([FIRST], [FIRST])
    assert (turn.site, turn.version, turn.number) == (SECOND, 0, 1)


def test_it_chooses_again_when_something_changes_and_not_before() -> None:
    """Or when it has rested, or need no longer halt; its turns are numbered."""
    asked: list[Site] = []

    def stay(view: View) -> Choice:
        asked.append(view.site)
        return Choice()

    mover, sensing = _entered(stay)
    for _ in range(2):
        assert mover.step(0.0, sensing) == []
        assert len(asked) == 1
    mover.dirty = True
    for _ in range(2):
        mover.step(0.0, sensing)
        assert len(asked) == 2
    mover.halted = True
    mover.step(mover.due_s, sensing)
    mover.halted = False
    mover.step(0.0, sensing)
    assert len(asked) == 3
    mover.step(mover.due_s, sensing)
    assert [turn.turn for turn in mover.turns] == [1, 2, 3, 4]


def test_it_thinks_longer_by_its_jitter_and_says_nothing_meanwhile() -> None:
    """By a share that it draws."""
    mover, sensing = _entered(_last, seed=5, pace=Pace(3.0, 0.5))
    longer = 1 + 0.5 * stream(5, 1, PACE).fraction()
    assert mover.step(7.0, sensing) == []
    assert mover.step(7.0 + THINK_S, sensing) == []
    assert mover.due_s == pytest.approx(7.0 + 3 * THINK_S * longer)


def test_it_hesitates_by_a_stream_of_its_own() -> None:
    """That of its seed and its number."""
    mover, sensing = _entered(_last, seed=5, hesitate=0.5)
    doubt = stream(5, 1, HESITATE)
    for expected in (doubt.fraction() < 0.5 for _ in range(20)):
        asks = mover.step(1e9, sensing)
        assert bool(asks) is not expected
        if asks:
            (asked,) = [each for _, each in asks if isinstance(each, Attempt)]
            mover.decided(Decision(1, 1, asked.number, reason="no"), 0.0)
        mover.due_s = 0.0


def test_an_attempt_is_repeated_less_and_less_often() -> None:
    """The same again, until it is decided."""
    mover, sensing, attempt = _pending(1)
    begun_s = mover.due_s - AGAIN_S
    for now, repeats in ((0.0, False), (AGAIN_S, True), (2 * AGAIN_S, False), (3 * AGAIN_S, True)):
        found = mover.step(begun_s + now, sensing)
        assert found == ([(0, attempt)] if repeats else [])
    mover.decided(Decision(0, 1, 7, reason="of another"), 100.0)
    mover.decided(Decision(0, 1, 1, reason="no"), 100.0)
    mover.decided(Decision(0, 1, 1, reason="no"), 100.0)


def test_an_answer_to_another_incarnation_is_none_to_this_one() -> None:
    """It may come late, to a process that was started again."""
    rule = replace(RANDOM, free=FreeRule("it relies on nothing"))
    mover = Mover(SCENE, TILES, rule, 0, incarnation=2, seed=1)
    mover.entered(Entered(1, SITE, Occupant(0, 1, 1, 0, [], 0)), 0.0)
    before = mover.state
    mover.entered(Entered(2, SITE, Occupant(0, 2, 2, 0, [], 0)), 0.0)
    assert (before, mover.state) == ("entering", "resting")


def test_a_schedule_needs_what_is_sensed_and_no_more() -> None:
    """Registers within reach tell it nothing, so they need not be shown."""
    (move,) = [each for each in PATH.system.moves(FIRST) if each is not None]
    own = OwnMove(GeneratorPlacement(move.generator, move.at), [])
    tiles = Dealt(PATH.system, {FIRST: 1, SECOND: 0, THIRD: 0})
    mover = Mover(PATH, tiles, RANDOM, 0, incarnation=1, seed=1, own=[own])
    sensing = Sensing(PATH.system, tiles)
    sensing.need(sorted(mover.needs), 0.0)
    assert THIRD in mover.near
    mover.entered(Entered(1, FIRST, Occupant(0, 1, 1, 0, [], 0)), 0.0)
    for place, parts in ((FIRST, [PlaceState(FIRST, 0, FIRST, 0)]), (SECOND, [])):
        assert mover.step(mover.due_s, sensing) == []
        sensing.take(TileUpdate(0, str(place), 0, parts, whole=True), 0.0)
    ((keeper, asked),) = mover.step(mover.due_s, sensing)
    assert keeper == 0
    assert isinstance(asked, Attempt)
    assert asked.sensed == [(FIRST, FIRST), (SECOND, None)]
