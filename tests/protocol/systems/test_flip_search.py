"""The compiled search for short paths of flips, against what is obvious and against all paths."""

from collections.abc import Iterator, Sequence
from itertools import islice
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from cubepath.coordinator import improve, lower_bound
from cubepath.coordinator.normal_form.definitions import end_state, is_normal
from cubepath.coordinator.normal_form.heap import Heap
from cubepath.coordinator.theory.search.exact import optimum
from cubepath.coordinator.theory.search.transitions import Transitions
from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Bound
from cubepath.protocol.scenes.families.triangulations import random_points
from cubepath.protocol.scenes.random_scenes import Stream, random_triangulation
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.flip_greedy import crossings
from cubepath.protocol.systems.flip_search import FlipSearch, copy_of, mesh_of, settle
from cubepath.protocol.systems.flips import FlipSystem, crossing_bound
from cubepath.protocol.systems.point_sets import Edge, Point, edge_of
from oracles.point_grids import on_grid

SQUARE = "triangulation:n=10,start=random,goal=random,seed="


def random_pair(points: Sequence[Point], seed: int) -> tuple[FlipSystem, State, State]:
    """Return a system and two random triangulations, with all their edges."""
    system = FlipSystem(points)
    one, other = (random_triangulation(system, Stream(f"{n}", seed)) for n in range(2))
    return system, one, other


def found(system: FlipSystem, start: State, goal: State, steps: int, seed: int = 1) -> list[Action]:
    """Return the last path that so many steps of the search yield."""
    search = system.paths(start, goal, seed=seed)
    assert search is not None
    paths = [path for path in islice(search, steps) if path is not None]
    return list(paths[-1])


def wander(
    system: FlipSystem, start: State, moves: int, seed: int
) -> tuple[list[Action], frozenset[Site]]:
    """Return a random walk, which may take flips back, and where it ends."""
    random = Random(seed)  # noqa: S311 - nothing secret
    steps, path = Transitions(system), list[Action]()
    state = steps.encode(start)
    for _ in range(moves):
        number = random.choice(steps.possible(state))
        path.append(steps.actions[number])
        state ^= steps.toggle[number]
    return path, steps.decode(state)


@given(on_grid(12), st.integers(0, 99))
def test_paths_are_legal_and_reach_the_goal(points: list[Point], seed: int) -> None:
    """Every path that is yielded is admissible move by move and ends at the goal."""
    try:
        system, start, goal = random_pair(points, seed)
    except InputError:
        return
    search = system.paths(start, goal, seed=seed)
    assert search is not None
    costs = []
    for path in islice(search, 40):
        if path is not None:
            assert end_state(path, start) == goal
            heap = Heap()
            heap.extend(path)
            costs.append((heap.cubes, heap.reduced_moves))
    assert costs
    assert costs == sorted(costs, reverse=True)


@settings(max_examples=30)
@given(st.integers(0, 10**6))
def test_no_path_is_shorter_than_the_optimum(seed: int) -> None:
    """On small sets the search meets the exhaustive optimum, and never goes below it."""
    system, start, goal = random_pair(random_points(9, seed), seed)
    heap = Heap()
    heap.extend(found(system, start, goal, 60))
    steps = Transitions(system)
    exact = optimum(
        steps, steps.encode(start), steps.encode(goal), max_states=10**6, most=heap.cubes
    )
    assert exact.at_least <= heap.cubes
    assert exact.cubes is not None
    assert len(exact.cubes) == heap.cubes


@pytest.mark.parametrize("seed", [1, 2])
def test_the_seed_decides_the_path(seed: int) -> None:
    """The same seed gives the same paths, step by step."""
    system, start, goal = random_pair(random_points(60, 5), 5)
    one, other = (system.paths(start, goal, seed=seed) for _ in range(2))
    assert one is not None
    assert other is not None
    assert list(islice(one, 60)) == list(islice(other, 60))


def test_a_known_path_is_where_it_begins() -> None:
    """With a path of two flips known, none longer is yielded; one to elsewhere is ignored."""
    scene = scene_from_spec("polygon:n=12,goal=5")
    system, start = scene.system, scene.start_state
    assert isinstance(system, FlipSystem)
    path, state = wander(system, start, 2, 1)
    search = system.paths(start, state, seed=0, known=path)
    assert search is not None
    first = next(each for each in search if each is not None)
    assert len(first) <= 2
    elsewhere = system.paths(start, {*(scene.goal or ()), *system.filled}, seed=0, known=path)
    assert elsewhere is not None
    assert len(next(each for each in elsewhere if each is not None)) > 2


@given(on_grid(12), st.integers(0, 99))
def test_settled_flips_are_the_levels_of_the_heap(points: list[Point], seed: int) -> None:
    """A random walk that may take flips back has as many rounds and moves as its heap of pieces."""
    try:
        system, start, _ = random_pair(points, seed)
    except InputError:
        return
    path, state = wander(system, start, 60, seed)
    small = system.plane.small
    assert small is not None
    mesh, goal = mesh_of(small, edges_of(start)), mesh_of(small, edges_of(state))
    assert mesh is not None
    assert goal is not None
    numbers = {edge_of(*edge): number for number, edge in enumerate(mesh.ends.tolist())}
    flips = []
    for action in path:
        old, new = sorted(edges_of(action.trace), key=lambda edge: edge not in numbers)
        numbers[new] = numbers.pop(old)
        flips.append(numbers[new])
    settled, error = settle(copy_of(mesh), np.array(flips, dtype=np.int64))
    heap = Heap()
    heap.extend(path)
    assert error == 0
    assert len(settled.edge) == heap.reduced_moves
    assert settled.round.max(initial=0) == heap.cubes
    search = FlipSearch(mesh, goal, 0)
    both = (edges_of(each.trace) for each in path)
    search.take((one, other) for one, other in both)
    assert (search.rounds, search.flips) == (heap.cubes, heap.reduced_moves)


def edges_of(sites: State) -> list[Edge]:
    """Return edges in order."""
    return [edge_of(*edge) for edge in in_order(sites) if isinstance(edge, tuple)]


@pytest.mark.thorough
@given(on_grid(12), st.integers(0, 99))
def test_walks_cross_what_the_edges_cross(points: list[Point], seed: int) -> None:
    """Following each edge counts as many crossings as comparing it with all the others."""
    try:
        system, start, goal = random_pair(points, seed)
    except InputError:
        return
    assert system.plane.small is not None
    for one, other in ((start, goal), (goal, start)):
        edges, rows = edges_of(one), np.array(edges_of(other))
        mesh = mesh_of(system.plane.small, edges_of(other | system.kept))
        assert mesh is not None
        compared = [int(system.plane.crossings(edge, rows).sum()) for edge in edges]
        assert crossings(mesh, np.array(edges)).tolist() == compared


@given(on_grid(10), st.integers(0, 10**6))
def test_no_bound_exceeds_the_optimum(points: list[Point], seed: int) -> None:
    """Nothing that is refuted exists: exhaustive search finds no shorter path than any bound."""
    try:
        system, start, goal = random_pair(points, seed)
    except InputError:
        return
    steps = Transitions(system)
    ends = steps.encode(start), steps.encode(goal)
    exact = optimum(steps, *ends, max_states=10**6, most=99).cubes
    assert exact is not None
    bounds = [bound.cubes for bound in system.bounds(start, goal)] if exact else [0]
    assert max(bounds) <= len(exact)


@pytest.mark.parametrize("seed", range(2))
def test_refutation_meets_what_the_search_finds(seed: int) -> None:
    """On random sets of 40 points the bound is the number of cubes found, and so the optimum."""
    system, start, goal = random_pair(random_points(40, seed), seed)
    heap = Heap()
    heap.extend(found(system, start, goal, 200))
    bound = lower_bound(system, start, goal, within=heap.cubes)
    assert bound == Bound(heap.cubes, "fewer rounds contradict themselves")
    assert crossing_bound(system, start, goal) < bound.cubes


def test_wide_coordinates_have_no_compiled_search() -> None:
    """Where products may overflow there is no answer, and the other searches do their work."""
    system = FlipSystem([(0, 0), (2**31, 0), (2**31, 2**31), (0, 2**31)])
    start, goal = system.kept | {(0, 2)}, system.kept | {(1, 3)}
    assert system.paths(start, goal, seed=0) is None
    path = [system.action("flip", (0, 1, 2, 3))]
    assert improve(path, start, system, iterations=5).cubes == 1


def test_improve_uses_the_search_and_checks_it() -> None:
    """From a long detour the path comes down to the optimum, in normal form."""
    scene = scene_from_spec(f"{SQUARE}3")
    system, start = scene.system, scene.start_state
    assert isinstance(system, FlipSystem)
    goal, steps = whole_goal(scene.goal, system), Transitions(system)
    path, state = wander(system, start, 200, 1)
    path += found(system, state, goal, 1)
    better = improve(path, start, system, iterations=50, seed=1)
    assert end_state(better.cube_path, start) == goal
    assert is_normal(better.cube_path)
    ends = steps.encode(start), steps.encode(goal)
    exact = optimum(steps, *ends, max_states=10**5, most=better.cubes)
    assert exact.cubes is not None
    assert len(exact.cubes) == better.cubes


class Lying(FlipSystem):
    """Claims a path that does not reach the goal, or one that cannot be made."""

    twice = False

    def paths(
        self, start: State, goal: State, *, seed: int, known: object = ()
    ) -> Iterator[Sequence[Action] | None]:
        """Yield a path that is wrong."""
        del goal, seed, known
        steps = Transitions(self)
        first = steps.actions[steps.possible(steps.encode(start))[0]]
        other = next(
            each
            for number in steps.possible(steps.encode({*start} ^ first.trace))
            if (each := steps.actions[number]) != first and not first.trace.isdisjoint(each.support)
        )
        yield None
        yield [other] if self.twice else [first]


@pytest.mark.parametrize(("twice", "why"), [(True, "is not legal: move 1"), (False, "at the goal")])
def test_what_a_search_claims_is_checked(twice: bool, why: str) -> None:
    """A system whose paths are wrong is named, and what is wrong with them."""
    scene = scene_from_spec("polygon:n=8")
    assert isinstance(scene.system, FlipSystem)
    system = Lying(scene.system.plane.points)
    system.twice = twice
    good = found(
        FlipSystem(system.plane.points), scene.start_state, whole_goal(scene.goal, system), 1
    )
    with pytest.raises(CheckError, match=rf"Lying\.paths has found .*{why}"):
        improve(good, scene.start_state, system, iterations=50)


def whole_goal(goal: frozenset[Site] | None, system: FlipSystem) -> frozenset[Site]:
    """Return the goal with the edges that are in every triangulation."""
    return frozenset(goal or ()) | system.filled
