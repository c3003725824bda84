"""Which move waited for which: against the definition, pair by pair."""

from hypothesis import given, strategies as st

from cubepath.coordinator.normal_form.heap import Heap
from cubepath.coordinator.tools.viewing.run_view import waits_of
from cubepath.protocol.core.actions import commute
from samples.strategies import SCENES, Word, crowded_words, walks, words


@given(words() | crowded_words())
def test_a_move_waits_for_the_deepest_that_it_does_not_commute_with(path: Word) -> None:
    """Of the earlier moves that it does not commute with, the last of the greatest depth."""
    depths: list[int] = []
    below: list[int] = []
    for place, action in enumerate(path):
        under = [(depths[n], n) for n in range(place) if not commute(path[n], action)]
        deepest = max(under, default=(0, -1))
        depths.append(deepest[0] + 1)
        below.append(deepest[1])
    found = waits_of(path)
    assert (found.depths.tolist(), found.below.tolist()) == (depths, below)


@given(st.sampled_from(SCENES).flatmap(walks))
def test_in_a_normal_cube_path_the_depth_is_the_cube(path: Word) -> None:
    """A move of the third cube waits for one of the second; that is what normal means."""
    heap = Heap()
    heap.extend(path)
    cubes = heap.cube_path()
    numbers = [number for number, cube in enumerate(cubes, 1) for _ in cube]
    assert waits_of(action for cube in cubes for action in cube).depths.tolist() == numbers
