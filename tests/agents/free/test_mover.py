"""One module: what it takes for the outcome of its attempt, and what it does when fenced off."""

from dataclasses import replace
from math import inf

from cubepath.agents.free.mover import Mover
from cubepath.agents.free.sensing import Sensing
from cubepath.agents.local.observation import View
from cubepath.agents.rules.rule import FreeRule
from cubepath.agents.rules.uniform import RANDOM
from cubepath.protocol.core.sites import Site
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.free_messages import (
    Attempt,
    Decision,
    Entered,
    EnterRequest,
    Occupant,
    PlaceState,
    TileUpdate,
)
from cubepath.protocol.wire.keys import Tiles

SCENE = scene_from_spec("agv:graph=S3,n=1")
SITE = SCENE.start[0]
TILES = Tiles(SCENE.system, 1)


def _pending(epoch: int) -> tuple[Mover, Sensing, Attempt]:
    """Return a module of an epoch that has just sent its first attempt."""
    rule = replace(RANDOM, free=FreeRule("it relies on nothing"))
    mover = Mover(SCENE, TILES, rule, 0, incarnation=epoch, seed=1)
    sensing = Sensing(SCENE.system, TILES)
    (tile,) = mover.needs
    sensing.need([tile], 0.0)
    sensing.take(TileUpdate(0, tile, 0, [PlaceState(SITE, 0, SITE, 0)], whole=True), 0.0)
    assert mover.step(0.0, sensing) == [(0, EnterRequest(0, epoch))]
    mover.entered(Entered(epoch, SITE, Occupant(0, epoch, epoch, 0, [], 0)), 0.0)
    for now in range(100):
        for _, asked in mover.step(float(now), sensing):
            assert isinstance(asked, Attempt)
            return mover, sensing, asked
    raise AssertionError("it chose to stay")


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
    free = FreeRule("it relies on nothing", lambda _: choose, lambda _: 2)
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
