"""A complex of squares pulled apart at its pinch points: which surface with boundary it is then."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass
from itertools import pairwise

import networkx as nx
import numpy as np

from cubepath.coordinator.complexes.connected_components import classes
from cubepath.coordinator.complexes.cubical_complex import CubicalComplex

_Side = tuple[int, int, int]
"""A square, a direction, and the end at which it is fixed along this side."""
_Corner = tuple[int, int]


@dataclass(frozen=True, slots=True)
class PulledApart:
    """The surface with boundary that squares make when they are glued along edges alone.

    `fans` says for each vertex of the complex how many vertices of the surface lie over it.
    """

    fans: tuple[int, ...]
    components: int
    euler: int
    orientable: bool
    boundary_components: int


def pulled_apart(complex_: CubicalComplex) -> PulledApart | None:
    """Return the surface of a 2-complex, or None where an edge is in three squares or more.

    Edges that are in no square are left out.
    """
    sides = _sides(complex_)
    if any(len(using) > 2 for using in sides.values()):
        return None
    vertex = _vertices(complex_, sides)
    pairs = [(one, other) for using in sides.values() for one, other in pairwise(using)]
    # The boundary takes a side with the sign (-1)^(direction + end): two squares that take their
    # common edge with one sign lie on different sides of an orientation.
    same = [(one[1] + one[2] + other[1] + other[2]) % 2 == 0 for one, other in pairs]
    squares = np.array([(one[0], other[0]) for one, other in pairs], dtype=np.int32)
    sheet, two_sided = classes(
        complex_.f_vector[2], squares.reshape(-1, 2), np.array(same, dtype=np.bool_)
    )
    boundary: nx.MultiGraph[int] = nx.MultiGraph()
    for using in sides.values():
        if len(using) == 1:
            boundary.add_edge(*(vertex[_corner(using[0], end)] for end in (0, 1)))
    below = {number: _place(complex_, corner) for corner, number in vertex.items()}
    fans = Counter(below.values())
    return PulledApart(
        fans=tuple(fans[place] for place in range(complex_.f_vector[0])),
        components=int(sheet.max(initial=-1)) + 1,
        euler=len(below) - len(sides) + complex_.f_vector[2],
        orientable=bool(two_sided.all()),
        boundary_components=nx.number_connected_components(boundary),
    )


def _place(complex_: CubicalComplex, corner: _Corner) -> int:
    """Return the vertex of the complex at a corner of a square."""
    square, number = corner
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


def _vertices(complex_: CubicalComplex, sides: dict[int, list[_Side]]) -> dict[_Corner, int]:
    """Return the vertex of each corner of a square, when they are glued along edges alone."""
    corners: nx.Graph[_Corner] = nx.Graph()
    corners.add_nodes_from(
        (square, corner) for square in range(complex_.f_vector[2]) for corner in range(4)
    )
    for using in sides.values():
        for one, other in pairwise(using):
            corners.add_edges_from((_corner(one, end), _corner(other, end)) for end in (0, 1))
    return {
        corner: number
        for number, piece in enumerate(nx.connected_components(corners))
        for corner in piece
    }


def _corner(side: _Side, end: int) -> _Corner:
    """Return the corner of a square at an end of one of its sides."""
    square, direction, fixed = side
    at = [0, 0]
    at[direction], at[1 - direction] = fixed, end
    return square, 2 * at[0] + at[1]
