"""Homology of a cubical complex over Z, with its torsion, and over Z/2: exact, for large complexes.

Three steps, each exact, each keeping the complex up to chain homotopy equivalence over Z:

1. *Discrete Morse matching by coreductions* on sparse arrays, compiled; then again on the remaining
   complex, as long as it shrinks. A cell that has just one face left, with incidence 1 or -1, is
   removed together with that face. If there is no such cell, a cell without faces is removed as
   critical. It is chosen at the border of the removed cells, which leaves few critical cells and
   short paths between them. Linear in the number of incidences, apart from following these paths.
   Sources: Mrozek and Batko, *Coreduction homology algorithm* (2009); Forman, *Morse theory for
   cell complexes* (1998); Skoeldberg, *Morse theory from an algebraic viewpoint* (2006); Harker,
   Mischaikow, Mrozek and Nanda, *Discrete Morse theoretic algorithms for computing homology of
   complexes and maps* (2014).
2. *Elimination of unit pivots* in the remaining complex, with Python's integers.
3. *Smith forms and ranks* by python-flint of the rest, which has no unit entries (Hatcher,
   *Algebraic topology*, section 2.2, for how to read homology off them).

A cube that is glued to itself may have a face with incidence 0, 2 or -2: a face counts with the sum
of its incidences, and only a face with incidence 1 or -1 is ever matched.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from itertools import pairwise
from typing import NamedTuple, cast

import numpy as np
from flint import fmpz_mat, nmod_mat
from numpy.typing import NDArray

from cubepath.coordinator.complexes.cubical_complex import CubicalComplex
from cubepath.coordinator.complexes.incidence import Cells, Numbers, Rows, cofaces, incidence
from cubepath.protocol.compiled import compiled

Progress = Callable[[int], None]
Column = dict[int, int]

LIMIT = 2**30
"""Coefficients up to this are multiplied and added in 64 bits; beyond it, as Python's integers."""


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
    """
    chains = _chains_of(complex_)
    while True:
        left = chains.count
        chains, columns = _reduced(chains)
        if progress is not None:
            progress(left - chains.count)
        if columns is not None:
            break
    found = _by_linear_algebra(columns, chains.dimension, complex_.dimension)
    if progress is not None:
        progress(chains.count)
    return found


class _Boundary(NamedTuple):
    """The boundary of a cell c: value[i] times the cell face[i], over start[c] <= i < start[c + 1].

    No value is 0, and no face occurs twice.
    """

    start: Numbers
    face: Cells
    value: Numbers


class _Matching(NamedTuple):
    """An acyclic matching of cells with faces of theirs, all arrays of shape (cells,) but `motion`.

    partner: the partner of every cell, -1 if the cell is critical. time: when the cell was removed;
    a pair has one time. motion: the cell that was removed at each time, for a pair the face; shape
    (times,). unit: the incidence of a pair, 1 or -1, stored at its face.

    When a pair is removed, all other faces of its greater cell are gone already. So paths along the
    matching only go back in time, and the matching is acyclic.
    """

    partner: Cells
    time: Cells
    motion: Cells
    unit: NDArray[np.int8]


class _Front(NamedTuple):
    """The working state of a matching: the number of faces left of each cell, and two queues.

    A cell enters queue[k - 1] when it has k faces left, k = 1 or 2, so at most once. The waiting
    cells are those from place ends[k - 1, 0] up to, not including, ends[k - 1, 1]. Shapes:
    (cells,), (2, cells), (2, 2).
    """

    left: Cells
    queue: Cells
    ends: Numbers


class _Flow(NamedTuple):
    """The arrays for a Morse boundary: coefficients of all cells, and the critical cells reached.

    total: the coefficients, as 64-bit integers, or as Python's integers if 64 bits are too few.
    seen: whether a cell has a total. reached: the critical cells in the order in which they were
    reached.
    """

    total: Numbers
    seen: NDArray[np.bool_]
    reached: Cells


@dataclass(frozen=True, slots=True, eq=False)
class _Chains:
    """A free chain complex with a basis of cells, numbered by ascending dimension."""

    dimension: NDArray[np.int8]
    boundary: _Boundary

    @property
    def count(self) -> int:
        """Return the number of cells."""
        return len(self.dimension)


def _chains_of(complex_: CubicalComplex) -> _Chains:
    """Return the cubical chain complex: incidences of the same face are added, zeros omitted."""
    cells = incidence(complex_)
    dimension = np.repeat(
        np.arange(len(complex_.faces), dtype=np.int8), np.array(complex_.f_vector, np.int64)
    )
    summed = _summed.for_work(4 * len(cells.faces.cell))
    return _Chains(dimension, summed(cells.faces, cells.sign))


@compiled
def _summed(faces: Rows, sign: NDArray[np.int8]) -> _Boundary:
    """Return the boundaries with each face once."""
    start, face = np.zeros_like(faces.start), np.empty_like(faces.cell)
    value, used = np.empty(len(face), np.int64), 0
    for cell in range(len(start) - 1):
        begin = used
        for i in range(faces.start[cell], faces.start[cell + 1]):
            place = begin
            while place < used and face[place] != faces.cell[i]:
                place += 1
            if place == used:
                face[used], value[used] = faces.cell[i], 0
                used += 1
            value[place] += sign[i]
        kept = begin
        for place in range(begin, used):
            if value[place] != 0:
                face[kept], value[kept] = face[place], value[place]
                kept += 1
        used = kept
        start[cell + 1] = used
    return _Boundary(start, face[:used], value[:used])


@compiled
def _matched(boundary: _Boundary, above: Rows) -> _Matching:
    """Match by coreductions: a cell with one face left and this face; otherwise a critical cell.

    `above` holds the cofaces of every cell.
    """
    start, cells = boundary.start, len(boundary.start) - 1
    partner, time = np.full(cells, -1, np.int32), np.full(cells, -1, np.int32)
    motion, unit = np.empty(cells, np.int32), np.zeros(cells, np.int8)
    now, lowest = 0, 0
    left = (start[1:] - start[:-1]).astype(np.int32)
    front = _Front(left, np.empty((2, cells), np.int32), np.zeros((2, 2), np.int64))
    for cell in range(cells):
        if left[cell] == 1:
            _wait(cell, front)
    while True:
        face, cell, value = _coreduction(boundary, time, front)
        if face < 0:
            face = _critical(boundary, time, front)
        if face < 0:
            while lowest < cells and time[lowest] >= 0:
                lowest += 1
            if lowest == cells:
                return _Matching(partner, time, motion[:now], unit)
            face = lowest
        motion[now] = face
        time[face] = now
        _take_away(face, above, time, front)
        if cell >= 0:
            partner[face], partner[cell], unit[face] = cell, face, value
            time[cell] = now
            _take_away(cell, above, time, front)
        now += 1


@compiled
def _coreduction(boundary: _Boundary, time: Cells, front: _Front) -> tuple[int, int, int]:
    """Return the next face and cell to match, and their incidence; -1, -1, 0 if there are none."""
    while front.ends[0, 0] < front.ends[0, 1]:
        cell = front.queue[0, front.ends[0, 0]]
        front.ends[0, 0] += 1
        if time[cell] < 0 and front.left[cell] == 1:
            i = boundary.start[cell]
            while time[boundary.face[i]] >= 0:
                i += 1
            if abs(boundary.value[i]) == 1:
                return int(boundary.face[i]), int(cell), int(boundary.value[i])
    return -1, -1, 0


@compiled
def _critical(boundary: _Boundary, time: Cells, front: _Front) -> int:
    """Return a cell without faces whose removal leaves a coface with one face; -1 if none waits.

    The coface is the one that has waited longest.
    """
    while front.ends[1, 0] < front.ends[1, 1]:
        cell = front.queue[1, front.ends[1, 0]]
        front.ends[1, 0] += 1
        if time[cell] < 0 and front.left[cell] == 2:
            for i in range(boundary.start[cell], boundary.start[cell + 1]):
                face = boundary.face[i]
                if time[face] < 0 and front.left[face] == 0:
                    return int(face)
    return -1


@compiled
def _take_away(cell: int, above: Rows, time: Cells, front: _Front) -> None:
    """Stop counting the cell as a face, and queue its cofaces with one or two faces left."""
    for i in range(above.start[cell], above.start[cell + 1]):
        coface = int(above.cell[i])
        front.left[coface] -= 1
        if 1 <= front.left[coface] <= 2 and time[coface] < 0:
            _wait(coface, front)


@compiled
def _wait(cell: int, front: _Front) -> None:
    """Put the cell into the queue of cells with the same number of faces left."""
    which = front.left[cell] - 1
    front.queue[which, front.ends[which, 1]] = cell
    front.ends[which, 1] += 1


def _flow(cell: int, boundary: _Boundary, matching: _Matching, flow: _Flow, limit: int) -> int:
    """Write the Morse boundary of a critical cell; return how many critical cells it reaches.

    A face that is matched with a greater cell is replaced by the rest of that cell's boundary. The
    latest face comes first, so each is replaced once. A face that is matched with a smaller cell is
    dropped. Before the call, all totals must be 0 and no cell seen; after it, only the reached
    cells differ from that. Return -1 if a total exceeds the limit; a limit of 0 means none.
    """
    waiting = [1]
    waiting.pop()
    source, factor, found = cell, flow.total[cell] + 1, 0
    while True:
        for i in range(boundary.start[source], boundary.start[source + 1]):
            face = int(boundary.face[i])
            partner = int(matching.partner[face])
            if partner == source or 0 <= partner < face:
                continue
            flow.total[face] += factor * boundary.value[i]
            if limit and abs(flow.total[face]) > limit:
                return -1
            if not flow.seen[face]:
                flow.seen[face] = True
                if partner < 0:
                    flow.reached[found] = face
                    found += 1
                else:
                    heappush(waiting, -int(matching.time[face]))
        factor = 0
        while factor == 0:
            if not waiting:
                return found
            face = matching.motion[-heappop(waiting)]
            source = int(matching.partner[face])
            # The incidence of the pair is its own inverse.
            factor = -flow.total[face] * int(matching.unit[face])
            flow.total[face], flow.seen[face] = 0, False


_compiled_flow = compiled(_flow)


def _reduced(chains: _Chains) -> tuple[_Chains, list[Column] | None]:
    """Return the Morse complex of the chains, and its columns if nothing more can be matched there.

    The columns are also returned if a coefficient exceeds `LIMIT`. Then the arrays of the Morse
    complex are left empty, and only the columns, which are exact, may be used.
    """
    above = cofaces(Rows(chains.boundary.start, chains.boundary.face))
    matched = _matched.for_work(8 * (chains.count + len(chains.boundary.face)))
    matching = matched(chains.boundary, above)
    critical = np.flatnonzero(matching.partner < 0)
    dimension = chains.dimension[critical]
    if len(critical) == chains.count:
        return chains, _columns(chains.boundary)
    columns = _morse_columns(chains.boundary, matching, critical, LIMIT)
    if columns is not None:
        return _as_arrays(dimension, columns), None
    columns = _morse_columns(chains.boundary, matching, critical, 0)
    return _as_arrays(dimension, [{}] * len(critical)), columns


def _columns(boundary: _Boundary) -> list[Column]:
    """Return the boundary of every cell as coefficients by face."""
    face, value = boundary.face.tolist(), boundary.value.tolist()
    return [
        dict(zip(face[begin:end], value[begin:end], strict=True))
        for begin, end in pairwise(boundary.start.tolist())
    ]


def _as_arrays(dimension: NDArray[np.int8], columns: list[Column]) -> _Chains:
    """Return the chain complex with these columns."""
    start = np.zeros(len(columns) + 1, np.int64)
    np.cumsum([len(column) for column in columns], out=start[1:])
    face = np.array([number for column in columns for number in column], np.int32)
    value = np.array([number for column in columns for number in column.values()], np.int64)
    return _Chains(dimension, _Boundary(start, face, value))


def _morse_columns(
    boundary: _Boundary, matching: _Matching, critical: NDArray[np.intp], limit: int
) -> list[Column] | None:
    """Return the Morse boundary of every critical cell, renumbered in their order.

    With a limit of 0 it uses Python's integers; otherwise it is compiled, and returns None if the
    limit is exceeded.
    """
    count = len(matching.partner)
    run: Callable[[int, _Boundary, _Matching, _Flow, int], int] = _compiled_flow.for_work(
        100 * len(critical)
    )
    total = np.zeros(count, np.int64)
    if not limit:
        run = _flow
        total = cast("Numbers", total.astype(np.object_))
        boundary = boundary._replace(value=cast("Numbers", boundary.value.astype(np.object_)))
    flow = _Flow(total, np.zeros(count, np.bool_), np.empty(len(critical), np.int32))
    number = np.full(count, -1, np.int32)
    number[critical] = np.arange(len(critical))
    columns: list[Column] = []
    for cell in critical.tolist():
        found = run(cell, boundary, matching, flow, limit)
        if found < 0:
            return None
        here = flow.reached[:found]
        faces, coefficients = number[here].tolist(), total[here].tolist()
        columns.append({f: c for f, c in zip(faces, coefficients, strict=True) if c})
        total[here], flow.seen[here] = 0, False
    return columns


def _by_linear_algebra(
    columns: list[Column], dimension: NDArray[np.int8], highest: int
) -> Homology:
    """Return the homology of a chain complex given by the columns of its boundary."""
    cells: list[list[int]] = [[] for _ in range(highest + 1)]
    critical = [0] * (highest + 1)
    for k in dimension.tolist():
        critical[k] += 1
    for cell in _without_units(columns):
        cells[dimension[cell]].append(cell)
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
        critical=tuple(critical),
    )


def _without_units(columns: list[Column]) -> list[int]:
    """Remove pairs of cells with incidence 1 or -1 until there are none; return the other cells.

    Changes the columns. A pair is taken from a column with few entries, and there from a row with
    few entries, to keep the rest sparse.
    """
    rows: list[dict[int, None]] = [{} for _ in columns]
    for cell, column in enumerate(columns):
        for face in column:
            rows[face][cell] = None
    left = [True] * len(columns)
    waiting = [(len(column), cell) for cell, column in enumerate(columns) if column]
    heapify(waiting)
    while waiting:
        size, cell = heappop(waiting)
        column = columns[cell]
        units = [face for face, value in column.items() if abs(value) == 1]
        if not left[cell] or size != len(column) or not units:
            continue
        pivot = min(units, key=lambda face: (len(rows[face]), face))
        for other in list(rows[pivot]):
            if other != cell:
                _subtract(columns, rows, cell, columns[other][pivot] * column[pivot], other)
                heappush(waiting, (len(columns[other]), other))
        for gone in (pivot, cell):
            left[gone] = False
            for face in columns[gone]:
                del rows[face][gone]
            for above in rows[gone]:
                del columns[above][gone]
                heappush(waiting, (len(columns[above]), above))
            columns[gone], rows[gone] = {}, {}
    return [cell for cell, here in enumerate(left) if here]


def _subtract(
    columns: list[Column], rows: list[dict[int, None]], cell: int, factor: int, other: int
) -> None:
    """Subtract another cell's column, times the factor, from one cell's column."""
    target = columns[other]
    for face, value in columns[cell].items():
        sum_ = target.get(face, 0) - factor * value
        if sum_:
            target[face] = sum_
            rows[face][other] = None
        else:
            target.pop(face)
            del rows[face][other]


def _smith(columns: list[Column], cells: list[int]) -> tuple[list[int], int]:
    """Return the invariant factors of the matrix of these columns, and its rank modulo 2."""
    used = [columns[cell] for cell in cells if columns[cell]]
    faces = {face: row for row, face in enumerate(sorted({f for column in used for f in column}))}
    if not used:
        return [], 0
    matrix = fmpz_mat(len(faces), len(used))
    for place, column in enumerate(used):
        for face, value in column.items():
            matrix[faces[face], place] = value
    form = matrix.snf()
    diagonal = [abs(int(form[i, i])) for i in range(min(len(faces), len(used)))]
    return [factor for factor in diagonal if factor], nmod_mat(matrix, 2).rank()
