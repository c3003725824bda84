"""The normal form that verification derives: by definition, in two linear passes."""

from itertools import chain

from hypothesis import given, strategies as st

from cubepath.coordinator.verification.dependencies import cubes_of, numbered, remaining
from cubepath.protocol.core.actions import Action
from oracles.obvious import obvious_normal_form
from samples.strategies import Word, crowded_words, words


def left_of(path: Word) -> Word:
    """Return the moves that are left when all that cancels is taken out."""
    names, (numbers,) = numbered(path)
    return [path[place] for place in remaining(numbers, names)]


@given(st.one_of(words(), crowded_words()))
def test_the_cubes_are_those_of_the_definition(path: Word) -> None:
    """Whatever moves there are, with sites that are only read, and whatever cancels."""
    assert tuple(map(frozenset, cubes_of(path))) == obvious_normal_form(path)


@given(st.one_of(words(), crowded_words()))
def test_what_remains_is_what_stands_in_the_cubes(path: Word) -> None:
    """In the order of the path; a path there and back leaves nothing."""
    left = left_of(path)
    cubes = cubes_of(path)
    assert sorted(map(id, left)) == sorted(map(id, chain.from_iterable(cubes)))
    assert left_of(left) == left
    assert not left_of([*path, *reversed(path)])


@given(st.integers(1, 30))
def test_readers_hold_a_writer_back(readers: int) -> None:
    """Many moves read one site, and a move that writes it there cannot cancel before they do."""
    door = Action(["hub"], ["hub"], [], ["hub"])
    through = [Action(["hub", n], [n], [n], []) for n in range(readers)]
    assert len(left_of([door, *through, door])) == readers + 2
    assert not left_of([door, *through, *through, door])
