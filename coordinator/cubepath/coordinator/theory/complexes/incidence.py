"""All cubes of a complex in one row, by ascending dimension, with their faces and cofaces.

Loops over cells of all dimensions use this form instead of one array for each dimension. It is the
compressed sparse row format of many libraries.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex
from cubepath.protocol.compiled import compiled

Numbers = NDArray[np.int64]
Cells = NDArray[np.int32]


class Rows(NamedTuple):
    """A list of cells for each cell: those of c are ``cell[start[c]:start[c + 1]]``."""

    start: Numbers
    cell: Cells


@dataclass(frozen=True, slots=True, eq=False)
class Incidence:
    """The faces of all cubes, where the k-cube i of the complex is the cell ``offset[k] + i``.

    offset: shape (dimension + 2,); the last entry is the number of cells. faces: one for each
    direction and end of a cell, in this order and with repetition.
    """

    offset: Numbers
    faces: Rows


def incidence(complex_: CubicalComplex) -> Incidence:
    """Return the cells and faces of the complex in one row; memory: 4 bytes for each face."""
    counts = complex_.f_vector
    offset = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)]).astype(np.int64)
    per_cell = np.repeat(2 * np.arange(len(counts), dtype=np.int64), counts)
    start = np.concatenate([[0], np.cumsum(per_cell)]).astype(np.int64)
    face = np.empty(start[-1], np.int32)
    for k in range(1, len(counts)):
        here = slice(start[offset[k]], start[offset[k + 1]])
        face[here] = complex_.faces[k].reshape(-1) + offset[k - 1]
    return Incidence(offset, Rows(start, face))


def cofaces(faces: Rows) -> Rows:
    """Return for each cell the cells of which it is a face, ascending, with multiplicity.

    This is the transpose of the rows, in linear time.
    """
    return _transposed.for_work(4 * (len(faces.start) + len(faces.cell)))(faces)


@compiled
def _transposed(faces: Rows) -> Rows:
    cells = len(faces.start) - 1
    start = np.zeros(cells + 1, np.int64)
    for number in faces.cell:
        start[number + 1] += 1
    for cell in range(cells):
        start[cell + 1] += start[cell]
    place, coface = start[:-1].copy(), np.empty(len(faces.cell), np.int32)
    for cell in range(cells):
        for i in range(faces.start[cell], faces.start[cell + 1]):
            number = faces.cell[i]
            coface[place[number]] = cell
            place[number] += 1
    return Rows(start, coface)
