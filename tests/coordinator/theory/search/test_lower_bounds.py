"""Lower bounds: never above the exact optimum, and sharp where they should be."""

from itertools import permutations
from random import Random

import pytest
from hypothesis import given, strategies as st

from cubepath.coordinator.theory.search.exact import optimum
from cubepath.coordinator.theory.search.lower_bounds import bottleneck, lower_bound, module_bound
from cubepath.coordinator.theory.search.transitions import Transitions
from cubepath.protocol.core.catalogue import SQUARES, Catalogue, Generator
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Bound
from cubepath.protocol.scenes.families.triangulations import fan, polygon_points
from cubepath.protocol.systems.flips import FlipSystem, crossing_bound, flip_bound
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.systems.lattice import LatticeSystem
from cubepath.protocol.systems.point_sets import edges_of
from oracles.complexes import states_of
from oracles.point_grids import meet
from samples.space import SPACE
from samples.strategies import scene

SMALL = (
    "agv:graph=C6,n=2",
    "agv:graph=grid3x3,n=3",
    "agv-labelled:graph=grid3x2,n=2",
    "agv-labelled:graph=K4,n=3",
    "sliding:p=2,q=1,n=2",
    "sliding:p=1,q=1,n=3",
    "arm:n=5",
    "arm-free:n=4",
    "arms",
    "polygon:n=7",
    "triangulation:n=8",
    "triangulation:n=9,seed=4",
    "words",
    "words:presentation=raag",
    "assembly:n=3",
    "hex:n=4",
    "hex-open:n=3",
    *SPACE,
)


@pytest.mark.slow
@pytest.mark.parametrize("spec", SMALL)
def test_no_bound_is_above_the_optimum(spec: str) -> None:
    """From some states to others, among the first few hundred of each system."""
    where = scene(spec)
    steps = Transitions(where.system)
    states = states_of(where, most=300)
    random = Random(spec)  # noqa: S311 - nothing secret
    for _ in range(10):
        one, other = random.choice(states), random.choice(states)
        exact = optimum(steps, steps.encode(one), steps.encode(other))
        assert exact.cubes is not None
        least = len(exact.cubes)
        assert lower_bound(where.system, one, other, within=least).cubes <= least
        assert lower_bound(where.system, one, other, within=least + 50).cubes <= least
        assert lower_bound(None, one, other, within=least).cubes == min(1, least)


def test_labelled_vehicles_need_as_long_as_the_longest_way() -> None:
    """Eight steps for the one, whatever the other does; without labels the nearer end is taken."""
    labelled, plain = scene("agv-labelled:graph=P9,n=2").system, scene("agv:graph=P9,n=2").system
    start, goal = {(0, 0), (1, 1)}, {(7, 0), (8, 1)}
    assert module_bound(labelled, start, goal, within=99) == 7
    assert module_bound(plain, {0, 1}, {7, 8}, within=99) == 7
    assert module_bound(plain, {0, 4}, {4, 8}, within=99) == 4
    assert module_bound(labelled, {(0, 0), (5, 1)}, {(4, 0), (6, 1)}, within=99) == 4
    assert module_bound(labelled, {(0, 0), (5, 1)}, {(1, 0), (8, 1)}, within=99) == 3
    assert module_bound(labelled, {(0, 0), (5, 1)}, {(4, 0), (6, 1)}, within=2) == 2
    grid = scene("agv-labelled:graph=grid5x5,n=2").system
    crossed = {((4, 4), 0), ((0, 0), 1)}
    assert module_bound(grid, {((0, 0), 0), ((4, 4), 1)}, crossed, within=99) == 8


@pytest.mark.parametrize("spec", ["agv:graph=P9,n=2", "hex:n=2"])
def test_from_one_start_the_bound_is_that_of_the_goal(spec: str) -> None:
    """Modules paired by hand along a line, with the same start each time and other goals."""
    system = scene(spec).system

    def on(*places: int) -> set[Site]:
        return set(places) if system.graph is not None else {(place, 0) for place in places}

    bounds = {
        ends: module_bound(system, on(0, 3), on(*ends), within=99)
        for ends in [(0, 3), (1, 3), (0, 5), (3, 8), (0, 1)]
    }
    assert bounds == {(0, 3): 0, (1, 3): 1, (0, 5): 2, (3, 8): 5, (0, 1): 2}


def test_the_greatest_bound_counts_and_of_equals_the_first() -> None:
    """The way of a module where it is farther than one move; at equal ends there is no move."""
    plain = scene("agv:graph=P9,n=2").system
    assert lower_bound(plain, {0, 1}, {7, 8}, within=99) == Bound(7, "way of a module")
    assert lower_bound(plain, {0, 1}, {7, 8}, within=5) == Bound(5, "way of a module")
    assert lower_bound(plain, {0, 1}, {0, 2}, within=99) == Bound(1, "the ends differ")
    assert lower_bound(plain, {0, 1}, {0, 1}, within=99) == Bound(0, "no move")
    assert lower_bound(None, {0}, {1}, within=99) == Bound(1, "the ends differ")
    assert lower_bound(None, {0}, {0}, within=99) == Bound(0, "no move")


def test_the_bounds_of_the_system_itself_count() -> None:
    """From a fan to the next the crossings halve, 5, 2, 1, 0; three rounds are refuted as well."""
    system = FlipSystem(polygon_points(8))
    one, other = fan(0, 8) | system.kept, fan(1, 8) | system.kept
    found = lower_bound(system, one, other, within=99)
    assert Bound(3, "an edge's crossings halve") in system.bounds(one, other)
    assert found == Bound(4, "fewer rounds contradict themselves")
    steps = Transitions(system)
    ends = steps.encode(one), steps.encode(other)
    assert len(optimum(steps, *ends, max_states=10**5, most=9).cubes or ()) == 4
    assert module_bound(system, one, other, within=99) < found.cubes


class Silent(GraphSystem):
    """Vehicles of a class that does not say where they can go."""

    def ways(self) -> None:  # type: ignore[override] # pyright: ignore[reportIncompatibleMethodOverride]
        """Return nothing, as a system may."""


def test_where_ways_are_not_known_no_module_bounds_a_path() -> None:
    """Such a system has a bound all the same where its ends differ."""
    silent = Silent([0, 1, 2], [(0, 1), (1, 2)])
    assert module_bound(silent, {0}, {2}, within=9) == 0
    assert lower_bound(silent, {0}, {2}, within=9) == Bound(1, "the ends differ")


def test_obstacles_and_walls_make_ways_longer() -> None:
    """Round the p-by-q obstacle it is farther than through it."""
    where = scene("sliding:p=3,q=2")
    assert where.goal is not None
    assert module_bound(where.system, where.start_state, where.goal, within=99) == 6
    assert isinstance(where.system, LatticeSystem)
    free = LatticeSystem(where.system.catalogue)
    assert module_bound(free, set(where.start), where.goal, within=99) == 4


@given(
    st.integers(1, 5).flatmap(
        lambda size: st.lists(
            st.lists(st.integers(0, 9), min_size=size, max_size=size), min_size=size, max_size=size
        )
    )
)
def test_the_bottleneck_is_the_least_of_all_pairings(away: list[list[int]]) -> None:
    """Against all permutations."""
    assert bottleneck([], 9) == 0
    best = min(
        max(row[column] for row, column in zip(away, order, strict=True))
        for order in permutations(range(len(away)))
    )
    assert bottleneck(away, 9) == best
    assert bottleneck(away, 3) == min(best, 3)


@pytest.mark.parametrize("corners", [6, 9, 12, 20])
def test_a_fan_needs_rounds_like_the_logarithm_of_its_corners(corners: int) -> None:
    """From one fan to the opposite: the diagonal that crosses most halves each round at best."""
    system = FlipSystem(polygon_points(corners))
    one, other = fan(0, corners) | system.kept, fan(corners // 2, corners) | system.kept
    points, rows = list(system.plane.points), edges_of(one - other)
    crossed = max(sum(meet(points, edge, each) for each in rows) for edge in edges_of(other - one))
    assert crossing_bound(system, one, other) == crossed.bit_length()
    assert crossing_bound(system, other, one) == crossing_bound(system, one, other)
    assert crossing_bound(system, one, one) == flip_bound(system, one, one) == 0


def test_no_more_flips_at_one_time_than_pairs_of_triangles() -> None:
    """A polygon of 8 corners has 6 triangles: three flips a round, so five edges take two."""
    system = FlipSystem(polygon_points(8))
    one, other = fan(0, 8) | system.kept, fan(1, 8) | system.kept
    assert len(other - one) == 5
    assert flip_bound(system, one, other) == 2


def test_modules_that_are_not_taken_one_to_one_are_not_paired() -> None:
    """Two that become one: each end is only compared with the nearest."""
    merge = Generator(
        "merge",
        support=((0, 0), (1, 0), (2, 0)),
        trace=((0, 0), (1, 0), (2, 0)),
        before=((0, 0), (2, 0)),
        after=((1, 0),),
        motion=(((0, 0), (1, 0)), ((2, 0), (1, 0))),
    )
    system = LatticeSystem(Catalogue(SQUARES, (merge,)))
    assert module_bound(system, {(0, 0), (2, 0)}, {(1, 0)}, within=9) == 1
    assert module_bound(system, {(0, 0), (9, 0)}, {(1, 0)}, within=3) == 3
    # A source that is far from every target counts as much as a target far from every source.
    assert module_bound(system, {(0, 0), (9, 0)}, {(1, 0)}, within=99) == 8
    assert module_bound(system, {(0, 0), (2, 0)}, {(1, 0), (9, 0)}, within=99) == 7
    assert module_bound(system, {(0, 0), (2, 0)}, {(1, 0), (9, 0)}, within=3) == 3
    # As many targets as sources are not paired either: of three pairs one would be 8 apart.
    sources: set[Site] = {(0, 0), (1, 0), (10, 0)}
    assert module_bound(system, sources, {(0, 0), (9, 0), (10, 0)}, within=99) == 1
    # Nor where nobody is left, or was there: a file may say so.
    assert module_bound(system, {(0, 0)}, set(), within=9) == 0
    assert module_bound(system, set(), {(0, 0)}, within=9) == 0
    assert module_bound(system, set(), set(), within=9) == 0
