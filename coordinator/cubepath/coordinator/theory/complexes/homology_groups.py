"""Homology of a cubical complex over Z, with its torsion, and over Z/2: exact, for large complexes.

Two steps, both exact; the first keeps the complex up to chain homotopy equivalence over Z:

1. *Discrete Morse matching by coreductions* on sparse arrays; then again on the Morse complex, as
   long as it shrinks. A cell that has just one face left, with incidence 1 or -1, is removed
   together with that face. If there is no such cell, a cell without faces is removed as critical;
   it is chosen at the border of the removed cells, which leaves few critical cells and short paths
   between them. Linear in the number of incidences, apart from following these paths.
   Sources: Mrozek and Batko, *Coreduction homology algorithm* (2009); Forman, *Morse theory for
   cell complexes* (1998); Skoeldberg, *Morse theory from an algebraic viewpoint* (2006); Harker,
   Mischaikow, Mrozek and Nanda, *Discrete Morse theoretic algorithms for computing homology of
   complexes and maps* (2014).
2. *Smith forms* of the rest, which is small (Hatcher, *Algebraic topology*, section 2.2, for how to
   read homology off them).

The boundary of the Morse complex flows from each critical cell along the matching: a face that is
matched with a greater cell is replaced by the rest of that cell's boundary, one that is matched
with a smaller cell is dropped, and a critical face is reached. Paths only go back in the time of
the matching, so the latest face comes first and each is replaced once.

A cube that is glued to itself may have a face with incidence 0, 2 or -2: a face counts with the sum
of its incidences, and only a face with incidence 1 or -1 is ever matched.
"""

from collections.abc import Callable
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import combinations, pairwise
from math import gcd, lcm
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.complexes.cubical_complex import (
    Boundary,
    CellRows,
    Cells,
    CubicalComplex,
    Numbers,
    boundary_of,
    cofaces,
)
from cubepath.protocol.compiled import compiled


class Matching(NamedTuple):
    """What was removed at each time: a pair of a face and a greater cell, or a critical cell twice.

    unit: the incidence of a pair, 1 or -1. All have shape (times,).

    When a pair is removed, all other faces of its greater cell are gone already. So paths along the
    matching only go back in time, and the matching is acyclic.
    """

    face: Cells
    cell: Cells
    unit: NDArray[np.int8]


def matched(boundary: Boundary, above: CellRows) -> Matching:
    """Match the cells with this boundary; `above` holds the cofaces of every cell."""
    work = 8 * (len(boundary.start) + len(boundary.face))
    return _matched.for_work(work)(boundary, above)


class _Front(NamedTuple):
    """The working state of a matching: what is gone, the faces left of each cell, and two queues.

    rest: the number of faces left of each cell, and the exclusive or of their numbers, so that the
    last of them is known without a search. A cell enters queue[k - 1] when it has k faces left, k =
    1 or 2, so at most once. The waiting cells are those from place ends[k - 1, 0] up to, not
    including, ends[k - 1, 1]. Shapes: (cells,), (cells, 2), (2, cells), (2, 2).
    """

    gone: NDArray[np.bool_]
    rest: Cells
    queue: Cells
    ends: Numbers


@compiled
def _matched(boundary: Boundary, above: CellRows) -> Matching:
    """Match by coreductions: a cell with one face left and this face; otherwise a critical cell.

    `above` holds the cofaces of every cell.
    """
    cells = len(boundary.start) - 1
    gone, rest = np.zeros(cells, np.bool_), np.zeros((cells, 2), np.int32)
    front = _Front(gone, rest, np.empty((2, cells), np.int32), np.zeros((2, 2), np.int64))
    _begin(boundary, front)
    faces, with_them = np.empty(cells, np.int32), np.empty(cells, np.int32)
    unit = np.empty(cells, np.int8)
    now, lowest = 0, 0
    while True:
        face, cell, value = _coreduction(boundary, front)
        if face < 0:
            face = _critical(boundary, front)
        if face < 0:
            while lowest < cells and gone[lowest]:
                lowest += 1
            if lowest == cells:
                return Matching(faces[:now], with_them[:now], unit[:now])
            face = lowest
        _take_away(face, above, front)
        if cell >= 0:
            _take_away(cell, above, front)
        faces[now], with_them[now], unit[now] = face, max(face, cell), value
        now += 1


@compiled
def _begin(boundary: Boundary, front: _Front) -> None:
    """Count the faces of all cells, and queue those with one."""
    for cell in range(len(front.rest)):
        for i in range(boundary.start[cell], boundary.start[cell + 1]):
            front.rest[cell, 0] += 1
            front.rest[cell, 1] ^= boundary.face[i]
        if front.rest[cell, 0] == 1:
            _wait(cell, front)


@compiled
def _coreduction(boundary: Boundary, front: _Front) -> tuple[int, int, int]:
    """Return the next face and cell to match, and their incidence; -1, -1, 0 if there are none."""
    while front.ends[0, 0] < front.ends[0, 1]:
        cell = front.queue[0, front.ends[0, 0]]
        front.ends[0, 0] += 1
        if not front.gone[cell] and front.rest[cell, 0] == 1:
            face = front.rest[cell, 1]
            i = boundary.start[cell]
            while boundary.face[i] != face:
                i += 1
            if abs(boundary.value[i]) == 1:
                return int(face), int(cell), int(boundary.value[i])
    return -1, -1, 0


@compiled
def _critical(boundary: Boundary, front: _Front) -> int:
    """Return a cell without faces whose removal leaves a coface with one face; -1 if none waits.

    The coface is the one that has waited longest.
    """
    while front.ends[1, 0] < front.ends[1, 1]:
        cell = front.queue[1, front.ends[1, 0]]
        front.ends[1, 0] += 1
        if not front.gone[cell] and front.rest[cell, 0] == 2:
            for i in range(boundary.start[cell], boundary.start[cell + 1]):
                face = boundary.face[i]
                if not front.gone[face] and front.rest[face, 0] == 0:
                    return int(face)
    return -1


@compiled
def _take_away(cell: int, above: CellRows, front: _Front) -> None:
    """Remove the cell from those left, and queue its cofaces with one or two faces left."""
    front.gone[cell] = True
    for i in range(above.start[cell], above.start[cell + 1]):
        coface = int(above.cell[i])
        left = front.rest[coface, 0] - 1
        front.rest[coface, 0] = left
        front.rest[coface, 1] ^= cell
        if 1 <= left <= 2 and not front.gone[coface]:
            _wait(coface, front)


@compiled
def _wait(cell: int, front: _Front) -> None:
    """Put the cell into the queue of cells with the same number of faces left."""
    which = front.rest[cell, 0] - 1
    front.queue[which, front.ends[which, 1]] = cell
    front.ends[which, 1] += 1


Column: TypeAlias = dict[int, int]

_DROPPED = -(2**31)


class MorsePaths(NamedTuple):
    """What each row is replaced by: value[i] times node[i], over start[row] <= i < start[row + 1].

    There is a row for each critical cell and for each pair that is reached from one, the last that
    was removed first. A node is the row of a pair, always a later one, or -1 - c for the critical
    cell c. critical: the row of each critical cell.
    """

    start: Numbers
    node: Cells
    value: Cells
    critical: Numbers


class _Flow(NamedTuple):
    """The working state of one column: coefficients of rows, which of them wait, and what it found.

    total: the coefficient of each row. waiting: whether a row has one. column: the coefficients of
    critical cells; seen: whether they were reached; reached: those that were, in that order.
    """

    total: Numbers
    waiting: NDArray[np.bool_]
    column: Numbers
    seen: NDArray[np.bool_]
    reached: Cells


def paths_along(boundary: Boundary, matching: Matching) -> MorsePaths:
    """Return the paths along a matching; its critical cells are numbered in ascending order."""
    times = np.flatnonzero(matching.face == matching.cell)
    times = times[np.argsort(matching.face[times])]
    written = _written.for_work(8 * (len(boundary.start) + len(boundary.face)))
    return written(boundary, matching, len(matching.face) - 1 - times)


def morse_columns(paths: MorsePaths, limit: int) -> list[Column] | None:
    """Return the Morse boundary of every critical cell, as coefficients by critical cell.

    None if a coefficient exceeds the limit.
    """
    rows, critical = len(paths.start) - 1, len(paths.critical)
    run = _flow.for_work(100 * critical)
    column, seen = np.zeros(critical, np.int64), np.zeros(critical, np.bool_)
    reached = np.empty(critical, np.int32)
    flow = _Flow(np.zeros(rows, np.int64), np.zeros(rows, np.bool_), column, seen, reached)
    columns: list[Column] = []
    for row in paths.critical.tolist():
        found = run(row, paths, flow, limit)
        if found < 0:
            return None
        here = reached[:found]
        columns.append(
            {f: c for f, c in zip(here.tolist(), column[here].tolist(), strict=True) if c}
        )
        column[here], seen[here] = 0, False
    return columns


@compiled
def _written(boundary: Boundary, matching: Matching, critical: Numbers) -> MorsePaths:
    """Write the rows that can be reached; `critical` holds those of critical cells among all."""
    rows = len(matching.face)
    node_of = np.full(len(boundary.start) - 1, _DROPPED, np.int32)
    for row in range(rows):
        node_of[matching.face[rows - 1 - row]] = row
    reached, number = np.zeros(rows, np.bool_), np.empty(rows, np.int32)
    for place in range(len(critical)):
        reached[critical[place]] = True
        node_of[matching.face[rows - 1 - critical[place]]] = -1 - place
    start = np.zeros(rows + 1, np.int64)
    # More than enough; what is not written to takes no memory.
    room = len(boundary.face)
    node, value = np.empty(room, np.int32), np.empty(room, np.int32)
    used, kept = 0, 0
    for row in range(rows):
        if not reached[row]:
            continue
        time = rows - 1 - row
        cell = matching.cell[time]
        # The incidence of a pair is its own inverse.
        sign = 1 if cell == matching.face[time] else -int(matching.unit[time])
        for i in range(boundary.start[cell], boundary.start[cell + 1]):
            further = node_of[boundary.face[i]]
            if further not in (_DROPPED, row):
                node[used], value[used] = further, sign * boundary.value[i]
                used += 1
                if further >= 0:
                    reached[further] = True
        number[row] = kept
        kept += 1
        start[kept] = used
    return _renumbered(MorsePaths(start[: kept + 1], node[:used], value[:used], critical), number)


@compiled
def _renumbered(paths: MorsePaths, number: Cells) -> MorsePaths:
    """Give the rows other numbers, in place."""
    for i in range(len(paths.node)):
        if paths.node[i] >= 0:
            paths.node[i] = number[paths.node[i]]
    for place in range(len(paths.critical)):
        paths.critical[place] = number[paths.critical[place]]
    return paths


@compiled
def _flow(row: int, paths: MorsePaths, flow: _Flow, limit: int) -> int:
    """Write the column of the critical cell with this row; return how many it reaches.

    Before the call, no row waits, and all coefficients are 0; after it, only those of the reached
    cells differ from that. Return -1 if a coefficient exceeds the limit.
    """
    factor, found = 1, 0
    ahead = [row]  # the rows that wait, the first on top
    ahead.pop()
    while True:
        for i in range(paths.start[row], paths.start[row + 1]):
            node, change = np.int64(paths.node[i]), factor * paths.value[i]
            if node >= 0:
                flow.total[node] += change
                size = abs(flow.total[node])
                if not flow.waiting[node]:
                    flow.waiting[node] = True
                    heappush(ahead, int(node))
            else:
                cell = -1 - node
                flow.column[cell] += change
                size = abs(flow.column[cell])
                if not flow.seen[cell]:
                    flow.seen[cell] = True
                    flow.reached[found] = cell
                    found += 1
            if size > limit:
                return -1
        factor = 0
        while factor == 0:
            if len(ahead) == 0:
                return found
            row = heappop(ahead)
            factor = flow.total[row]
            flow.total[row], flow.waiting[row] = 0, False


Progress = Callable[[int], None]

LIMIT = 2**30
"""Coefficients up to this are kept in 32 bits, and multiplied and added in 64.

A Morse complex with greater ones is not used: linear algebra takes the one before it.
"""


@dataclass(frozen=True, slots=True)
class Homology:
    """The homology groups H_0, ..., H_d of a complex of dimension d; all tuples have length d + 1.

    H_k is Z^betti[k] plus the sum of the Z/t for t in torsion[k]; these are the invariant factors
    greater than 1, each dividing the next. The dimension of H_k with coefficients in Z/2 is
    betti_z2[k]. critical[k] is how many k-cells the Morse matching left to linear algebra: a
    measure of the work, not an invariant of the space.
    """

    betti: tuple[int, ...]
    torsion: tuple[tuple[int, ...], ...]
    betti_z2: tuple[int, ...]
    critical: tuple[int, ...]

    @property
    def acyclic(self) -> bool:
        """Return whether this is the homology of a point."""
        return self.betti[:1] == (1,) and not any(self.betti[1:]) and not any(self.torsion)


def homology(complex_: CubicalComplex, progress: Progress | None = None) -> Homology:
    """Return the homology of the complex; the empty complex has empty tuples.

    `progress` is called with numbers of processed cells, which add up to the number of cells. The
    same complex gives the same result with the same critical cells. Memory, apart from the complex:
    about 20 bytes for each face of each cube, and 60 for each cube.

    >>> ring = state_complex(explore(scene_from_spec("agv:graph=C4,n=1"))).complex
    >>> found = homology(ring)
    >>> found.betti, found.acyclic
    ((1, 1), False)
    """
    told: Progress = progress or (lambda _cells: None)
    counts = np.array(complex_.f_vector, np.int64)
    dimension = np.repeat(np.arange(len(counts), dtype=np.int8), counts)
    boundary = boundary_of(complex_)
    while True:
        matching = matched(boundary, cofaces(CellRows(boundary.start, boundary.face)))
        critical = np.sort(matching.face[matching.face == matching.cell])
        if len(critical) == len(dimension):
            break
        columns = morse_columns(paths_along(boundary, matching), LIMIT)
        if columns is None:
            break
        told(len(dimension) - len(critical))
        dimension, boundary = dimension[critical], _boundary(columns)
    found = _by_linear_algebra(_columns(boundary), dimension, complex_.dimension)
    told(len(dimension))
    return found


def _columns(boundary: Boundary) -> list[Column]:
    """Return the boundary of every cell as coefficients by face."""
    face, value = boundary.face.tolist(), boundary.value.tolist()
    return [
        dict(zip(face[begin:end], value[begin:end], strict=True))
        for begin, end in pairwise(boundary.start.tolist())
    ]


def _boundary(columns: list[Column]) -> Boundary:
    """Return the boundary of a chain complex with these columns."""
    start = np.zeros(len(columns) + 1, np.int64)
    np.cumsum([len(column) for column in columns], out=start[1:])
    face = np.array([number for column in columns for number in column], np.int32)
    value = np.array([number for column in columns for number in column.values()], np.int32)
    return Boundary(start, face, value)


def _by_linear_algebra(
    columns: list[Column], dimension: NDArray[np.int8], highest: int
) -> Homology:
    """Return the homology of a chain complex given by the columns of its boundary."""
    cells: list[list[int]] = [[] for _ in range(highest + 1)]
    for cell, k in enumerate(dimension.tolist()):
        cells[k].append(cell)
    # Ranks of the boundary from dimension k; it is 0 from dimensions 0 and highest + 1.
    ranks, ranks_z2 = [0] * (highest + 2), [0] * (highest + 2)
    torsion: list[tuple[int, ...]] = [()] * (highest + 1)
    for k in range(1, highest + 1):
        factors, ranks_z2[k] = _smith(columns, cells[k])
        ranks[k] = len(factors)
        torsion[k - 1] = tuple(factor for factor in factors if factor > 1)
    counts = [len(found) for found in cells]
    return Homology(
        betti=tuple(counts[k] - ranks[k] - ranks[k + 1] for k in range(highest + 1)),
        torsion=tuple(torsion),
        betti_z2=tuple(counts[k] - ranks_z2[k] - ranks_z2[k + 1] for k in range(highest + 1)),
        critical=tuple(counts),
    )


def _smith(columns: list[Column], cells: list[int]) -> tuple[list[int], int]:
    """Return the invariant factors of the matrix of these columns, and its rank modulo 2.

    The least entry left is the pivot, and all others of its row and its column are divided by it
    with remainders. A remainder is less, and the next pivot; without any, the pivot is alone. What
    matching leaves is seldom more than a few columns.
    """
    left = [dict(columns[cell]) for cell in cells]
    factors: list[int] = []
    while left := [column for column in left if column]:
        column, row = min(
            ((column, row) for column in left for row in column), key=lambda at: abs(at[0][at[1]])
        )
        pivot = column[row]
        others = [other for other in left if row in other and other is not column]
        for other in others:
            _subtract(other, other[row] // pivot, column)
        if any(row in other for other in others):
            continue
        # The row is 0 elsewhere, so that it can be subtracted from others without changing more.
        remainders = {each: value % pivot for each, value in column.items() if value % pivot}
        column.clear()
        if remainders:
            column |= remainders | {row: pivot}
        else:
            factors.append(abs(pivot))
    factors.sort()
    for first, second in combinations(range(factors.count(1), len(factors)), 2):
        pair = factors[first], factors[second]
        factors[first], factors[second] = gcd(*pair), lcm(*pair)
    return factors, sum(factor % 2 for factor in factors)


def _subtract(column: Column, factor: int, other: Column) -> None:
    """Subtract a multiple of another column."""
    for row, value in other.items():
        column[row] = column.get(row, 0) - factor * value
        if not column[row]:
            del column[row]
