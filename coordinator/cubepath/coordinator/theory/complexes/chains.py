"""The cubical chain complex: the boundary of every cell, with each face once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex, Faces
from cubepath.coordinator.theory.complexes.incidence import Cells, Numbers
from cubepath.protocol.compiled import compiled


class Boundary(NamedTuple):
    """The boundary of a cell c: value[i] times the cell face[i], over start[c] <= i < start[c + 1].

    No value is 0, and no face occurs twice.
    """

    start: Numbers
    face: Cells
    value: Cells


def boundary_of(complex_: CubicalComplex) -> Boundary:
    """Return the boundaries of all cubes, numbered by ascending dimension.

    The incidences of a cube with the same face are added, and zeros left out. Memory: 8 bytes for
    each face and each cube.
    """
    counts = complex_.f_vector
    entries = sum(found.size for found in complex_.faces)
    face, value = np.empty(entries, np.int32), np.empty(entries, np.int32)
    boundary = Boundary(np.zeros(sum(counts) + 1, np.int64), face, value)
    cell = below = used = 0
    for k, faces in enumerate(complex_.faces):
        add = _added.for_work(4 * faces.size)
        used = int(add(faces, below, boundary, cell, used))
        below, cell = cell, cell + counts[k]
    return Boundary(boundary.start, face[:used], value[:used])


@compiled
def _added(faces: Faces, below: int, boundary: Boundary, cell: int, used: int) -> int:
    """Add the boundaries of the cubes of one dimension, the first of which is `cell`.

    The first of their faces is the cell `below`. `used` entries are there, and are there then.
    """
    start, face, value = boundary
    for cube in range(faces.shape[0]):
        begin = used
        for direction in range(faces.shape[1]):
            for end in range(2):
                found = below + faces[cube, direction, end]
                sign = 1 if (direction + end) % 2 else -1
                place = begin
                while place < used and face[place] != found:
                    place += 1
                if place == used:
                    face[used], value[used] = found, 0
                    used += 1
                value[place] += sign
        kept = begin
        for place in range(begin, used):
            if value[place] != 0:
                face[kept], value[kept] = face[place], value[place]
                kept += 1
        used = kept
        start[cell + cube + 1] = used
    return used
