"""Homology of a cubical complex over Z, with its torsion, and over Z/2: exact, for large complexes.

Three steps, each exact, each keeping the complex up to chain homotopy equivalence over Z:

1. *Discrete Morse matching by coreductions* on sparse arrays (`morse`); then again on the
   Morse complex, as long as it shrinks. Linear in the number of incidences, apart
   from following the paths between critical cells.
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

import numpy as np
from flint import fmpz_mat, nmod_mat
from numpy.typing import NDArray

from cubepath.coordinator.theory.complexes.cubical_complex import (
    Boundary,
    CellRows,
    CubicalComplex,
    boundary_of,
    cofaces,
)
from cubepath.coordinator.theory.complexes.morse import Column, matched, morse_columns, paths_along

Progress = Callable[[int], None]

LIMIT = 2**30
"""Coefficients up to this are kept in 32 bits, and multiplied and added in 64.

Beyond it they are Python's integers.
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


@dataclass(frozen=True, slots=True, eq=False)
class _Chains:
    """A free chain complex with a basis of cells, numbered by ascending dimension."""

    dimension: NDArray[np.int8]
    boundary: Boundary

    @property
    def count(self) -> int:
        """Return the number of cells."""
        return len(self.dimension)


def _chains_of(complex_: CubicalComplex) -> _Chains:
    dimensions = np.arange(len(complex_.faces), dtype=np.int8)
    dimension = np.repeat(dimensions, np.array(complex_.f_vector, np.int64))
    return _Chains(dimension, boundary_of(complex_))


def _reduced(chains: _Chains) -> tuple[_Chains, list[Column] | None]:
    """Return the Morse complex of the chains, and its columns if nothing more can be matched there.

    The columns are also returned if a coefficient exceeds `LIMIT`. Then the arrays of the Morse
    complex are left empty, and only the columns, which are exact, may be used.
    """
    boundary = chains.boundary
    matching = matched(boundary, cofaces(CellRows(boundary.start, boundary.face)))
    critical = np.sort(matching.face[matching.face == matching.cell])
    dimension = chains.dimension[critical]
    if len(critical) == chains.count:
        return chains, _columns(boundary)
    paths = paths_along(boundary, matching)
    columns = morse_columns(paths, LIMIT)
    if columns is not None:
        return _as_arrays(dimension, columns), None
    return _as_arrays(dimension, [{}] * len(critical)), morse_columns(paths, 0)


def _columns(boundary: Boundary) -> list[Column]:
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
    value = np.array([number for column in columns for number in column.values()], np.int32)
    return _Chains(dimension, Boundary(start, face, value))


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
