"""Which cells a module sweeps on its way, by points inside it: a second way to supports."""

from collections.abc import Iterable, Sequence
from itertools import pairwise, product
from math import pi

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.catalogue import Cell

Points = NDArray[np.float64]
_STEPS = 30
_TOUCHED, _SWEPT = 1e-9, 0.05
"""A cell that points enter to at most the one depth is touched, to at least the other swept."""


class Solid:
    """A solid around the origin: the points whose distance is at most 0; its copies fill space."""

    def __init__(
        self, normals: Iterable[Sequence[float]], corners: Iterable[Sequence[float]]
    ) -> None:
        """Take the normals of its faces, whose planes they end in, and its corners."""
        self._normals = np.array(list(normals), float)
        self.corners = np.array(list(corners), float)
        grid = np.linspace(-1, 1, 21)
        inside = np.array(list(product(grid, grid, grid)))
        self.points = np.concatenate([inside[self.depth(inside) >= 0], self.corners])

    def depth(self, points: Points) -> Points:
        """Return how deep points lie inside, in units of the distance from centre to face."""
        found: Points = 1 - (points @ self._normals.T / (self._normals**2).sum(axis=1)).max(axis=1)
        return found


_SIGNS = list(product((1, -1), repeat=3))
_AXES = [tuple(sign * (axis == at) for at in range(3)) for axis in range(3) for sign in (1, -1)]
CUBE = Solid(
    [tuple(x / 2 for x in axis) for axis in _AXES], [tuple(x / 2 for x in each) for each in _SIGNS]
)
DODECAHEDRON = Solid(
    [tuple(x / 2 for x in each) for each in product((1, 0, -1), repeat=3) if each.count(0) == 1],
    [*_AXES, *(tuple(x / 2 for x in each) for each in _SIGNS)],
)


def turned(points: Points, axis: Points, about: Points, angle: float) -> Points:
    """Return points turned about a line (Rodrigues)."""
    unit, away = axis / np.linalg.norm(axis), points - about
    along = np.outer(away @ unit, unit)
    across = np.cross(unit, away)
    found: Points = about + along + (away - along) * np.cos(angle) + across * np.sin(angle)
    return found


def turning(solid: Solid, source: Cell, target: Cell, pivot: Cell) -> list[Points]:
    """Return where a solid is on its way about the edge that three cells share.

    It goes round the side on which the pivot is not.
    """
    ends = {tuple(corner) for corner in np.round(solid.corners + source, 6)}
    for cell in (target, pivot):
        ends &= {tuple(corner) for corner in np.round(solid.corners + cell, 6)}
    one, other = (np.array(end) for end in sorted(ends))
    centre = np.array([source], float)
    angles = [sign * part * pi for part in (1 / 2, 2 / 3, 1) for sign in (1, -1)]
    ways = [
        [
            turned(solid.points + source, other - one, one, angle * t / _STEPS)
            for t in range(_STEPS + 1)
        ]
        for angle in angles
        if np.allclose(turned(centre, other - one, one, angle), [target])
    ]
    (found,) = [way for way in ways if not _enters(solid, way, pivot)]
    return found


def shifting(solid: Solid, *stops: Cell) -> list[Points]:
    """Return where a solid is on its way straight from one cell to the next."""
    return [
        solid.points + np.array(one) + (np.array(other) - np.array(one)) * t / _STEPS
        for one, other in pairwise(stops)
        for t in range(_STEPS + 1)
    ]


def _enters(solid: Solid, way: Iterable[Points], cell: Cell) -> bool:
    depth = max(float(solid.depth(points - cell).max()) for points in way)
    if _TOUCHED < depth < _SWEPT:
        raise AssertionError(f"cell {cell} is entered by {depth}: touched or swept?")
    return depth >= _SWEPT


def swept(solid: Solid, way: list[Points], cells: Iterable[Cell]) -> set[Cell]:
    """Return the cells that it enters on its way."""
    return {cell for cell in cells if _enters(solid, way, cell)}
