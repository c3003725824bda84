"""Scenes without end: modules that can wander off are found, and they do."""

import pytest

from cubepath.coordinator.theory.search.exact import optimum, wandering
from cubepath.coordinator.theory.search.transitions import Transitions
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles.cells import cell_of


@pytest.mark.parametrize("count", [2, 3, 7, 30])
def test_a_chain_of_hexagons_rolls_on(count: int) -> None:
    """The last one goes to the front, and all stand one further, with no module between."""
    found = wandering(scene_from_spec(f"hex:n={count}"))
    assert found is not None
    assert (set(found.modules), found.by) == ({(x, 0) for x in range(count)}, (1, 0))
    assert found.moves == count + 1


def test_a_pair_rolls_away_from_what_is_not_in_its_way() -> None:
    """Two of four are enough, in a direction that is free for ever: not towards another."""
    system = scene_from_spec("hex:n=2").system
    found = wandering(Scene("own", "", system, ((0, 0), (1, 0), (40, 0), (40, 9))))
    assert found is not None
    assert (set(found.modules), found.by) == ({(0, 0), (1, 0)}, (0, 1))


@pytest.mark.parametrize("times", [1, 2, 3])
def test_where_they_are_said_to_go_they_can_be(times: int) -> None:
    """A search that knows nothing of it finds a path to each of the repetitions."""
    scene = scene_from_spec("hex:n=3")
    found = wandering(scene)
    assert found is not None
    steps = Transitions(scene.system)
    there = [
        (x + times * found.by[0], y + times * found.by[1]) for x, y in map(cell_of, scene.start)
    ]
    path = optimum(steps, steps.encode(scene.start), steps.encode(there)).cubes
    assert path is not None
    assert sum(map(len, path)) <= times * found.moves


@pytest.mark.parametrize(
    "spec",
    ["hex:n=1", "hex-open:n=4", "hex-connected:n=4", "arm:n=4", "agv:graph=C5,n=2", "polygon:n=6"],
)
def test_nothing_is_claimed_of_what_has_an_end(spec: str) -> None:
    """One hexagon has nothing to roll on; the others have obstacles, a base or few places."""
    assert wandering(scene_from_spec(spec)) is None
