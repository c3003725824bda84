"""Cubical complexes as arrays: cubes by dimension, each with its two faces in every direction.

The common form of state complexes and shape complexes (a precubical set), and the input of
homology, links, collapses and surfaces. Cubes may be glued to themselves, as in a shape complex.
Loops over cells of all dimensions use one row of all cubes, by ascending dimension, with faces and
cofaces in compressed sparse rows.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.errors import InputError

Faces = NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class CubicalComplex:
    """A finite complex of cubes of dimension 0, 1, ..., len(faces) - 1.

    ``faces[k]`` has shape (number of k-cubes, k, 2): ``faces[k][i, j, e]`` is the number of the
    (k-1)-cube that is the face of the k-cube i at end e of direction j. The directions of this face
    are those of the cube without j, in the same order, so that for a < b

    ``faces[k-1][faces[k][i, b, e], a, d] == faces[k-1][faces[k][i, a, d], b - 1, e]``.

    The boundary of a cube is the sum over j of (-1)^j (end 1 minus end 0).
    """

    faces: tuple[Faces, ...]

    def __post_init__(self) -> None:
        """Check shapes and ranges; `check` also checks the identities."""
        for k, found in enumerate(self.faces):
            if found.ndim != 3 or found.shape[1:] != (k, 2):
                raise InputError(
                    f"faces of the {k}-cubes have shape {found.shape}, expected (count, {k}, 2)"
                )
            below = len(self.faces[k - 1]) if k else 0
            if found.size and not 0 <= found.min() <= found.max() < below:
                raise InputError(f"a {k}-cube has a face that is none of {below} cubes")

    @property
    def f_vector(self) -> tuple[int, ...]:
        """Return the number of cubes of each dimension."""
        return tuple(len(found) for found in self.faces)

    @property
    def dimension(self) -> int:
        """Return the greatest dimension of a cube; -1 for the empty complex."""
        return len(self.faces) - 1

    @property
    def euler(self) -> int:
        """Return the Euler characteristic."""
        return sum(count if k % 2 == 0 else -count for k, count in enumerate(self.f_vector))

    def check(self) -> None:
        """Raise InputError if two ways to a face of a face differ (the cubical identities)."""
        for k in range(2, len(self.faces)):
            here, below = self.faces[k], self.faces[k - 1]
            for b in range(k):
                for a in range(b):
                    for d in (0, 1):
                        for e in (0, 1):
                            one = below[here[:, b, e], a, d]
                            other = below[here[:, a, d], b - 1, e]
                            if not np.array_equal(one, other):
                                cube = int(np.argmax(one != other))
                                raise InputError(
                                    f"{k}-cube {cube}: the faces of its faces do not fit"
                                )


def complex_from_faces(faces: Sequence[object]) -> CubicalComplex:
    """Return a complex from nested lists of face numbers, for small examples.

    >>> square = complex_from_faces([4, [[0, 1], [2, 3], [0, 2], [1, 3]], [[[0, 1], [2, 3]]]])
    >>> square.check()
    >>> square.f_vector, square.euler, homology(square).betti
    ((4, 4, 1), 1, (1, 0, 0))
    """
    return CubicalComplex(
        tuple(
            np.asarray(found, dtype=np.int32).reshape(-1, k, 2) if k else _points(found)
            for k, found in enumerate(faces)
        )
    )


def _points(count: object) -> Faces:
    if not isinstance(count, int):
        raise InputError(f"the 0-cubes are given by their number, found {count!r}")
    return np.empty((count, 0, 2), dtype=np.int32)


Numbers = NDArray[np.int64]
Cells = NDArray[np.int32]


class CellRows(NamedTuple):
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
    faces: CellRows


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
    return Incidence(offset, CellRows(start, face))


def cofaces(faces: CellRows) -> CellRows:
    """Return for each cell the cells of which it is a face, ascending, with multiplicity.

    This is the transpose of the rows, in linear time.
    """
    return _transposed.for_work(4 * (len(faces.start) + len(faces.cell)))(faces)


@compiled
def _transposed(faces: CellRows) -> CellRows:
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
    return CellRows(start, coface)


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
