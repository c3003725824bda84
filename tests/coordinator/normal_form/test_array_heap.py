"""The heap over numbers, plain and compiled: levels, pairs, room, and large paths."""

from collections import Counter
from collections.abc import Generator, Sequence
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from cubepath.coordinator.normal_form.array_heap import ActionTable, NumberedHeap, normal_form
from cubepath.coordinator.normal_form.compiled_heap import FastHeap, Numbering, cancellations
from cubepath.coordinator.normal_form.heap import Heap
from cubepath.coordinator.normal_form.kernel import Numbers
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from oracles.plain_steps import COMPILED, PLAIN, plain_steps
from samples.strategies import Word, crowded_words, lists_of, toggle, words


@st.composite
def hub_words(draw: st.DrawFn) -> Word:
    """Draw a word in which some fifty pieces read one site, in all orders, and others write it.

    More than sixteen readers make a heap of a group: both sides of that border are met.
    """
    towers = draw(st.sampled_from([3, 15, 18, 40]))
    random = draw(st.randoms(use_true_random=False))
    letters = [(toggle(n), toggle(n, reads=["hub"])) for n in range(towers)]
    hub = toggle("hub")
    found: Word = []
    often = draw(st.sampled_from([0.0, 0.01, 0.1]))
    for _ in range(draw(st.integers(0, 300))):
        if random.random() < often:
            found.append(hub)
            if random.random() < 0.7:
                found.append(hub)
        else:
            found.append(letters[random.randrange(towers)][random.random() < 0.7])
    return found


all_words = st.one_of(words(max_size=60), crowded_words(), hub_words())


@pytest.fixture(params=[PLAIN, COMPILED], ids=["plain", "compiled"], scope="module")
def _each_way(request: pytest.FixtureRequest) -> Generator[None]:
    with plain_steps(request.param):
        yield


each_way = pytest.mark.usefixtures("_each_way")


def numbered(word: Sequence[Action]) -> tuple[Numbers, ActionTable]:
    numbering = Numbering()
    numbers = [numbering.number(action) for action in word]
    table = numbering.table()
    none = np.zeros(1, np.int32)
    return np.array(numbers, np.int32), table or ActionTable(none, none[:0], none, none[:0])


def as_multisets(cubes: Sequence[Sequence[Action]]) -> list[Counter[Action]]:
    return [Counter(cube) for cube in cubes]


@each_way
@settings(max_examples=20)
@given(all_words)
def test_levels_are_those_of_the_reference(word: Word) -> None:
    """The moves of a level are a cube, and the pairs are equal moves that the heap took out."""
    heap = Heap()
    heap.extend(word)
    found = cancellations(word)
    cubes: list[list[Action]] = [[] for _ in range(heap.cubes)]
    for action, level, partner in zip(word, *(part.tolist() for part in found), strict=True):
        assert (level == 0) == (partner >= 0)
        if level:
            cubes[level - 1].append(action)
    assert as_multisets(cubes) == as_multisets(heap.cube_path())
    for place in np.flatnonzero(found.partners >= 0).tolist():
        partner = int(found.partners[place])
        assert partner != place
        assert found.partners[partner] == place
        assert word[partner] == word[place]


@each_way
@settings(max_examples=20)
@given(all_words)
def test_pairs_cancel_one_after_the_other(word: Word) -> None:
    """In the order of the later of each pair, all between the two commutes or is gone."""
    found = cancellations(word)
    there = list(range(len(word)))
    pairs = {(min(pair), max(pair)) for pair in enumerate(found.partners.tolist()) if pair[1] >= 0}
    for early, late in sorted(pairs, key=lambda pair: pair[1]):
        between = there[there.index(early) + 1 : there.index(late)]
        assert all(word[early].support.isdisjoint(word[other].trace) for other in between)
        assert all(word[early].trace.isdisjoint(word[other].support) for other in between)
        there.remove(early)
        there.remove(late)


@pytest.mark.thorough
@settings(max_examples=120)
@given(all_words, st.data())
def test_the_stream_agrees_with_the_reference_at_every_question(
    word: Word, data: st.DataObject
) -> None:
    """Counts and cubes, asked at any moments.

    From some moment on, before, in or after the path, the code is compiled.
    """
    telling = data.draw(st.booleans())
    with plain_steps(data.draw(st.sampled_from([0, 10, 30, 100, 300, 1000, PLAIN]))):
        heap, reference = FastHeap(telling=telling), Heap()
        begin = 0
        while begin < len(word):
            end = data.draw(st.integers(begin + 1, len(word)))
            for action in word[begin:end]:
                heap.append(action)
                reference.append(action)
            begin = end
            assert heap.moves == reference.moves
            assert heap.cubes == reference.cubes
            assert heap.reduced_moves == reference.reduced_moves
            assert heap.max_cube_dimension == reference.max_cube_dimension
            assert heap.cube_path() == reference.cube_path()
            if telling:
                for told, found in zip(heap.normal_form(), cancellations(word[:end]), strict=True):
                    assert told.tolist() == found.tolist()


def test_a_heap_that_was_not_to_tell_does_not() -> None:
    """What became of moves is kept only where that was asked for beforehand."""
    with pytest.raises(ValueError, match="not asked to record"):
        FastHeap().normal_form()


@each_way
@settings(max_examples=20)
@given(all_words, st.integers(1, 40))
def test_the_size_of_the_portions_does_not_matter(word: Word, portion: int) -> None:
    """Room that was made at once, and room made as it was needed, hold the same."""
    numbers, table = numbered(word)
    at_once, by_portions = NumberedHeap(table), NumberedHeap(table)
    at_once.append(numbers)
    for begin in range(0, len(numbers), portion):
        by_portions.append(numbers[begin : begin + portion])
    for one, other in zip(at_once.pieces(), by_portions.pieces(), strict=True):
        assert one.tolist() == other.tolist()
    assert at_once.max_cube_dimension == by_portions.max_cube_dimension


def test_the_room_is_that_of_what_is_left() -> None:
    """Readers that come and go under a tall one take no room, however often."""
    heap = FastHeap()
    heap.extend([toggle("t"), toggle("t", "u")] * 50)
    heap.append(toggle("t", reads=["hub"]))
    random = Random(1)  # noqa: S311 - nothing secret
    readers = [toggle(n, reads=["hub"]) for n in range(40)]
    heap.extend(random.choice(readers) for _ in range(2000))
    sizes = []
    for _ in range(5):
        heap.extend(random.choice(readers) for _ in range(20_000))
        assert heap.reduced_moves < 150
        sizes.append(heap._heap.nbytes)  # pyright: ignore[reportPrivateUsage]
    assert max(sizes) < 300_000


def ring(size: int, moves: int, seed: int = 1) -> tuple[Numbers, ActionTable]:
    """Return a random path on a ring of sites: each action writes 2 sites and reads 6."""
    places = np.arange(size, dtype=np.int32)[:, None]
    table = ActionTable(
        np.arange(0, 2 * size + 1, 2, dtype=np.int32),
        ((places + np.arange(2)) % size).astype(np.int32).ravel(),
        np.arange(0, 6 * size + 1, 6, dtype=np.int32),
        ((places + np.arange(2, 8)) % size).astype(np.int32).ravel(),
    )
    return np.random.default_rng(seed).integers(0, size, moves).astype(np.int32), table


def pieces_of(numbers: Numbers, levels: Numbers) -> list[tuple[int, int]]:
    """Return the pieces as (level, action): which of two equal moves is left, the order decides."""
    left = levels > 0
    return sorted(zip(levels[left].tolist(), numbers[left].tolist(), strict=True))


def test_going_over_to_compiled_code_changes_nothing() -> None:
    """Wherever in a path that happens: the same pieces, and what became of every move."""
    out, table = ring(60, 1200)
    path = np.concatenate([out, out[400:][::-1]])

    def fallen(left: int) -> list[list[int]]:
        heap = NumberedHeap(table, telling=True)
        for begin in range(0, len(path), 100):
            with plain_steps(PLAIN if begin < left else COMPILED):
                heap.append(path[begin : begin + 100])
        return [part.tolist() for part in (*heap.pieces(), *heap.normal_form())]

    plain = fallen(len(path))
    assert len(plain[0]) < 500
    for left in range(0, len(path), 300):
        assert fallen(left) == plain


@pytest.mark.nightly
def test_a_million_moves_there_and_back() -> None:
    """Half a million moves of 8 sites, undone in part and as a whole; tests/bench has the time."""
    out, table = ring(500, 500_000)
    half = len(out) // 2
    back = normal_form(np.concatenate([out, out[::-1]]), table)
    assert not back.levels.any()
    part = np.concatenate([out, out[half:][::-1]])
    found = normal_form(part, table)
    expected = normal_form(out[:half], table)
    assert expected.levels.max() > 5000
    assert pieces_of(part, found.levels) == pieces_of(out[:half], expected.levels)


BAD_TABLES: dict[str, tuple[list[int], ...]] = {
    "as many": ([0, 1], [0], [0], []),
    "do not go from 0 to 1": ([0, 2], [0], [0, 0], []),
    "do not rise": ([0, 0], [], [0, 0], []),
    "expected 0 or more": ([0, 1], [-1], [0, 0], []),
}


@pytest.mark.parametrize("reason", BAD_TABLES)
def test_a_table_that_does_not_fit_together_is_refused(reason: str) -> None:
    """Compiled code does not look at the ends of arrays, so this is looked at before."""
    with pytest.raises(InputError, match=reason):
        NumberedHeap(ActionTable(*(np.array(part, np.int32) for part in BAD_TABLES[reason])))


@pytest.mark.parametrize("number", [-1, 1])
def test_a_move_of_no_action_is_refused(number: int) -> None:
    """A number below or above those of the table."""
    table = ActionTable(*(np.array(part, np.int32) for part in ([0, 1], [0], [0, 0], [])))
    with pytest.raises(InputError, match="none of 1"):
        normal_form(np.array([0, number], np.int32), table)


@given(lists_of(st.integers(0, 3), max_size=12))
def test_actions_and_sites_may_come_at_any_time(choices: list[int]) -> None:
    """A heap whose table grows answers as one that knew all from the start."""
    letters = [toggle(1), toggle(2, reads=[1]), toggle(9, reads=[2, 5]), toggle(3, 1)]
    grown, reference = FastHeap(), Heap()
    for choice in choices:
        grown.append(letters[choice])
        reference.append(letters[choice])
        assert grown.cubes == reference.cubes
    assert grown.cube_path() == reference.cube_path()
