"""Closed surfaces among the complexes of squares: recognised, oriented, and named.

A complex of dimension 2 is a closed surface iff every edge lies in two squares, counted as often as
it is a side of each, and the link of every vertex is one circle. Its components are then classified
by Euler characteristic and orientability (Brahana, Dehn and Heegaard; Massey, *A basic course in
algebraic topology*, chapter I).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.complexes.connected_components import classes, components
from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex, Faces
from cubepath.coordinator.theory.complexes.incidence import Cells


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
