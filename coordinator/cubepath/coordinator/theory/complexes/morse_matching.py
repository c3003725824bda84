"""Discrete Morse matching by coreductions, compiled: the first step of homology.

A cell that has just one face left, with incidence 1 or -1, is removed together with that face. If
there is no such cell, a cell without faces is removed as critical. It is chosen at the border of
the removed cells, which leaves few critical cells and short paths between them. Linear in the
number of incidences. Sources: see `homology_groups`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.complexes.chains import Boundary
from cubepath.coordinator.theory.complexes.incidence import Cells, Numbers, Rows
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


def matched(boundary: Boundary, above: Rows) -> Matching:
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
def _matched(boundary: Boundary, above: Rows) -> Matching:
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
def _take_away(cell: int, above: Rows, front: _Front) -> None:
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
