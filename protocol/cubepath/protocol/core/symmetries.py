"""The rotations and reflections of lattices, which turn one generator into all its orientations.

They act on the *points* of cells: whole numbers on which translations act by addition. A cell is
its own point, but an edge's is its middle, in halves of an edge.
"""

from collections.abc import Iterator
from functools import cache
from typing import NamedTuple, TypeAlias

from cubepath.protocol.core.catalogue import HEXAGONS, Cell, Lattice

Matrix: TypeAlias = tuple[tuple[int, ...], ...]
_SPIN: Matrix = ((0, -1, 0), (1, 0, 0), (0, 0, 1))
_ABOUT_X: Matrix = ((1, 0, 0), (0, 0, -1), (0, 1, 0))
_ABOUT_Y: Matrix = ((0, 0, 1), (0, 1, 0), (-1, 0, 0))


class Orientation(NamedTuple):
    """A rotation by its number, and whether a reflection comes before it.

    In the plane rotation `turn` is by that many times 60 degrees (hexagons) or 90, counter-
    clockwise; in space the 24 of the cube are numbered from the identity, quarter turns about z
    first. The reflection fixes direction ``(1, 0)``; on other lattices than hexagons y becomes -y.
    """

    turn: int
    mirrored: bool
    matrix: Matrix

    def moved(self, lattice: Lattice, cell: Cell) -> Cell:
        """Return where the symmetry takes a cell."""
        return cell_at(lattice, _image(self.matrix, point_of(lattice, cell)))


def point_of(lattice: Lattice, cell: Cell) -> Cell:
    """Return the point of a cell; of an edge, its middle in halves of an edge.

    >>> from cubepath.protocol.core.catalogue import EDGES
    >>> point_of(EDGES, (2, 3, 0)), cell_at(EDGES, (5, 6))
    ((5, 6), (2, 3, 0))
    """
    if lattice.arity == lattice.dimension:
        return cell
    return tuple(2 * cell[axis] + (axis == cell[-1]) for axis in range(lattice.dimension))


def cell_at(lattice: Lattice, point: Cell) -> Cell:
    """Return the cell of a point; for edges just one of its numbers is odd."""
    if lattice.arity == lattice.dimension:
        return point
    axis = next(axis for axis, number in enumerate(point) if number % 2)
    return (*(number // 2 for number in point), axis)


def orientations(lattice: Lattice, *, mirrored: bool) -> Iterator[Orientation]:
    """Yield the rotations of a lattice, each followed by itself after the reflection if asked."""
    mirror: Matrix = ((1, 0, 0), (0, -1, 0), (0, 0, 1))
    if lattice.dimension == 2:
        mirror = ((1, 1), (0, -1)) if lattice == HEXAGONS else ((1, 0), (0, -1))
    for turn, rotation in enumerate(_rotations(lattice)):
        yield Orientation(turn, mirrored=False, matrix=rotation)
        if mirrored:
            yield Orientation(turn, mirrored=True, matrix=_times(rotation, mirror))


@cache
def _rotations(lattice: Lattice) -> tuple[Matrix, ...]:
    if lattice.dimension == 2:
        return _powers(((0, -1), (1, 1)) if lattice == HEXAGONS else ((0, -1), (1, 0)))
    # Each of these takes another side of the cube to the top.
    about_x, about_y = _powers(_ABOUT_X), _powers(_ABOUT_Y)
    tilts = (*about_x, about_y[1], about_y[3])
    return tuple(_times(spin, tilt) for tilt in tilts for spin in _powers(_SPIN))


def _powers(matrix: Matrix) -> tuple[Matrix, ...]:
    """Return the powers of a rotation, from the identity."""
    size = range(len(matrix))
    found = [tuple(tuple(int(row == column) for column in size) for row in size)]
    while (power := _times(matrix, found[-1])) != found[0]:
        found.append(power)
    return tuple(found)


def _times(one: Matrix, other: Matrix) -> Matrix:
    return tuple(zip(*(_image(one, column) for column in zip(*other, strict=True)), strict=True))


def _image(matrix: Matrix, point: Cell) -> Cell:
    return tuple(sum(a * b for a, b in zip(row, point, strict=True)) for row in matrix)
