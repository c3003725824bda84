"""The surface with boundary that a complex of squares becomes when its pinch points are split."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cubepath.coordinator.theory.complexes.connected_components import classes
from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex
from cubepath.coordinator.theory.complexes.incidence import Cells

_Side = tuple[int, int, int]
"""A square, a direction, and the end at which it is fixed along this side."""


@dataclass(frozen=True, slots=True)
class PulledApart:
    """The surface with boundary that squares form when they are glued only along edges.

    `fans` holds for each vertex of the complex the number of vertices of the surface over it.
    """

    fans: tuple[int, ...]
    components: int
    euler: int
    orientable: bool
    boundary_components: int


def pulled_apart(complex_: CubicalComplex) -> PulledApart | None:
    """Return the surface of a 2-complex, or None if an edge is in three squares or more.

    Edges that are in no square are left out.
    """
    sides = _sides(complex_)
    if any(len(using) > 2 for using in sides.values()):
        return None
    vertex = _vertices(complex_, sides)
    pairs = [(one, other) for using in sides.values() for one, other in pairwise(using)]
    # A side has the sign (-1)^(direction + end) in the boundary: two squares that have their common
    # edge with the same sign have opposite orientations.
    same = [(one[1] + one[2] + other[1] + other[2]) % 2 == 0 for one, other in pairs]
    squares = np.array([(one[0], other[0]) for one, other in pairs], dtype=np.int32)
    sheet, two_sided = classes(
        complex_.f_vector[2], squares.reshape(-1, 2), np.array(same, dtype=np.bool_)
    )
    ends = [_ends(using[0]) for using in sides.values() if len(using) == 1]
    boundary = vertex[np.array(ends, dtype=np.int32).reshape(-1, 2)]
    below = {number: _place(complex_, corner) for corner, number in enumerate(vertex.tolist())}
    fans = Counter(below.values())
    return PulledApart(
        fans=tuple(fans[place] for place in range(complex_.f_vector[0])),
        components=int(sheet.max(initial=-1)) + 1,
        euler=len(below) - len(sides) + complex_.f_vector[2],
        orientable=bool(two_sided.all()),
        boundary_components=len(np.unique(_joined(len(vertex), boundary)[boundary])),
    )


def _joined(count: int, pairs: Cells) -> Cells:
    """Return the class of each of `count` elements, where the two of a pair share a class."""
    return classes(count, pairs, np.zeros(len(pairs), np.bool_))[0]


def _place(complex_: CubicalComplex, corner: int) -> int:
    """Return the vertex of the complex at a corner of a square."""
    square, number = divmod(corner, 4)
    edge = complex_.faces[2][square, 0, number >> 1]
    return int(complex_.faces[1][edge, 0, number & 1])


def _sides(complex_: CubicalComplex) -> dict[int, list[_Side]]:
    """Return for each edge the sides of squares that lie on it."""
    found: dict[int, list[_Side]] = defaultdict(list)
    for square, faces in enumerate(complex_.faces[2].tolist()):
        for direction in (0, 1):
            for end in (0, 1):
                found[faces[direction][end]].append((square, direction, end))
    return found


def _vertices(complex_: CubicalComplex, sides: dict[int, list[_Side]]) -> Cells:
    """Return the vertex of each corner of a square, when squares are glued only along edges.

    Corner c of square s has the number 4 * s + c, where bit d of c, counted from the left, is the
    end of direction d at which it lies.
    """
    glued = [
        pair
        for using in sides.values()
        for one, other in pairwise(using)
        for pair in zip(_ends(one), _ends(other), strict=True)
    ]
    pairs = np.array(glued, dtype=np.int32).reshape(-1, 2)
    return _joined(4 * complex_.f_vector[2], pairs)


def _ends(side: _Side) -> tuple[int, int]:
    """Return the corners at the two ends of a side."""
    square, direction, fixed = side
    first = 4 * square + (2 - direction) * fixed
    return first, first + 1 + direction
