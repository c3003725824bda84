"""The heap of pieces: its cube path is admissible, normal, shortest, and the same for any order.

All of it holds of the reference, and of the heap of numbers in plain Python and compiled.
"""

import os
import subprocess
import sys
import tracemalloc
from collections.abc import Callable, Generator, Sequence
from random import Random

import pytest
from hypothesis import assume, example, given, settings, strategies as st

from cubepath.coordinator.normal_form.compiled_heap import FastHeap
from cubepath.coordinator.normal_form.definitions import end_state, is_normal
from cubepath.coordinator.normal_form.heap import Heap
from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.system import Scene
from oracles.complexes import actions_at, commuting_sets
from oracles.obvious import obvious_normal_form
from oracles.plain_steps import COMPILED, PLAIN, plain_steps
from samples.strategies import (
    SCENES,
    ClassKey,
    Word,
    alphabets,
    class_key,
    crowded_words,
    detours,
    edge,
    linear_extensions,
    lists_of,
    random_walk,
    reduced,
    scene,
    toggle,
    walks,
    walks_with_detours,
    words,
)

Cubes = Sequence[Sequence[Action]]
Make = Callable[[], Heap | FastHeap]
abstract_words = st.one_of(words(), crowded_words())
HEAPS: dict[str, tuple[Make, int]] = {
    "reference": (Heap, PLAIN),
    "plain": (FastHeap, PLAIN),
    "compiled": (FastHeap, COMPILED),
}


@pytest.fixture(params=HEAPS, scope="module")
def make(request: pytest.FixtureRequest) -> Generator[Make]:
    """Return what makes a heap of each kind in turn."""
    found, left = HEAPS[request.param]
    with plain_steps(left):
        yield found


def path_of(make: Make, word: Word) -> tuple[tuple[Action, ...], ...]:
    heap = make()
    heap.extend(word)
    return heap.cube_path()


def as_sets(cubes: Cubes) -> tuple[frozenset[Action], ...]:
    return tuple(frozenset(cube) for cube in cubes)


def flat(cubes: Cubes) -> Word:
    return [action for cube in cubes for action in cube]


@pytest.mark.slow
@given(abstract_words)
def test_a_word_becomes_a_normal_cube_path_of_its_class(make: Make, word: Word) -> None:
    """The result is a normal cube path, homotopic to the input, with nothing left to cancel."""
    cubes = path_of(make, word)
    assert is_normal(cubes)
    assert class_key(flat(cubes)) == class_key(word)
    assert len(flat(cubes)) == len(reduced(word))


@pytest.mark.slow
@given(abstract_words, st.data())
def test_any_order_that_respects_dependencies_gives_the_same(
    make: Make, word: Word, data: st.DataObject
) -> None:
    """The cubes, and the order in each, do not depend on the order of commuting moves."""
    assert path_of(make, data.draw(linear_extensions(word))) == path_of(make, word)


@pytest.mark.slow
@given(st.data())
def test_detours_there_and_back_change_nothing(make: Make, data: st.DataObject) -> None:
    """A word put in with its reverse, in between other moves that commute, leaves no trace."""
    letters = data.draw(alphabets())
    word = data.draw(lists_of(st.sampled_from(letters), max_size=16))
    assert path_of(make, data.draw(detours(word, letters))) == path_of(make, word)


@pytest.mark.slow
@given(abstract_words)
def test_after_every_move_the_path_is_that_of_the_moves_so_far(make: Make, word: Word) -> None:
    """Appending one at a time agrees with starting anew, in the path and in every count."""
    heap = make()
    for count, action in enumerate(word, start=1):
        heap.append(action)
        cubes = heap.cube_path()
        assert as_sets(cubes) == obvious_normal_form(word[:count])
        assert heap.moves == count
        assert heap.reduced_moves == len(flat(cubes))
        assert heap.cubes == len(cubes)
        assert heap.max_cube_dimension == max((len(cube) for cube in cubes), default=0)


@pytest.mark.slow
@pytest.mark.parametrize("spec", SCENES)
@given(data=st.data())
@settings(max_examples=6)
def test_a_walk_of_a_system_becomes_its_normal_cube_path(
    make: Make, spec: str, data: st.DataObject
) -> None:
    """Same start, same end, all admissible, normal; the same for any order and with detours."""
    start = scene(spec).start_state
    word = data.draw(walks(spec))
    cubes = path_of(make, word)
    assert end_state(cubes, start) == end_state(word, start)
    assert is_normal(cubes)
    assert class_key(flat(cubes)) == class_key(word)
    assert as_sets(cubes) == obvious_normal_form(word)
    for other in (data.draw(linear_extensions(word)), data.draw(walks_with_detours(spec, word))):
        assert end_state(other, start) == end_state(word, start)
        assert path_of(make, other) == cubes


def test_the_generated_paths_do_cancel_and_do_run_in_parallel() -> None:
    """In every scene walks get shorter by cancellation across other moves, and by commuting."""
    for spec in SCENES:
        at_distance = parallel = 0
        for seed in range(20):
            word = random_walk(spec, 20, seed)
            neighbours_cancelled: Word = []
            for action in word:
                if neighbours_cancelled and neighbours_cancelled[-1] == action:
                    neighbours_cancelled.pop()
                else:
                    neighbours_cancelled.append(action)
            heap = Heap()
            heap.extend(word)
            at_distance += heap.reduced_moves < len(neighbours_cancelled)
            parallel += heap.cubes < heap.reduced_moves
        assert at_distance >= 3, spec
        assert parallel >= 3, spec


class Search:
    """Exhaustive search among all cube paths, of a scene or, when there is none, of any letters."""

    def __init__(self, where: Scene | None, letters: Word) -> None:
        self.where = where
        self.letters = letters

    def cubes_at(self, state: State) -> list[tuple[Action, ...]]:
        possible = self.letters if self.where is None else actions_at(self.where, state)
        return commuting_sets(possible)

    def ball(self, word: Word, state: State, radius: int) -> set[ClassKey]:
        """Return the classes of all paths that go on from `word` by at most `radius` cubes."""
        found = {class_key(word)}
        border = [(word, state)]
        for _ in range(radius):
            outside: list[tuple[Word, State]] = []
            for path, here in border:
                for cube in self.cubes_at(here):
                    longer = reduced([*path, *cube])
                    key = class_key(longer)
                    if key not in found:
                        found.add(key)
                        there = here if self.where is None else end_state(cube, here)
                        outside.append((longer, there))
            border = outside
        return found

    def reaches(self, word: Word, start: State, end: State, cubes: int) -> bool:
        """Tell whether a path of at most `cubes` cubes is homotopic to the word.

        From both ends at once, for a cube path backwards is a cube path.
        """
        back = cubes // 2
        ahead = self.ball([], start, cubes - back)
        return not ahead.isdisjoint(self.ball(word, end, back))


@pytest.mark.slow
@given(st.data())
def test_no_cube_path_of_the_class_is_shorter(data: st.DataObject) -> None:
    """Among all cube paths in the letters, exhaustively, none of the class has fewer cubes."""
    letters = data.draw(alphabets(max_letters=4))
    word = data.draw(lists_of(st.sampled_from(letters), min_size=3, max_size=12))
    length = len(path_of(Heap, word))
    assume(0 < length <= 5)
    search = Search(None, letters)
    assert search.reaches(word, frozenset(), frozenset(), length)
    assert not search.reaches(word, frozenset(), frozenset(), length - 1)


@pytest.mark.few(5)
@pytest.mark.slow
@pytest.mark.parametrize("spec", SCENES)
@given(data=st.data())
@settings(max_examples=12)
def test_no_cube_path_of_a_system_is_shorter(spec: str, data: st.DataObject) -> None:
    """Among all admissible cube paths from start to end, exhaustively, none is shorter."""
    where = scene(spec)
    word = data.draw(walks(spec, min_size=3, max_size=8))
    end = end_state(word, where.start_state)
    length = len(path_of(Heap, word))
    assume(0 < length <= 4)
    search = Search(where, [])
    assert search.reaches(word, where.start_state, end, length)
    assert not search.reaches(word, where.start_state, end, length - 1)


def test_equal_moves_cancel_across_any_distance(make: Make) -> None:
    """A step back cancels the step out though a thousand moves of others came in between."""
    others = [edge(f"b{n}", f"b{n + 1}") for n in range(1000)]
    heap = make()
    heap.extend([edge("a0", "a1"), *others, edge("a0", "a1")])
    assert heap.reduced_moves == 1000
    assert heap.cube_path() == tuple((action,) for action in others)


def test_a_reader_between_keeps_two_equal_moves_apart(make: Make) -> None:
    """What only reads a site holds a writer there and back, but not other readers."""
    write, read, other = toggle("s"), toggle("a", reads=["s"]), toggle("b", reads=["s"])
    assert path_of(make, [write, read, write]) == ((write,), (read,), (write,))
    assert path_of(make, [read, other, read]) == ((other,),)
    assert path_of(make, [read, write, read]) == ((read,), (write,), (read,))


def test_the_empty_path_has_no_cubes(make: Make) -> None:
    """No moves, and a path that comes to nothing, are the path of no cubes."""
    heap = make()
    assert (heap.cubes, heap.max_cube_dimension, heap.cube_path()) == (0, 0, ())
    heap.extend([edge(0, 1), edge(0, 1)])
    assert (heap.moves, heap.cubes, heap.max_cube_dimension, heap.cube_path()) == (2, 0, 0, ())


def test_a_cube_stands_in_the_order_of_the_least_sites(make: Make) -> None:
    """Of the traces of its actions, whatever else they write or read, and whichever came first."""
    far, near, reader = edge(1, 9), edge(2, 3), toggle(4, reads=[0])
    for word in ([far, near, reader], [reader, near, far]):
        assert path_of(make, word) == ((far, near, reader),)


def test_equal_moves_keep_their_own_labels(make: Make) -> None:
    """Where equal actions come again under other ids, each cube shows the id that came there."""
    back = edge(1, 2)
    first, second = (Action([0, 1], [0, 1], [0], [1], label=label) for label in ("m1", "m3"))
    assert [cube[0].label for cube in path_of(make, [first, back, second])] == ["m1", "1-2", "m3"]


def test_a_writer_falls_past_readers_that_are_gone(make: Make) -> None:
    """Readers had levels 1, 2 and 3, the upper two are undone: the next writer has level 2."""
    one, two, three = (toggle(n, reads=["hub"]) for n in (1, 2, 3))
    below = [toggle(2), toggle(3), toggle(3, 13)]
    heap = make()
    heap.extend([*below, one, two, three, two, three, toggle("hub")])
    first, second, *_ = heap.cube_path()
    assert one in first
    assert toggle("hub") in second


@given(crowded_words())
@example([toggle(n, reads=["hub"]) for n in range(5)])
def test_an_emptied_heap_keeps_nothing(word: Word) -> None:
    """After a word and its reverse no site and no action is held any more."""
    heap = Heap()
    heap.extend([*word, *reversed(word)])
    assert heap.cubes == heap.reduced_moves == 0
    assert not heap._columns  # pyright: ignore[reportPrivateUsage]
    assert not heap._placed  # pyright: ignore[reportPrivateUsage]


@pytest.mark.slow
def test_memory_is_bounded_by_what_is_left() -> None:
    """Readers that come and go under a tall one leave no garbage, however often."""
    tower = [toggle("t"), toggle("t", "u")] * 50
    heap = Heap()
    heap.extend([*tower, toggle("t", reads=["hub"])])
    random = Random(1)  # noqa: S311 - nothing secret
    readers = [toggle(n, reads=["hub"]) for n in range(20)]
    heap.extend(random.choice(readers) for _ in range(1000))
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    heap.extend(random.choice(readers) for _ in range(20_000))
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert after - before < 50_000


def calls_of_one_append(before: int) -> int:
    """Return how many calls one append makes after `before` moves of others and one of its own."""
    last = edge("x", "y")
    heap = Heap()
    heap.append(last)
    heap.extend(edge(n, n + 1) for n in range(before))
    count = 0

    def tally(_frame: object, event: str, _argument: object) -> None:
        nonlocal count
        count += event in {"call", "c_call"}

    known = sys.getprofile()
    sys.setprofile(tally)
    heap.append(last)
    sys.setprofile(known)
    assert heap.reduced_moves == before
    return count


def test_a_move_costs_its_support_however_long_the_path() -> None:
    """The work of a move, a cancelling one included, does not grow with the path."""
    assert 0 < calls_of_one_append(10) == calls_of_one_append(10_000) < 50


_SHOW = """
from samples.strategies import toggle
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.normal_form.compiled_heap import FastHeap
word = [toggle("a", "z"), toggle("m", "b"), toggle("c", reads="zm"), toggle(("q", 1), "q")]
fast = FastHeap()
fast.extend(word * 3)
assert fast.cube_path() == normal_cube_path(word * 3)
print([[action.label for action in cube] for cube in fast.cube_path()])
"""


@pytest.mark.thorough
def test_processes_agree_on_the_order_in_each_cube() -> None:
    """Hashes of strings differ from process to process; what is returned does not."""
    shown = {
        subprocess.run(
            [sys.executable, "-c", _SHOW],
            env={
                **os.environ,
                "PYTHONHASHSEED": seed,
                "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
            },
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2", "3", "4")
    }
    assert len(shown) == 1
