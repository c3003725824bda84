"""What a process knows of tiles: gaps, whole tiles, what is older, and what nobody needs."""

from itertools import pairwise

from cubepath.agents.free.sensing import KEEP_S, LOOK_S, LOOK_S_MAX, NOTHING, Place, Sensing
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.free_messages import PlaceState, TileUpdate
from exploration.keeper_world import Dealt

SCENE = scene_from_spec("agv:graph=S3,n=1")
TILES = Dealt(SCENE.system, {0: 0, 1: 0, 2: 0, 3: 0})


def _sensing() -> Sensing:
    sensing = Sensing(SCENE.system, TILES)
    sensing.need(["0"], 0.0)
    return sensing


def _shows(serial: int, *parts: PlaceState, whole: bool = False) -> TileUpdate:
    return TileUpdate(0, "0", serial, [*parts], whole=whole)


def test_a_tile_is_seen_when_all_of_it_was_shown() -> None:
    """A change alone is known, but not whether there is more; of other tiles nothing is known."""
    sensing = _sensing()
    assert sensing.take(_shows(1, PlaceState(0, 1, 0, 7)), 0.0) == ([0], False)
    assert sensing.place(0) == Place(1, 0, 7)
    assert not sensing.sees([0])
    assert sensing.take(_shows(1, PlaceState(0, 1, 0, 7), whole=True), 0.0) == ([], True)
    assert sensing.sees([0])
    assert not sensing.sees([0, 1])
    assert sensing.place(1) == NOTHING
    assert sensing.take(_shows(1, whole=True), 0.0) == ([], False), "known before"


def test_only_what_is_newer_is_taken() -> None:
    """By the version of the place, then by that of the module, then by how often it was read."""
    newer = [
        PlaceState(0, 1),
        PlaceState(0, 1, 0, 7, [], 1),
        PlaceState(0, 1, 0, 7, [5], 2),
        PlaceState(0, 1, 0, 7, [5], 2, [(0, 1, 1)]),
        PlaceState(0, 2),
        PlaceState(0, 3, 0, 8, [], 1),
    ]
    sensing = _sensing()
    for at, shown in enumerate(newer):
        sensing = _sensing()
        assert sensing.know([shown]) == [0]
        known = sensing.place(0)
        for older in newer[: at + 1]:
            assert sensing.know([older]) == []
            assert sensing.place(0) == known
        for later in newer[at + 1 : at + 2]:
            assert sensing.know([later]) == [0]
    assert sensing.place(0) == Place(3, 0, 8, (), 1)


def test_a_gap_is_noticed_and_looked_at() -> None:
    """At once, from what was known last; what comes in order is not."""
    sensing = _sensing()
    assert sensing.due(0.0) == [("0", -1)]
    sensing.take(_shows(3, whole=True), 0.0)
    sensing.take(_shows(4, PlaceState(0, 1)), 1.0)
    assert sensing.next_s == 1.0 + LOOK_S_MAX
    assert sensing.due(2.0) == []
    assert sensing.take(_shows(6, PlaceState(0, 3)), 2.0) == ([0], False)
    assert sensing.due(2.0) == [("0", 4)]
    assert sensing.next_s == 2.0 + LOOK_S
    sensing.take(_shows(6, PlaceState(0, 3), whole=True), 2.1)
    assert sensing.next_s == 2.1 + LOOK_S_MAX
    assert sensing.due(2.1 + LOOK_S_MAX) == [("0", 6)]


def test_what_is_shown_late_closes_no_gap() -> None:
    """Neither a whole tile of before, nor the same change again."""
    sensing = _sensing()
    sensing.take(_shows(5, whole=True), 0.0)
    sensing.take(_shows(3, whole=True), 1.0)
    sensing.take(_shows(5), 1.0)
    assert sensing.due(LOOK_S_MAX) == [("0", 5)]


def test_a_tile_that_is_not_shown_is_looked_at_ever_more_rarely() -> None:
    """From the time on when it is needed first."""
    sensing = Sensing(SCENE.system, TILES)
    assert sensing.next_s == float("inf")
    sensing.need(["0"], 1.0)
    times: list[float] = []
    while len(times) < 8:
        times.append(sensing.next_s)
        assert sensing.due(sensing.next_s) == [("0", -1)]
    gaps = [round(later - one, 6) for one, later in pairwise(times)]
    assert times[0] == 1.0
    assert gaps == [min(LOOK_S * 2**at, LOOK_S_MAX) for at in range(7)]


def test_tiles_are_kept_a_while_after_nobody_needs_them() -> None:
    """Who goes to and fro does not look each time; later nothing of them is taken."""
    sensing = Sensing(SCENE.system, TILES)
    assert sensing.need(["1", "0"], 0.0) == (["0", "1"], [])
    sensing.take(_shows(1, PlaceState(0, 1), whole=True), 0.0)
    assert sensing.need(["1"], KEEP_S) == ([], [])
    assert sensing.sees([0])
    assert sensing.need(["1", "0"], KEEP_S) == ([], [])
    assert sensing.need(["1"], 2 * KEEP_S) == ([], [])
    assert sensing.need(["1"], 2 * KEEP_S + 0.1) == ([], ["0"])
    assert not sensing.sees([0])
    assert sensing.take(_shows(2, PlaceState(0, 2), whole=True), 9.0) == ([], False)
    assert sensing.know([PlaceState(0, 2)]) == []
    assert sensing.place(0) == NOTHING
    assert sensing.need(["0", "1"], 9.0) == (["0"], [])
