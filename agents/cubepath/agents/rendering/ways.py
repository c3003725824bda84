"""How a module goes from one cell to another, worked out from its action.

A module that turns does so in a plane, about corners of cells there: of hexagons or squares, of a
layer of cubes, which looks like squares from above, or of a layer of dodecahedra along an edge,
which looks like hexagons. Points of such a plane are complex numbers around the cell that the
module leaves. Any other module goes straight; round the corner of a cube, straight twice.
"""

from cmath import isclose, phase, rect
from collections.abc import Callable, Iterator, Sequence
from functools import cache, lru_cache
from itertools import pairwise, product
from math import copysign, cos, hypot, pi, sin, sqrt
from typing import NamedTuple, TypeAlias

import numpy as np

from cubepath.agents.rendering.projection import CELL_FACES, Points
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.sites import Site


class Leg(NamedTuple):
    """A part of a way: a turn, in radians, about a line through `about`, counter-clockwise.

    The line has the direction `axis`, of length 1. If the turn is 0, the leg is straight, by
    `axis`. In the plane, z is 0 and the axis of a turn points upwards.
    """

    about: tuple[float, float, float]
    axis: tuple[float, float, float]
    turn: float

    @property
    def length(self) -> float:
        """Return the angle of a turn, or how far a straight leg leads."""
        return abs(self.turn) or hypot(*self.axis)


Way: TypeAlias = tuple[Leg, ...]
"""How a module moves: leg by leg."""


def straight(by: Points) -> Leg:
    """Return the straight leg by a vector, shape (2,) or (3,)."""
    x, y, z = (*by.tolist(), 0.0)[:3]
    return Leg((0.0, 0.0, 0.0), (x, y, z), 0.0)


def along(way: Way, part: float, points: Points) -> Points:
    """Return points of a module, shape (..., 3), after a part of its way, 0 to 1."""
    left = part * sum(leg.length for leg in way)
    for leg in way:
        own = min(left, leg.length)
        left -= own
        axis = np.array(leg.axis)
        if not leg.turn:
            points = points + (own / (leg.length or 1)) * axis
            continue
        angle, arm = copysign(own, leg.turn), points - leg.about
        level = (arm @ axis)[..., None] * axis  # Rodrigues' formula
        points = leg.about + level + (arm - level) * cos(angle) + np.cross(axis, arm) * sin(angle)
    return points


_Turn: TypeAlias = tuple[complex, float]
_STEPS, _SLACK = 12, 0.03
"""A turn is sampled at this many angles, and cells that overlap by less than this only touch."""


class _Plane(NamedTuple):
    """A plane in which modules turn: its unit vectors, and the corners of a cell around 0."""

    axis: Points
    right: Points
    up: Points
    corners: tuple[complex, ...]


@cache
def _planes(drawing: str) -> tuple[_Plane, ...]:
    """Return the planes across the edges of a cell; in the plane there is just one."""
    if drawing not in CELL_FACES:
        count, size = (6, 1 / sqrt(3)) if drawing == "hexagons" else (4, sqrt(0.5))
        corners = tuple(rect(size, (2 * each + 1) * pi / count) for each in range(count))
        right, up, axis = np.eye(3)
        return (_Plane(axis, right, up, corners),)
    ends = [(face, np.roll(face, -1, axis=0)) for face, _ in CELL_FACES[drawing][0]]
    first = np.concatenate([one for one, _ in ends])
    ways = np.concatenate([other - one for one, other in ends])
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    found = []
    for axis in np.unique(np.round(ways, 9), axis=0):
        if tuple(axis) > (0, 0, 0):
            right = np.cross(axis, np.roll(np.eye(3), 1, axis=0)[np.abs(axis).argmax()])
            right /= np.linalg.norm(right)
            up = np.cross(axis, right)
            own = first[np.abs(ways @ axis) > 1 - 1e-6]
            spots = dict.fromkeys(complex(*np.round((p @ right, p @ up), 9)) for p in own)
            found.append(_Plane(axis, right, up, tuple(sorted(spots, key=phase))))
    return tuple(found)


def way_in(
    drawing: str,
    middle: Callable[[Site], Sequence[float]],
    action: Action,
    source: Site,
    target: Site,
) -> Way:
    """Return the way of a module that an action takes from one cell to another; () is straight.

    The module turns about a corner that it shares, before and after, with a module that stays, or
    about two such corners in succession; it never passes through a module that stays. Squares and
    cubes can also slide, so they turn only if the action needs all cells free that they sweep. They
    slide round the corner of a module, by way of a cell that is free, if there is one.
    """
    on = action.ends[0] & action.ends[1]
    if len(action.ends[0] & action.trace) != 1:
        return ()
    off = action.support - action.free - action.ends[0] - action.ends[1]
    start = np.array(middle(source))
    goal, still, free = (
        np.array([middle(cell) for cell in cells]).reshape(-1, len(start)) - start
        for cells in ((target,), sorted(action.reads & on, key=str), sorted(off, key=str))
    )
    found: list[tuple[float, int, tuple[_Turn, ...], _Plane]] = []
    for plane in _planes(drawing):
        basis = [each[: len(start)] for each in (plane.right, plane.up, plane.axis)]
        inside = [
            tuple(
                complex(x, y)
                for x, y, z in np.round(cells @ np.array(basis).T, 12)
                if abs(z) < 1e-6
            )
            for cells in (goal, still, free)
        ]
        if inside[0]:
            turns = _turns(plane.corners, inside[0][0], inside[1], inside[2])
            found += [(sum(abs(turn) for _, turn in turns), len(found), turns, plane)] * bool(turns)
    if not found:
        return _slides(drawing, goal[0], still, free)
    _, _, turns, plane = min(found, key=lambda way: way[:2])
    origin = np.pad(start, (0, 3 - len(start)))
    spots = [origin + spot.real * plane.right + spot.imag * plane.up for spot, _ in turns]
    x, y, z = plane.axis.tolist()
    return tuple(
        Leg((float(a), float(b), float(c)), (x, y, z), turn)
        for (a, b, c), (_, turn) in zip(spots, turns, strict=True)
    )


def _slides(drawing: str, goal: Points, still: Points, free: Points) -> Way:
    """Return the two straight legs of a square or a cube to a cell beside one that is beside it."""
    steps = [step for step in np.diag(goal) if step.any()]
    if drawing not in ("squares", "cubes") or len(steps) != 2:
        return ()

    def worse(corner: Points) -> tuple[bool, bool]:
        taken, known = ((cells == corner).all(axis=1).any() for cells in (still, free))
        return bool(taken), not known

    first = min(steps, key=worse)
    return straight(first), straight(goal - first)


@lru_cache(maxsize=4096)
def _turns(
    corners: tuple[complex, ...],
    goal: complex,
    still: tuple[complex, ...],
    free: tuple[complex, ...],
) -> tuple[_Turn, ...]:
    """Return the least turns about corners of cells that stay on, past these cells; or none."""
    blocked = list(still)
    if len(corners) == 4:
        near = {complex(x, y) for x, y in product(range(-3, 4), repeat=2)}
        blocked += sorted(near - {0, goal, *free}, key=abs)
    held = [spot + corner for spot in still for corner in corners]
    leaving, coming = (
        [at for corner in corners if _among(at := cell + corner, held)] for cell in (0j, goal)
    )
    ways = [*_single(goal, leaving, coming), *_double(corners, goal, leaving, coming)]
    ways.sort(key=lambda way: (round(sum(abs(turn) for _, turn in way), 6), len(way)))
    return next((way for way in ways if _clear(corners, way, blocked)), ())


def _among(spot: complex, spots: Sequence[complex]) -> bool:
    return any(isclose(spot, other, abs_tol=1e-5) for other in spots)


def _single(
    goal: complex, leaving: Sequence[complex], coming: Sequence[complex]
) -> Iterator[tuple[_Turn, ...]]:
    for about in leaving:
        if _among(about, coming):
            turn = phase((goal - about) / -about)
            yield ((about, turn),)
            if abs(turn) > pi - 1e-5:
                yield ((about, -turn),)


def _double(
    corners: Sequence[complex], goal: complex, leaving: Sequence[complex], coming: Sequence[complex]
) -> Iterator[tuple[_Turn, ...]]:
    """Yield turns until one more corner of the module meets one that stays, and about that one."""
    for about, then, corner in product(leaving, coming, corners):
        apart, met = then - about, corner - about
        if abs(met) < 1e-5 or abs(apart) < 1e-5 or not isclose(abs(apart), abs(met), abs_tol=1e-5):
            continue
        first, between = phase(apart / met), about - about * apart / met
        second = phase((goal - then) / (between - then))
        whole = (first + second) * len(corners) / (2 * pi)
        reached = isclose(abs(goal - then), abs(between - then), abs_tol=1e-5)
        if reached and first * second > 1e-5 and isclose(whole, round(whole), abs_tol=1e-4):
            yield (about, first), (then, second)


def _clear(corners: Sequence[complex], way: Sequence[_Turn], blocked: Sequence[complex]) -> bool:
    """Return whether the module overlaps none of these cells on its way."""
    middle, spin = 0j, 1 + 0j
    for about, turn in way:
        for step in range(1, _STEPS + 1):
            now = rect(1, turn * step / _STEPS)
            at = about + (middle - about) * now
            if any(_overlap(corners, at - cell, spin * now) for cell in blocked):
                return False
        now = rect(1, turn)
        middle, spin = about + (middle - about) * now, spin * now
    return True


def _overlap(corners: Sequence[complex], apart: complex, spin: complex) -> bool:
    """Return whether a cell around 0 and a turned one overlap: no side lies between them."""
    if abs(apart) > 2 * abs(corners[0]):
        return False
    sides = [(one + other) / abs(one + other) for one, other in pairwise(corners)]
    return all(
        abs((side.conjugate() * apart).real) + _SLACK
        < sum(max((side.conjugate() * c).real for c in cell) for cell in (corners, spun))
        for spun in [[spin * corner for corner in corners]]
        for side in (*sides, *(spin * side for side in sides))
    )
