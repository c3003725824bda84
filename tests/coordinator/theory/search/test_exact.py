"""The exact optimum over all classes: against the obvious search, and against every known path."""

import pytest

from cubepath.coordinator.normal_form.definitions import end_state, is_cube
from cubepath.coordinator.theory.search.exact import optimum
from cubepath.coordinator.theory.search.transitions import Transitions, only_class
from cubepath.protocol.core.actions import apply
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from oracles.complexes import actions_at, commuting_sets
from samples.space import SPACE
from samples.strategies import scene, toggle

SMALL = (
    "agv:graph=C5,n=2",
    "agv:graph=K4,n=2",
    "agv-labelled:graph=P4,n=2",
    "agv-labelled:graph=C4,n=2",
    "sliding:p=1,q=1,n=2",
    "arm:n=4",
    "arm-free:n=3",
    "arms",
    "polygon:n=6",
    "triangulation:n=6",
    "words",
    "assembly:n=2",
    "hex:n=3",
    *SPACE[1:],
)


def obvious_distances(where: Scene) -> dict[frozenset[Site], int]:
    """Return the number of rounds to each state, by sets of commuting actions, layer by layer."""
    first = frozenset(where.start_state)
    found, layer, distance = {first: 0}, [first], 0
    while layer:
        distance += 1
        following = []
        for state in layer:
            for cube in commuting_sets(actions_at(where, state)):
                there = state
                for action in cube:
                    there = apply(action, there)
                if there not in found:
                    found[there] = distance
                    following.append(there)
        layer = following
        if distance == 3:
            break
    return found


@pytest.mark.parametrize("spec", SMALL)
def test_the_optimum_is_what_the_obvious_search_finds(spec: str) -> None:
    """From the start to every state within three rounds, and the path is one of cubes."""
    where = scene(spec)
    steps = Transitions(where.system)
    start = steps.encode(where.start_state)
    known = obvious_distances(where)
    for state, distance in sorted(known.items(), key=lambda each: each[1])[-40:]:
        found = optimum(steps, start, steps.encode(state))
        assert found.cubes is not None
        assert found.at_least == len(found.cubes) == distance
        path = [[steps.actions[number] for number in cube] for cube in found.cubes]
        assert end_state(path, where.start_state) == state
        assert all(map(is_cube, path))


@pytest.mark.parametrize("bound", [1, 5, 20, 60])
def test_a_search_that_is_stopped_still_bounds_from_below(bound: int) -> None:
    """Whatever the number of states it may look at, it never claims too much."""
    where = scene("agv:graph=grid3x3,n=3")
    steps = Transitions(where.system)
    start, goal = steps.encode(where.start_state), steps.encode(where.goal or ())
    exact = optimum(steps, start, goal)
    assert exact.cubes is not None
    stopped = optimum(steps, start, goal, max_states=bound)
    assert stopped.at_least <= exact.at_least
    assert stopped.cubes is None or len(stopped.cubes) == exact.at_least


def test_maximal_sets_of_moves_are_not_enough() -> None:
    """One vehicle must stay where it is although it could move, or the other is not there alone."""
    where = scene("agv:graph=P5,n=2")
    steps = Transitions(where.system)
    found = optimum(steps, steps.encode([0, 3]), steps.encode([0, 4]))
    assert found.cubes is not None
    assert [len(cube) for cube in found.cubes] == [1]
    assert len(steps.greedy(steps.possible(steps.encode([0, 3])))) == 2


def test_what_is_out_of_reach_is_not_found() -> None:
    """Two labelled vehicles on a path cannot pass each other: no optimum, and no endless search."""
    where = scene("agv-labelled:graph=P3,n=2")
    steps = Transitions(where.system)
    found = optimum(steps, steps.encode([(0, 0), (2, 1)]), steps.encode([(2, 0), (0, 1)]))
    assert found.cubes is None


def test_a_list_of_actions_is_a_system_too() -> None:
    """Without a system the moves are those that are listed, also those that start from nothing."""
    listed = Transitions(None, [toggle(f"on {number}") for number in range(3)])
    found = optimum(listed, 0, listed.encode(["on 0", "on 2"]))
    assert found.cubes is not None
    assert [len(cube) for cube in found.cubes] == [2]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spec", "expected"),
    [
        ("arm:n=30", True),
        ("assembly:kind=wall,n=12", True),
        ("arm-free:n=3", True),
        ("agv:graph=C5,n=1", False),
        ("agv:graph=grid2x2,n=2", False),
        ("hex:n=12", None),
    ],
)
def test_whether_there_is_but_one_class(spec: str, expected: bool | None) -> None:
    """Known for the positive arm and assemblies, computed where small, else not claimed."""
    where = scene(spec)
    assert only_class(Transitions(where.system), where.start_state) is expected
