"""A module that comes too late again and again holds what it senses, and lets go of it."""

from dataclasses import replace

from cubepath.agents.free.mover import (
    AGAIN_S_MAX,
    HOLD_TICKS,
    HOLD_TRIES,
    MISSES,
    RETRY_S_MAX,
    THINK_S,
    Ask,
    Mover,
    Pace,
)
from cubepath.agents.free.sensing import Sensing
from cubepath.agents.rules.rule import FreeRule
from cubepath.agents.rules.uniform import RANDOM
from cubepath.protocol.core.sites import Site
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.free_messages import (
    Attempt,
    Commit,
    Decision,
    Entered,
    Held,
    Hold,
    Occupant,
    PlaceState,
    TileUpdate,
)
from exploration.keeper_world import Dealt

SCENE = replace(scene_from_spec("agv:graph=S3,n=1"), start=(0,), goal=None, goals=())
TILES = Dealt(SCENE.system, {0: 1, 1: 0, 2: 2, 3: 2})
"""The module at the hub senses all leaves, of three keepers."""
SITE: Site = 0


AT_ONCE = Pace()
LAST = replace(
    RANDOM,
    make=lambda _: lambda view: int(view.mask.nonzero()[0][-1]),
    free=FreeRule("it relies on nothing"),
)
"""Moves wherever it can."""


class Alone:
    """A module, what is shown to it, and its clock."""

    def __init__(self, pace: Pace = AT_ONCE) -> None:
        self.mover = Mover(SCENE, TILES, LAST, 0, incarnation=1, seed=1, pace=pace)
        self.sensing = Sensing(SCENE.system, TILES)
        self.sensing.need(sorted(self.mover.needs), 0.0)
        for tile in self.mover.needs:
            parts = [PlaceState(SITE, 0, SITE, 0)] if tile == "0" else []
            self.sensing.take(
                TileUpdate(TILES.keeper_of_tile(tile), tile, 0, parts, whole=True), 0.0
            )
        self.now_s = 0.0
        self.mover.entered(Entered(1, SITE, Occupant(0, 1, 1, 0, [], 0)), 0.0)

    def step(self, seconds: float = 0.0) -> list[Ask]:
        self.now_s += seconds
        return self.mover.step(self.now_s, self.sensing)

    def attempt(self) -> Attempt:
        """Return its next attempt."""
        attempt, *_ = [each for _ in range(2) for _, each in self.step(2.0)]
        assert isinstance(attempt, Attempt)
        return attempt

    def refuse(self, attempt: Attempt) -> list[Ask]:
        decision = Decision(0, attempt.epoch, attempt.number, reason="no")
        return self.mover.decided(decision, self.now_s)

    def miss(self) -> None:
        for _ in range(MISSES):
            assert self.refuse(self.attempt()) == []

    def held(self, keeper: int, number: int, epoch: int = 1) -> list[Ask]:
        return self.mover.held(Held(0, epoch, number, []), keeper, self.now_s)

    def hold_all(self) -> None:
        """Let it be refused, and let all be held."""
        self.miss()
        self.step(RETRY_S_MAX)
        for number, keeper in enumerate((0, 1, 2), 1):
            self.held(keeper, number)


def _asked(keeper: int, number: int, *places: int, ticks: int = HOLD_TICKS) -> Ask:
    return keeper, Hold(0, 1, number, [*places], ticks if places else 0)


def test_after_misses_it_asks_one_keeper_after_the_other() -> None:
    """In increasing order, for its place and all that it senses; then it attempts."""
    alone = Alone()
    alone.miss()
    assert alone.step(RETRY_S_MAX) == [_asked(0, 1, 1)]
    assert alone.held(0, 1) == [_asked(1, 2, 0)]
    assert alone.held(1, 2) == [_asked(2, 3, 2, 3)]
    assert alone.held(2, 3) == []
    assert isinstance(alone.attempt(), Attempt)


def test_who_thinks_for_long_has_it_held_for_twice_as_long() -> None:
    """And for a second, by the ticks of the keepers."""
    alone = Alone(Pace(100.0, 0.5))
    for _ in range(MISSES):
        alone.refuse(alone.attempt())
    ((_, hold),) = alone.step(RETRY_S_MAX)
    assert isinstance(hold, Hold)
    assert hold.ticks == HOLD_TICKS + round(2 * 100 * THINK_S * 1.5 / 0.05)


def test_answers_to_other_requests_count_for_nothing() -> None:
    """Of another keeper, epoch or number."""
    alone = Alone()
    alone.miss()
    alone.step(RETRY_S_MAX)
    for keeper, number, epoch in ((1, 1, 1), (0, 2, 1), (0, 1, 2), (0, 0, 1)):
        assert alone.held(keeper, number, epoch) == []
    assert alone.held(0, 1) == [_asked(1, 2, 0)]
    assert alone.held(0, 1) == []


def test_it_asks_again_and_goes_on_without_in_the_end() -> None:
    """A keeper may be dead that its attempt does not concern; what was held is given up."""
    alone = Alone()
    alone.miss()
    alone.step(RETRY_S_MAX)
    alone.held(0, 1)
    found = [ask for _ in range(HOLD_TRIES) for ask in alone.step(AGAIN_S_MAX)]
    again = [_asked(1, 2, 0)] * (MISSES - 1) + [_asked(1, 3, 0)] * MISSES
    assert found == [*again, _asked(0, 4), _asked(1, 5)]
    assert alone.attempt().number == MISSES + 1


def test_what_the_attempt_does_not_concern_is_let_go_with_it() -> None:
    """The keepers of the chain let go when they commit."""
    alone = Alone()
    alone.hold_all()
    (_, attempt), *asks = alone.step(RETRY_S_MAX)
    assert isinstance(attempt, Attempt)
    (target,) = [unit for unit, _ in attempt.sensed if unit != 0]
    chain = {TILES.keeper_of(0), TILES.keeper_of(target)}
    let_go = [keeper for keeper, each in asks if isinstance(each, Hold) and not each.ticks]
    assert let_go == sorted({0, 1, 2} - chain)
    moved = Commit(1, 1, 0, 1, attempt.number, 1, 1, attempt.generator, attempt.at)
    decision = Decision(0, 1, attempt.number, commit=moved)
    assert alone.mover.decided(decision, alone.now_s) == []
    assert alone.mover.held(Held(0, 1, 3, []), 2, alone.now_s) == []


def test_a_refusal_lets_go_of_all_that_is_left() -> None:
    """A keeper beyond the one that refused knows nothing of it."""
    alone = Alone()
    alone.hold_all()
    attempt = alone.attempt()
    asks = alone.refuse(attempt)
    chain = {TILES.keeper_of(unit) for unit, _ in attempt.sensed}
    assert [(keeper, each.ticks) for keeper, each in asks if isinstance(each, Hold)] == [
        (keeper, 0) for keeper in sorted(chain)
    ]
    ((keeper, again),) = alone.step(RETRY_S_MAX)
    assert keeper == 0
    assert isinstance(again, Hold)
    assert again.ticks == HOLD_TICKS


def test_what_changes_while_it_thinks_is_a_miss() -> None:
    """Also while that should have been held: it lets go, and has it held again."""
    alone = Alone(Pace(1.0))
    alone.hold_all()
    assert alone.step() == []
    assert alone.mover.state == "thinking"
    target = _target(alone)
    shown = PlaceState(target, 1, target, 7, [], 1)
    alone.sensing.know([shown])
    asks = alone.step(THINK_S)
    assert [(keeper, each.ticks) for keeper, each in asks if isinstance(each, Hold)] == [
        *((keeper, 0) for keeper in (0, 1, 2)),
        (0, HOLD_TICKS),
    ]


def _target(alone: Alone) -> int:
    attempt = alone.mover._attempt
    assert attempt is not None
    (target,) = [unit for unit, _ in attempt.sensed if unit != 0]
    assert isinstance(target, int)
    return target


def test_who_is_halted_lets_go() -> None:
    """While it waits, and when it would choose."""
    alone = Alone()
    alone.miss()
    alone.step(RETRY_S_MAX)
    alone.held(0, 1)
    alone.mover.halted = True
    assert alone.step() == [_asked(0, 3), _asked(1, 4)]
    assert alone.mover.rests
    alone = Alone()
    alone.hold_all()
    alone.mover.halted = True
    assert alone.step() == [_asked(0, 4), _asked(1, 5), _asked(2, 6)]


def test_who_is_halted_while_it_thinks_gives_that_up() -> None:
    """It asks nobody, rests, and chooses anew when it goes on."""
    alone = Alone(Pace(factor=100.0))
    alone.step(2.0)
    assert alone.mover.state == "thinking"
    alone.mover.halted = True
    assert alone.step() == []
    assert alone.mover.rests
    alone.mover.halted = False
    alone.step(2.0)
    assert alone.mover.state == "thinking"


def test_who_is_taken_along_has_its_new_place_held() -> None:
    """It lets go of what it sensed before."""
    alone = Alone()
    alone.miss()
    alone.step(RETRY_S_MAX)
    assert alone.mover.taken_to(2, 1)
    assert alone.step() == [_asked(0, 2)]


def test_staying_is_no_turn_unless_what_it_senses_was_held() -> None:
    """It may find nothing to do because it came too late."""
    alone = Alone()
    alone.miss()
    alone.mover._misses = MISSES - 1
    for leaf in (1, 2, 3):
        alone.sensing.know([PlaceState(leaf, 1, leaf, 4 + leaf, [], 1)])
    assert alone.step(RETRY_S_MAX) == []
    assert alone.mover._misses == MISSES - 1
