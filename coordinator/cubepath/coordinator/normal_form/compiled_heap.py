"""The normal cube path of moves as they arrive, compiled; used for live runs and for files.

`FastHeap` has the interface of the reference, `cubepath.coordinator.normal_form.heap.Heap`, and
numbers sites and actions for `cubepath.coordinator.normal_form.array_heap`. Sources: as there.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.normal_form import array_heap
from cubepath.coordinator.normal_form.kernel import Numbers
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.sites import Ordinals, Site, in_order
from cubepath.protocol.path_files.numbered import NumberedCubes, NumberedPath, number_actions
from cubepath.protocol.path_files.supports import TRACE

_QUEUE = 4096


class Numbering:
    """Numbers sites and actions in the order in which they are met; equal ones share a number."""

    def __init__(self, actions: Iterable[Action] = ()) -> None:
        """Begin with these actions, which must be distinct."""
        self.actions: list[Action] = list(actions)
        self._number = {action: number for number, action in enumerate(self.actions)}
        self._sites = Ordinals[Site]()
        self._done = 0

    def number(self, action: Action) -> int:
        """Return the number of an action."""
        found = self._number.get(action)
        if found is None:
            found = self._number[action] = len(self.actions)
            self.actions.append(action)
        return found

    def table(self) -> array_heap.ActionTable | None:
        """Return the rows of the actions met since the last call, None if there are none.

        The numbers of sites do not affect any visible result.
        """
        actions, self._done = self.actions[self._done :], len(self.actions)
        if not actions:
            return None
        sites = self._sites
        rows = [
            [[sites[site] for site in part] for part in parts]
            for parts in ((each.trace for each in actions), (each.reads for each in actions))
        ]
        return array_heap.ActionTable(*_rows(rows[0]), *_rows(rows[1]))


def _rows(lists: Sequence[Sequence[int]]) -> tuple[Numbers, Numbers]:
    starts = np.zeros(len(lists) + 1, dtype=np.int32)
    np.cumsum([len(found) for found in lists], out=starts[1:])
    return starts, np.array([site for found in lists for site in found], dtype=np.int32)


class PathCounter:
    """Counts of many paths of the same actions, which are numbered once for all of them."""

    def __init__(self, actions: Iterable[Action]) -> None:
        """Take the actions that the numbers of moves mean; equal ones may stand there twice."""
        numbering = Numbering()
        self._numbers = np.array([numbering.number(action) for action in actions], dtype=np.int32)
        self._table = numbering.table()

    def count(self, moves: NDArray[np.int64]) -> array_heap.NumberedHeap:
        """Return the heap of a path, given by the numbers of its moves, shape (moves,).

        >>> step, far = Action([1, 2], [1, 2], [1], [2]), Action([5, 6], [5, 6], [5], [6])
        >>> PathCounter([step, far]).count(np.array([0, 1, 0])).reduced_moves
        1
        """
        heap = array_heap.NumberedHeap(self._table)
        heap.append(self._numbers[moves])
        return heap


def cancellations(actions: Iterable[Action]) -> array_heap.NormalForm:
    """Return what becomes of each move of an edge path; see `NormalForm`.

    >>> step, far = Action([1, 2], [1, 2], [1], [2]), Action([5, 6], [5, 6], [5], [6])
    >>> cancellations([step, far, step]).levels.tolist()
    [0, 1, 0]
    """
    return normal_form_of(number_actions(actions))


def normal_form_of(path: NumberedPath) -> array_heap.NormalForm:
    """Return what becomes of each move of a path; see `NormalForm`."""
    written, read = path.supports.part(TRACE, TRACE), path.supports.part(TRACE, 0)
    return array_heap.normal_form(path.numbers, array_heap.ActionTable(*written, *read))


def cubes_of(found: array_heap.NormalForm, path: NumberedPath) -> NumberedCubes:
    """Return the remaining moves of a path, cube by cube; see `in_cubes`."""
    numbers, supports = path.numbers, path.supports
    left = np.flatnonzero(found.levels)
    pieces = array_heap.NumberedPieces(found.levels[left], numbers[left], left.astype(np.int32))
    begins, sites = supports.part(TRACE, TRACE)
    least = np.minimum.reduceat(supports.order[sites], begins[:-1]) if len(sites) else _NO_RANKS
    ordered, starts = _in_cubes(pieces, least)
    return NumberedCubes(starts, ordered.moves.astype(np.int64))


def in_cubes(
    pieces: array_heap.NumberedPieces, actions: Sequence[Action]
) -> tuple[array_heap.NumberedPieces, NDArray[np.int64]]:
    """Return the pieces cube by cube, and where each cube begins, shape (cubes + 1,).

    Within a cube they are in the canonical order of the least sites of their traces. The traces are
    disjoint, so the order depends only on the content of the cube, not on the input or the process.
    """
    present = np.unique(pieces.actions)
    least = [in_order(actions[number].trace)[0] for number in present.tolist()]
    rank = {site: place for place, site in enumerate(in_order(set(least)))}
    found = np.zeros(len(actions), dtype=np.int64)
    found[present] = [rank[site] for site in least]
    return _in_cubes(pieces, found)


_NO_RANKS = np.zeros(0, dtype=np.int64)


def _in_cubes(
    pieces: array_heap.NumberedPieces, least: NDArray[np.int64]
) -> tuple[array_heap.NumberedPieces, NDArray[np.int64]]:
    """Do what `in_cubes` does; `least` has for each action the rank of the least traced site."""
    order = np.lexsort((least[pieces.actions], pieces.levels))
    starts = np.cumsum(np.bincount(pieces.levels, minlength=1), dtype=np.int64)
    return array_heap.NumberedPieces(*(part[order] for part in pieces)), starts


class FastHeap:
    """A heap of pieces, compiled: each move falls until a piece that it does not commute with.

    `cubepath.coordinator.normal_form.heap.Heap` gives the same answers; its docstring defines the
    heap, and shows why cancellation needs no search. New sites and actions may come at any time.
    Moves wait in a short queue until a result is asked for, since a call into compiled code costs
    as much as some tens of moves; the same code runs in plain Python until there are enough moves
    for compiling to pay. Space is that of the remaining pieces, of the distinct actions met, and of
    the moves that are equal to one of these, but have another label.

    >>> step = Action([1, 2], [1, 2], [1], [2])
    >>> far = Action([5, 6], [5, 6], [5], [6])
    >>> heap = FastHeap()
    >>> heap.extend([step, far])
    >>> heap.moves, heap.reduced_moves, heap.cubes
    (2, 2, 1)
    >>> heap.append(step)
    >>> heap.cube_path() == ((far,),)
    True
    """

    __slots__ = ("_heap", "_labelled", "_numbering", "_queue")

    def __init__(self, *, telling: bool = False) -> None:
        """Make an empty heap, the path without moves; `telling` for `normal_form`."""
        self._heap = array_heap.NumberedHeap(telling=telling)
        self._numbering = Numbering()
        self._queue: list[int] = []
        # The moves whose label differs from that of the first equal action.
        self._labelled: dict[int, Action] = {}

    @property
    def moves(self) -> int:
        """Return the number of moves appended so far; O(1)."""
        return self._heap.moves + len(self._queue)

    @property
    def reduced_moves(self) -> int:
        """Return the number of moves that remain after cancellation."""
        return self._all().reduced_moves

    @property
    def cubes(self) -> int:
        """Return the length of the normal cube path, which is its number of cubes and its time."""
        return self._all().cubes

    @property
    def max_cube_dimension(self) -> int:
        """Return the greatest dimension of a cube, 0 if there is none; O(cubes)."""
        return self._all().max_cube_dimension

    def append(self, action: Action) -> None:
        """Add one move to the end of the edge path; its cost is that of its support."""
        number = self._numbering.number(action)
        known = self._numbering.actions[number]
        if known is not action and known.label != action.label:
            self._labelled[self.moves] = action
        self._queue.append(number)
        if len(self._queue) >= _QUEUE:
            self._all()

    def extend(self, actions: Iterable[Action]) -> None:
        """Append the moves in order."""
        for action in actions:
            self.append(action)

    def cube_path(self) -> tuple[tuple[Action, ...], ...]:
        """Return the normal cube path; O(remaining moves), plus sorting the distinct actions.

        The actions of a cube are in the canonical order of the least sites of their traces: the
        order depends only on the content of the cube, not on the input or the process.
        """
        return tuple(self.each_cube())

    def each_cube(self) -> Iterator[tuple[Action, ...]]:
        """Yield the cubes of `cube_path` one by one, so that there need not be room for all."""
        actions, labelled = self._numbering.actions, self._labelled
        pieces, starts = in_cubes(self._all().pieces(), actions)
        for begin, end in pairwise(starts.tolist()):
            cube = zip(
                pieces.actions[begin:end].tolist(), pieces.moves[begin:end].tolist(), strict=True
            )
            yield tuple([labelled.get(move) or actions[number] for number, move in cube])

    def normal_form(self) -> array_heap.NormalForm:
        """Return what became of each move so far; ValueError if the heap is not `telling`.

        >>> heap, step = FastHeap(telling=True), Action([1, 2], [1, 2], [1], [2])
        >>> heap.extend([step] * 3)
        >>> heap.normal_form().levels.tolist(), heap.normal_form().partners.tolist()
        ([0, 0, 1], [1, 0, -1])
        """
        return self._all().normal_form()

    def _all(self) -> array_heap.NumberedHeap:
        """Return the heap with all moves in it."""
        heap, queue = self._heap, self._queue
        if not queue:
            return heap
        table = self._numbering.table()
        if table is not None:
            heap.add_actions(table)
        heap.append(np.array(queue, dtype=np.int32))
        queue.clear()
        return heap
