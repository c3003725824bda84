"""The search from both ends: it finds a path if there is one, in portions of any size."""

from collections.abc import Callable, Iterable
from itertools import pairwise

from hypothesis import given, settings, strategies as st

from cubepath.agents.rules.two_sided_search import TwoSidedSearch

EDGES = st.sets(st.tuples(st.integers(0, 7), st.integers(0, 7)), max_size=14)


def near_in(edges: set[tuple[int, int]]) -> Callable[[int], list[int]]:
    both = sorted(edges | {(two, one) for one, two in edges})
    return lambda here: [two for one, two in both if one == here]


def reached_from(start: int, near: Callable[[int], Iterable[int]]) -> set[int]:
    found = [start]
    for here in found:
        found += [there for there in near(here) if there not in found]
    return set(found)


@settings(max_examples=30, derandomize=True)
@given(EDGES, st.integers(0, 7), st.integers(1, 9), st.integers(0, 3))
def test_it_finds_a_path_exactly_if_there_is_one(
    edges: set[tuple[int, int]], goal: int, most: int, weight: int
) -> None:
    """Whatever the estimate, and whatever the portions; each step of the path is an edge."""
    near = near_in(edges)
    search = TwoSidedSearch(
        0, goal, near=near, estimate=lambda end: lambda here: weight * (here * end % 5)
    )
    portions = 1
    while not search.expand(most):
        portions += 1
        assert portions < 20
    assert (search.path is not None) == (goal in reached_from(0, near))
    if search.path is not None:
        assert (search.path[0], search.path[-1]) == (0, goal)
        assert all(there in near(here) for here, there in pairwise(search.path))


def test_a_goal_in_a_pocket_is_found_from_its_side() -> None:
    """A side without anything left ends the search, though the other has no end."""
    search = TwoSidedSearch(
        0,
        -1,
        near=lambda here: [here + 1, here - 1] if here > 0 else [1] if here == 0 else [],
        estimate=lambda end: lambda here: abs(here - end),
    )
    assert search.expand(1000)
    assert search.path is None
