"""The normal cube path of a path whose actions are numbers: all at once, or move by move.

It puts an interface that grows around the heap of pieces of
`cubepath.coordinator.normal_form.kernel`: you can add sites, actions and moves at any time.
Sources: as there.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.normal_form import kernel
from cubepath.coordinator.normal_form.kernel import Arrays, Numbers, Totals
from cubepath.protocol.core.errors import InputError

Levels = NDArray[np.int32]
_MOST = 2**31 - 1
_SPARE = 16


class ActionTable(NamedTuple):
    """Which sites each action writes and which it reads, in compressed rows.

    Action a has the trace ``trace_sites[trace_starts[a]:trace_starts[a + 1]]`` and reads the
    rest of its support, ``read_sites[read_starts[a]:read_starts[a + 1]]``. Sites are numbers from
    0; both starts have shape (actions + 1,) and begin with 0. All are int32.
    """

    trace_starts: Numbers
    trace_sites: Numbers
    read_starts: Numbers
    read_sites: Numbers


class NormalForm(NamedTuple):
    """What became of each move of a path, both of shape (moves,), int32.

    `levels` counts from 1: the moves of level i are the i-th cube. The level is 0 for a move that
    was cancelled, and then `partners` holds the place of the other move of the pair; otherwise -1.
    """

    levels: Levels
    partners: Numbers


class NumberedPieces(NamedTuple):
    """Pieces by level, and within a level by move; three arrays of equal length, int32."""

    levels: Levels
    actions: Numbers
    moves: Numbers


def normal_form(numbers: Numbers, table: ActionTable) -> NormalForm:
    """Return the level of every move in the normal cube path, and which moves cancel which.

    `numbers` are the actions of the moves in order, as rows of `table`, shape (moves,); equal
    actions must have equal numbers, since a move undoes its equal. Time is linear in the sites of
    the supports, up to the logarithm of the number of concurrent readers of a site. The space,
    apart from input and output, is given in `cubepath.coordinator.normal_form.kernel`: 52 bytes for
    a move that writes 2 sites and reads 6. InputError if the table is inconsistent or a number is
    not in it.

    >>> starts, sites = np.array([0, 2, 4], np.int32), np.array([0, 1, 2, 3], np.int32)
    >>> nobody = np.zeros(3, np.int32)
    >>> table = ActionTable(starts, sites, nobody, nobody[:0])
    >>> found = normal_form(np.array([0, 1, 0], np.int32), table)
    >>> found.levels.tolist(), found.partners.tolist()
    ([0, 1, 0], [2, -1, 0])
    """
    heap = NumberedHeap(table, telling=True)
    heap.append(numbers)
    return heap.normal_form()


class NumberedHeap:
    """A heap of pieces over numbered sites and actions, which may be added at any time.

    Space is that of the remaining pieces, the sites and the actions. With `telling` it keeps 8 more
    bytes for each move, to say what became of it.
    """

    def __init__(self, table: ActionTable | None = None, *, telling: bool = False) -> None:
        """Make an empty heap, `telling` for `normal_form`; InputError if the table is invalid."""
        self._heap = Arrays(
            columns=np.zeros((0, kernel.FIELDS), dtype=np.int32),
            actions=np.zeros((0, kernel.FIELDS), dtype=np.int32),
            sites=_numbers(0),
            slots=_numbers(0),
            pieces=_numbers(0),
            sizes=_numbers(0),
            totals=np.zeros(kernel.TOTALS, dtype=np.int64),
        )
        self._sites = 0
        self._actions = 0
        self._incidences = 0
        # What became of all moves, as the kernel writes it.
        self._fates = NormalForm(_NONE, _NONE) if telling else None
        if table is not None:
            self.add_actions(table)

    @property
    def moves(self) -> int:
        """Return the number of moves appended so far; O(1)."""
        return int(self._heap.totals[kernel.MOVES])

    @property
    def reduced_moves(self) -> int:
        """Return the number of moves that remain after cancellation."""
        return int(self._heap.totals[kernel.REDUCED])

    @property
    def cubes(self) -> int:
        """Return the length of the normal cube path."""
        return int(self._heap.totals[kernel.CUBES])

    @property
    def max_cube_dimension(self) -> int:
        """Return the greatest dimension of a cube, 0 if there is none; O(cubes)."""
        return int(self._heap.sizes[: self.cubes].max(initial=0))

    @property
    def nbytes(self) -> int:
        """Return the size of the arrays in bytes, used or not."""
        return sum(array.nbytes for array in self._heap)

    def add_actions(self, table: ActionTable) -> int:
        """Add actions, and the new sites in their supports; return the number of the first."""
        _check(table)
        count = len(table.trace_starts) - 1
        sizes = np.diff(table.trace_starts) + np.diff(table.read_starts)
        first, begin = self._actions, self._incidences
        stops = begin + np.cumsum(sizes, dtype=np.int64)
        end = int(stops[-1]) if count else begin
        if end > _MOST:
            raise InputError(f"{end} sites in the supports of all actions, expected {_MOST}")
        self._heap = self._heap._replace(
            actions=_longer(self._heap.actions, first + count), sites=_longer(self._heap.sites, end)
        )
        rows = self._heap.actions[first : first + count]
        rows[:] = 0
        rows[:, kernel.DOWN] = -1
        rows[:, kernel.STOP] = stops
        rows[:, kernel.FIRST] = stops - sizes
        rows[:, kernel.READS] = rows[:, kernel.FIRST] + np.diff(table.trace_starts)
        self._spread(table.trace_starts, table.trace_sites, rows[:, kernel.FIRST])
        self._spread(table.read_starts, table.read_sites, rows[:, kernel.READS])
        self._actions, self._incidences = first + count, end
        named = (table.trace_sites, table.read_sites)
        self._add_sites(1 + max((int(sites.max()) for sites in named if len(sites)), default=-1))
        return first

    def _spread(self, starts: Numbers, sites: Numbers, where: Numbers) -> None:
        places = np.arange(len(sites)) + np.repeat(where - starts[:-1], np.diff(starts))
        self._heap.sites[places] = sites

    def _add_sites(self, count: int) -> None:
        if count <= self._sites:
            return
        columns = _longer(self._heap.columns, count)
        columns[self._sites : count] = 0
        columns[self._sites : count, kernel.DOWN] = -1
        self._sites = count
        self._heap = self._heap._replace(columns=columns)

    def append(self, numbers: Numbers) -> None:
        """Append the moves with these action numbers, shape (moves,), int32.

        InputError if a number is not that of an action, or if any count exceeds 32 bits.
        """
        count = len(numbers)
        if count and not 0 <= int(numbers.min()) <= int(numbers.max()) < self._actions:
            raise InputError(f"a move with an action that is none of {self._actions}")
        if self.moves + count > _MOST:
            raise InputError(f"more than {_MOST} moves, expected at most that many in one heap")
        self._heap = self._heap._replace(sizes=_longer(self._heap.sizes, self.cubes + count))
        levels = partners = _NONE
        if self._fates is not None:
            size = self.moves + count
            self._fates = NormalForm(*(_longer(each, size) for each in self._fates))
            levels, partners = (each[:size] for each in self._fates)
        # Room for a large part of a path is reserved at once; otherwise full blocks are doubled.
        reserved = count >= max(self._sites + self._actions, self.reduced_moves)
        if reserved:
            self._reserve(numbers)
        each = 1 + self._incidences // max(self._actions, 1)
        append_moves = kernel.append_moves.for_work(count * each, by_entries=True)
        done = append_moves(self._heap, numbers, 0, reserved, levels, partners)
        while done < count:
            self._pack()
            done = append_moves(self._heap, numbers, done, False, levels, partners)

    def _reserve(self, numbers: Numbers) -> None:
        slots, pieces = _used(self._columns()), _used(self._rows())
        counts = np.bincount(numbers, minlength=self._actions)
        demand = kernel.demand.for_work(self._incidences, by_entries=True)
        demand(self._heap, counts, slots)
        self._lay_out(slots, pieces + kernel.PIECE * counts, spare=0)

    def _pack(self) -> None:
        """Lay all blocks side by side, none much larger than its use, with twice as much free."""
        slots, pieces = (
            np.minimum(blocks[:, kernel.END] - blocks[:, kernel.BASE], 2 * _used(blocks) + _SPARE)
            for blocks in (self._columns(), self._rows())
        )
        self._lay_out(slots, pieces, spare=2)

    def _lay_out(self, slots: Totals, pieces: Totals, *, spare: int) -> None:
        """Move all blocks to new pools; `spare` times their size is left free for larger blocks."""
        used = [int(sizes.sum()) for sizes in (slots, pieces)]
        lengths = [(1 + spare) * size + _SPARE * spare for size in used]
        if max(lengths) > _MOST:
            raise InputError(f"a path that takes {max(lengths)} entries, expected at most {_MOST}")
        # Untouched pages take no memory. The old columns are freed before the second pool is made.
        columns, rows = self._columns(), self._rows()
        steps = len(columns) + len(rows) + sum(used)
        pack = kernel.pack.for_work(steps, by_entries=True)
        pool = np.empty(lengths[0], dtype=np.int32)
        pack(columns, slots, self._heap.slots, pool, True)
        self._heap = self._heap._replace(slots=pool)
        pool = np.empty(lengths[1], dtype=np.int32)
        pack(rows, pieces, self._heap.pieces, pool, False)
        self._heap = self._heap._replace(pieces=pool)
        self._heap.totals[kernel.SLOTS_USED : kernel.PIECES_USED + 1] = used

    def _columns(self) -> Numbers:
        return self._heap.columns[: self._sites]

    def _rows(self) -> Numbers:
        return self._heap.actions[: self._actions]

    def pieces(self) -> NumberedPieces:
        """Return all pieces; O(pieces + actions), plus sorting them by level."""
        rows = self._rows()
        bases, ups = rows[:, kernel.BASE], rows[:, kernel.UP]
        counts = (ups - bases) // kernel.PIECE
        numbers = np.repeat(np.arange(len(rows), dtype=np.int32), counts)
        within = np.arange(len(numbers)) - np.repeat(np.cumsum(counts) - counts, counts)
        places = np.repeat(bases, counts) + kernel.PIECE * within
        found = self._heap.pieces
        return _in_order(found[places], numbers, found[places + 1])

    def normal_form(self) -> NormalForm:
        """Return what became of each move so far, in arrays that no further move changes.

        ValueError if the heap is not `telling`.
        """
        if self._fates is None:
            raise ValueError("the heap was not asked to record what becomes of all moves")
        levels, partners = (each[: self.moves] for each in self._fates)
        # The kernel marks the later move of a pair by a negative level; here both have level 0.
        return NormalForm(np.maximum(levels, 0), partners.copy())


_NONE = np.empty(0, dtype=np.int32)


def _numbers(size: int) -> Numbers:
    return np.zeros(size, dtype=np.int32)


def _longer(array: Numbers, size: int) -> Numbers:
    """Return an array of at least this many rows that begins with this one; the rest is 0."""
    if size <= len(array):
        return array
    # The first time exactly as long as needed, since it often never grows again.
    length = size if len(array) <= 1 else max(size, 2 * len(array))
    found = np.zeros((length, *array.shape[1:]), dtype=array.dtype)
    found[: len(array)] = array
    return found


def _used(blocks: Numbers) -> Totals:
    """Return the number of slots of each block that are in use."""
    below = blocks[:, kernel.UP] - blocks[:, kernel.BASE]
    above = blocks[:, kernel.END] - 1 - blocks[:, kernel.DOWN]
    return (below + above).astype(np.int64)


def _in_order(levels: Levels, actions: Numbers, moves: Numbers) -> NumberedPieces:
    order = np.lexsort((moves, levels))
    return NumberedPieces(levels[order], actions[order], moves[order])


def _check(table: ActionTable) -> None:
    if len(table.trace_starts) != len(table.read_starts):
        raise InputError(
            f"{len(table.trace_starts) - 1} actions with a trace and"
            f" {len(table.read_starts) - 1} that read, expected as many"
        )
    for what, starts, sites in (
        ("trace", table.trace_starts, table.trace_sites),
        ("read", table.read_starts, table.read_sites),
    ):
        if not len(starts) or starts[0] != 0 or starts[-1] != len(sites):
            raise InputError(f"{what} starts that do not go from 0 to {len(sites)}")
        if (np.diff(starts) < (what == "trace")).any():
            raise InputError(f"{what} starts that do not rise")
        if len(sites) and sites.min() < 0:
            raise InputError(f"a {what} site with the number {sites.min()}, expected 0 or more")
