"""Cubical complexes as arrays: cubes by dimension, each with its two faces in every direction.

A precubical set: it is the common form of state complexes and shape complexes, and the input of
homology, links, collapses and surfaces. Cubes may be glued to themselves, as in a shape complex.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
