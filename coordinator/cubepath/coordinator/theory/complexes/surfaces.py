"""Surfaces among the complexes of squares: closed or with a boundary, recognised and named.

A complex of dimension 2 is a closed surface iff every edge lies in two squares, counted as often as
it is a side of each, and the link of every vertex is one circle. Its components are then classified
by Euler characteristic and orientability (Brahana, Dehn and Heegaard; Massey, *A basic course in
algebraic topology*, chapter I), by a union-find with path compression (Tarjan 1975) and parity.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.complexes.cubical_complex import Cells, CubicalComplex
from cubepath.protocol.compiled import compiled


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

    pieces: one for each component, in the order of their least squares; empty if there is a flaw.
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
    glued = _glued(complex_)
    bad = np.flatnonzero(glued.sides != 2)
    if len(bad):
        count = glued.sides[bad[0]]
        return Surface(flaw=f"edge {bad[0]} lies in {count} square{'' if count == 1 else 's'}")
    # Then the link of a vertex consists of circles, one for each vertex of the surface over it.
    bad = np.flatnonzero(glued.fans != 1)
    if len(bad):
        flaw = f"the link of vertex {bad[0]} consists of {glued.fans[bad[0]]} circles, not 1"
        return Surface(flaw=flaw)
    pieces = zip(glued.euler.tolist(), glued.orientable.tolist(), strict=True)
    return Surface(tuple(ClosedSurface(*piece) for piece in pieces))


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
    glued = _glued(complex_)
    if (glued.sides > 2).any():
        return None
    circle = _joined(4 * complex_.f_vector[2], glued.boundary)
    return SeparatedSurface(
        fans=tuple(glued.fans.tolist()),
        components=len(glued.euler),
        euler=int(glued.euler.sum()),
        orientable=bool(glued.orientable.all()),
        boundary_components=len(np.unique(circle[glued.boundary])),
    )


class _Glued(NamedTuple):
    """The squares of a complex glued along edges alone, as a surface if none is in three squares.

    `sides` holds for each edge how many sides of squares lie on it, and `fans` for each vertex how
    many vertices of the surface lie over it. `euler` and `orientable` are by component, in the
    order of their least squares. `boundary` has the two vertices of the surface at each side that
    lies on an edge alone, shape (any, 2).
    """

    sides: NDArray[np.int64]
    fans: NDArray[np.int64]
    euler: NDArray[np.int64]
    orientable: NDArray[np.bool_]
    boundary: Cells


_FORWARD = np.array([False, True, True, False])
"""Whether a side, by direction and end, has the sign 1 in the boundary of its square."""


def _glued(complex_: CubicalComplex) -> _Glued:
    """Glue the squares; side 4 s + 2 d + e is that of square s at end e of direction d."""
    vertices, edges, count = complex_.f_vector[:3]
    edge_of = complex_.faces[2].reshape(-1)
    order = np.argsort(edge_of, kind="stable")
    met = np.flatnonzero(np.diff(edge_of[order]) == 0)
    one, other = order[met], order[met + 1]
    # They fit, by the definition of orientation, if their edge cancels in the sum of the
    # boundaries; otherwise one must be turned over.
    turned = _FORWARD[one % 4] == _FORWARD[other % 4]
    pairs = np.stack([one // 4, other // 4], axis=1).astype(np.int32)
    sheet, orientable = classes(count, pairs, turned)
    ends = _ends(np.arange(4 * count))
    vertex = _joined(4 * count, np.stack([ends[one], ends[other]], axis=2).reshape(-1, 2))
    _, corner = np.unique(vertex, return_index=True)
    _, side = np.unique(edge_of, return_index=True)
    at = (corner // 4, side // 4, np.arange(count))
    counts = [np.bincount(sheet[squares], minlength=len(orientable)) for squares in at]
    # The edge that fixes direction 0 runs in direction 1.
    below = complex_.faces[1][complex_.faces[2][:, 0], 0].reshape(-1)[corner]
    sides = np.bincount(edge_of, minlength=edges)
    alone = side[sides[edge_of[side]] == 1]
    fans = np.bincount(below, minlength=vertices)
    return _Glued(sides, fans, counts[0] - counts[1] + counts[2], orientable, vertex[ends[alone]])


def _joined(count: int, pairs: Cells) -> Cells:
    """Return the class of each of `count` elements, where the two of a pair share a class."""
    return classes(count, pairs, np.zeros(len(pairs), np.bool_))[0]


def _ends(side: NDArray[np.int64]) -> Cells:
    """Return the corners at the two ends of each side, shape (sides, 2).

    Corner c of square s has the number 4 s + c, where bit d of c, counted from the left, is the end
    of direction d at which it lies.
    """
    square, direction, end = side // 4, side // 2 % 2, side % 2
    first = 4 * square + (2 - direction) * end
    return np.stack([first, first + 1 + direction], axis=1).astype(np.int32)
