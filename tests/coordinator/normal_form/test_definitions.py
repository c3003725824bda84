"""The predicates on cube paths: they say what the definitions say, and notice what is wrong."""

import pytest
from hypothesis import given

from cubepath.coordinator.normal_form.definitions import end_state, is_cube, is_normal
from cubepath.protocol.core.actions import apply, commute
from cubepath.protocol.core.errors import InputError
from samples.strategies import Word, edge, words


@given(words())
def test_a_cube_is_what_commutes_and_normal_is_what_the_definition_says(word: Word) -> None:
    """The predicates agree with their definitions, spelled out, on cubes good and bad."""
    bad = [word[:2], word[2:3], word[3:]]
    commuting = all(
        commute(one, other)
        for cube in bad
        for place, one in enumerate(cube)
        for other in cube[:place]
    )
    assert commuting == all(is_cube(cube) for cube in bad)
    pulled = any(
        action in bad[i] or all(commute(action, other) for other in bad[i])
        for i in (0, 1)
        for action in bad[i + 1]
    )
    assert is_normal(bad) == (commuting and not pulled and all(bad))


def test_a_normal_path_that_is_disturbed_is_found_out() -> None:
    """An action twice, an empty cube, a move one cube late, a common edge: none is normal."""
    one, far = edge(0, 1), edge(5, 6)
    assert is_normal([])
    assert is_normal([[one, far], [edge(1, 2)]])
    disturbed: list[list[Word]] = [[[one, one]], [[]], [[one], []], [[one], [far]], [[one], [one]]]
    for bad in disturbed:
        assert not is_normal(bad), bad


def test_end_state_names_the_move_that_does_not_fit() -> None:
    """A path that is not admissible is refused with the cube and the move, counted from 1."""
    start = frozenset({0, 5})
    assert end_state([], start) == start
    assert end_state([edge(0, 1), [edge(5, 6), edge(1, 2)]], start) == {2, 6}
    assert end_state([edge(0, 1)], start) == apply(edge(0, 1), start)
    with pytest.raises(InputError, match=r"^move 2: 3-4 is not admissible"):
        end_state([edge(0, 1), edge(3, 4)], start)
    with pytest.raises(InputError, match=r"^cube 2, move 1: 3-4 is not admissible"):
        end_state([[edge(0, 1)], [edge(3, 4)]], start)
