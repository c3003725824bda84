"""Surfaces among the complexes of squares: closed or with a boundary, recognised and named.

A complex of dimension 2 is a closed surface iff every edge lies in two squares, counted as often as
it is a side of each, and the link of every vertex is one circle. Its components are then classified
by Euler characteristic and orientability (Brahana, Dehn and Heegaard; Massey, *A basic course in
algebraic topology*, chapter I), by a union-find with path compression (Tarjan 1975) and parity.
"""

from collections import Counter, defaultdict
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.complexes.cubical_complex import Cells, CubicalComplex, Faces
from cubepath.protocol.compiled import compiled


def components(complex_: CubicalComplex) -> Cells:
    """Return the component of every vertex, shape (vertices,).

    Components are numbered 0, 1, ... in the order of their least vertices.
    """
    vertices = complex_.f_vector[0] if complex_.faces else 0
    if complex_.dimension < 1:
        return np.arange(vertices, dtype=np.int32)
    ends = complex_.faces[1][:, 0]
    return classes(vertices, ends, np.zeros(len(ends), np.bool_))[0]


def classes(count: int, pairs: Cells, differ: NDArray[np.bool_]) -> tuple[Cells, NDArray[np.bool_]]:
    """Return the class of each of `count` elements, and for each class whether it has two sides.

    pairs: shape (n, 2), elements of the same class. A class has two sides if its elements can be
    put on two sides such that the elements of pairs with differ[i], shape (n,), lie on different
    sides and those of all other pairs on the same side. Classes are numbered in the order of their
    least elements.
    """
    steps = 4 * (count + len(pairs))
    return _classes.for_work(steps)(count, np.ascontiguousarray(pairs), differ)


@compiled
def _classes(
    count: int, pairs: Cells, differ: NDArray[np.bool_]
) -> tuple[Cells, NDArray[np.bool_]]:
    # A root is the least element of its class, so a class is first met at its root.
    parent, odd = np.arange(count).astype(np.int32), np.zeros(count, np.bool_)
    two_sided = np.ones(count, np.bool_)
    for i in range(len(pairs)):
        one, other = pairs[i, 0], pairs[i, 1]
        root, of_other = _root(parent, odd, one), _root(parent, odd, other)
        # Now both are direct children of their roots, unless they are roots themselves.
        apart = odd[one] ^ odd[other] ^ differ[i]
        if root == of_other:
            two_sided[root] &= not apart
            continue
        low, high = min(root, of_other), max(root, of_other)
        parent[high], odd[high] = low, apart
        two_sided[low] &= two_sided[high]
    number, found = np.empty(count, np.int32), 0
    sides = np.empty(count, np.bool_)
    for element in range(count):
        root = _root(parent, odd, element)
        if root == element:
            number[element], sides[found] = found, two_sided[element]
            found += 1
        else:
            number[element] = number[root]
    return number, sides[:found]


@compiled
def _root(parent: Cells, odd: NDArray[np.bool_], element: int) -> int:
    """Return the root of the element, and make all elements on the way its direct children."""
    root, side = element, False
    while parent[root] != root:
        side ^= odd[root]
        root = parent[root]
    while parent[element] != root and element != root:
        above, rest = parent[element], side ^ odd[element]
        parent[element], odd[element] = root, side
        element, side = above, rest
    return root


@dataclass(frozen=True, slots=True)
class ClosedSurface:
    """A connected closed surface, up to homeomorphism."""

    euler: int
    orientable: bool

    @property
    def genus(self) -> int:
        """Return the number of handles, or of crosscaps if the surface is not orientable."""
        return (2 - self.euler) // 2 if self.orientable else 2 - self.euler

    @property
    def name(self) -> str:
        """Return its name, for use in a sentence."""
        if self.orientable:
            return f"closed orientable surface of genus {self.genus}"
        return f"closed non-orientable surface, Euler characteristic {self.euler}"


@dataclass(frozen=True, slots=True)
class Surface:
    """A complex as a surface: its components, or the first flaw if it is not a closed surface.

    pieces: one for each component, in the order of their least vertices; empty if there is a flaw.
    flaw: why it is not a closed surface; empty if it is.
    """

    pieces: tuple[ClosedSurface, ...] = ()
    flaw: str = ""

    @property
    def closed(self) -> bool:
        """Return whether the complex is a closed surface, connected or not."""
        return not self.flaw

    @property
    def name(self) -> str:
        """Return its name, for use in a sentence."""
        if self.flaw:
            return f"not a closed surface: {self.flaw}"
        if len(self.pieces) == 1:
            return self.pieces[0].name
        return f"{len(self.pieces)} surfaces: " + "; ".join(piece.name for piece in self.pieces)


def surface(complex_: CubicalComplex) -> Surface:
    """Return the closed surface that the complex is, or why it is not one.

    >>> built = state_complex(explore(scene_from_spec("agv:graph=K5,n=2")))
    >>> found = surface(built.complex)
    >>> found.closed, found.name
    (True, 'closed non-orientable surface, Euler characteristic -5')
    """
    dimension = max((k for k, count in enumerate(complex_.f_vector) if count), default=-1)
    if dimension < 0:
        return Surface(flaw="it is empty")
    if dimension != 2:
        return Surface(flaw=f"its dimension is {dimension}, not 2")
    flaw = _flaw(complex_)
    return Surface(flaw=flaw) if flaw else Surface(_pieces(complex_))


def _flaw(complex_: CubicalComplex) -> str:
    """Return a line on the first edge or vertex that a closed surface cannot have, or ""."""
    vertices, edges = complex_.f_vector[:2]
    squares = complex_.faces[2]
    sides = np.bincount(squares.reshape(-1), minlength=edges)
    bad = np.flatnonzero(sides != 2)
    if len(bad):
        count = sides[bad[0]]
        return f"edge {bad[0]} lies in {count} square{'' if count == 1 else 's'}"
    # The points of the link of a vertex are the ends of edges there, its arcs the corners of
    # squares. The edge that fixes direction 0 runs in direction 1, and vice versa.
    arcs = np.stack(
        [
            np.stack([2 * squares[:, 0, d] + e, 2 * squares[:, 1, e] + d], axis=1)
            for d in (0, 1)
            for e in (0, 1)
        ]
    ).reshape(-1, 2)
    link, _ = classes(2 * edges, arcs, np.zeros(len(arcs), np.bool_))
    # Here every point of a link is in two arcs, so the components of the link are circles.
    _, first = np.unique(link, return_index=True)
    circles = np.bincount(complex_.faces[1].reshape(-1)[first], minlength=vertices)
    bad = np.flatnonzero(circles != 1)
    if len(bad):
        return f"the link of vertex {bad[0]} consists of {circles[bad[0]]} circles, not 1"
    return ""


def _pieces(complex_: CubicalComplex) -> tuple[ClosedSurface, ...]:
    """Return the components of a closed surface."""
    _, edges, squares = complex_.faces[:3]
    vertex = components(complex_)
    edge = vertex[edges[:, 0, 0]]
    square = edge[squares[:, 0, 0]]
    count = int(vertex.max()) + 1
    counts = [np.bincount(found, minlength=count) for found in (vertex, edge, square)]
    euler = counts[0] - counts[1] + counts[2]
    sheet, two_sided = classes(len(squares), *_seams(squares))
    _, first = np.unique(sheet, return_index=True)
    orientable = dict(zip(square[first].tolist(), two_sided.tolist(), strict=True))
    return tuple(ClosedSurface(int(euler[piece]), orientable[piece]) for piece in range(count))


def _seams(squares: Faces) -> tuple[Cells, NDArray[np.bool_]]:
    """Return the two squares at every edge, and whether one must be turned over to fit the other.

    They fit, by the definition of orientation, if the edge cancels in the sum of their boundaries.
    """
    by_edge = np.argsort(squares.reshape(-1), kind="stable").reshape(-1, 2)
    forward = np.array([False, True, True, False])[by_edge % 4]
    return (by_edge // 4).astype(np.int32), forward[:, 0] == forward[:, 1]


_Side = tuple[int, int, int]
"""A square, a direction, and the end at which it is fixed along this side."""


@dataclass(frozen=True, slots=True)
class SeparatedSurface:
    """The surface with boundary that squares form when they are glued only along edges.

    `fans` holds for each vertex of the complex the number of vertices of the surface over it.
    """

    fans: tuple[int, ...]
    components: int
    euler: int
    orientable: bool
    boundary_components: int


def pulled_apart(complex_: CubicalComplex) -> SeparatedSurface | None:
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
    return SeparatedSurface(
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
