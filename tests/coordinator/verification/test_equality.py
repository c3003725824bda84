"""Two paths are equal up to swapping commuting moves, or homotopic, iff the obvious ways say so."""

from collections.abc import Sequence

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.coordinator.verification.dependencies import difference
from cubepath.protocol.core.actions import Action, commute
from oracles.obvious import obvious_normal_form
from samples.strategies import Word, class_key, detours, linear_extensions, toggle, words


def obviously_same(one: Sequence[Action], other: Sequence[Action]) -> bool:
    """Return whether moves can be taken off the front of both, each past what commutes with it."""
    left = list(other)
    for action in one:
        for place, each in enumerate(left):
            if each == action:
                del left[place]
                break
            if not commute(each, action):
                return False
        else:
            return False
    return not left


@given(st.data())
@settings(max_examples=50, deadline=None)
def test_paths_are_the_same_iff_one_is_the_other_reordered(data: st.DataObject) -> None:
    """A reordered path is the same; any other is the same iff swapping leads there."""
    word: Word = data.draw(words())
    assert difference(word, data.draw(linear_extensions(word))) is None
    other = list(data.draw(st.permutations(word)))
    assert (difference(word, other) is None) == obviously_same(word, other)
    assert (difference(other, word) is None) == obviously_same(word, other)


@given(st.data())
@settings(max_examples=50, deadline=None)
def test_paths_are_homotopic_iff_their_normal_cube_paths_are_equal(data: st.DataObject) -> None:
    """Detours change nothing; any other path is compared by definition, and by its class."""
    word: Word = data.draw(words())
    longer = data.draw(detours(word, word)) if word else word
    assert difference(word, longer, homotopic=True) is None
    other = data.draw(st.one_of(words(), st.permutations(word).map(tuple)))
    equal = obvious_normal_form(word) == obvious_normal_form(other)
    assert (difference(word, other, homotopic=True) is None) == equal
    assert (class_key(word) == class_key(other)) == equal


@pytest.mark.parametrize(
    ("one", "other", "homotopic", "why"),
    [
        ("aab", "b", False, "a is 2 times in the first, and 0 times in the second"),
        ("aab", "b", True, None),
        ("ac", "ca", False, "c finds 1 written 1 time in the first, and 0 times in the second"),
        ("ab", "ba", False, None),
        ("", "", False, None),
        ("", "a", True, "a is 0 times in the first, and 1 time in the second"),
    ],
)
def test_the_first_difference_is_named(
    one: str, other: str, homotopic: bool, why: str | None
) -> None:
    """By a move, and by the site that tells the order."""
    letters = {
        "a": toggle(1, label="a"),
        "b": toggle(2, label="b"),
        "c": toggle(3, reads=[1], label="c"),
    }
    first, second = ([letters[each] for each in word] for word in (one, other))
    found = difference(first, second, homotopic=homotopic)
    assert found is None if why is None else found in {why, "a" + why[1:]} or "finds" in why


def test_other_starts_are_a_difference() -> None:
    """Where both are known; the site is named."""
    found = difference([], [], (frozenset({1, 2}), frozenset({1})))
    assert found == "the starts differ: 2 is on in the first alone"
    assert difference([], [], (frozenset({1, 2}), None)) is None
