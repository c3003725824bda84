"""Point sets of the plane, exactly: which edges and quadrilaterals they allow, triangulations.

All arithmetic is on whole numbers. Points may be collinear: an edge never passes through a point,
and a side of the hull with points on it is several edges.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.errors import InputError

Point: TypeAlias = tuple[int, int]
Edge: TypeAlias = tuple[int, int]
"""Two numbers of points, the lesser first."""

POINTS_MAX = 300
"""The largest point set: random points have some three flips for every pair of them."""
FLIPS_MAX = 200_000
"""The most flips; n points in convex position have n (n-1) (n-2) (n-3) / 24."""
SWEEPS = {"right": (1, 0), "left": (-1, 0), "up": (0, 1), "down": (0, -1)}
"""The directions in which a sweep can take the points one by one."""


@dataclass(frozen=True, slots=True)
class Quadrilateral:
    """A strictly convex quadrilateral of points with no other point in it or on its sides."""

    diagonals: tuple[Edge, Edge]
    sides: frozenset[Edge]

    @property
    def corners(self) -> tuple[int, ...]:
        """Return the four corners, in increasing order; they tell it from every other."""
        return tuple(sorted(self.diagonals[0] + self.diagonals[1]))


class PointSet:
    """Numbered points that are distinct and not all on one line."""

    def __init__(self, points: Iterable[Point]) -> None:
        """Check the points; InputError names the first that contradicts."""
        self.points = tuple(points)
        count = len(self.points)
        if not 3 <= count <= POINTS_MAX:
            raise InputError(f"{count} points, expected 3 to {POINTS_MAX}")
        first: dict[Point, int] = {}
        for number, point in enumerate(self.points):
            if point in first:
                raise InputError(f"points {first[point]} and {number} are the same")
            first[point] = number
        # Bits of a whole number stand for points: who lies left of a line, who on a segment.
        self._left: list[list[int]] = []
        self._on: list[list[int]] = []
        for number in range(count):
            left, on = self._seen_from(number)
            self._left.append(left)
            self._on.append(on)
        if not any(map(any, self._left)):
            raise InputError(f"all {count} points lie on one line: there is nothing to triangulate")

    def _seen_from(self, corner: int) -> tuple[list[int], list[int]]:
        """Return for each other point who is left of the line to it, and who on the way to it."""
        points = np.array(self.points, dtype=object)
        points -= points[corner]
        if np.abs(points).max() < 2**30:  # so no product overflows
            points = points.astype(np.int64)
        x, y = points[:, 0], points[:, 1]
        turn = np.outer(x, y) - np.outer(y, x)
        ahead = np.outer(x, x) + np.outer(y, y)
        far = (x * x + y * y)[:, None]
        return _bits(turn > 0), _bits((turn == 0) & (ahead > 0) & (ahead < far))

    def left(self, one: int, other: int, point: int) -> bool:
        """Tell whether a point lies strictly left of the line from `one` to `other`."""
        return bool(self._left[one][other] >> point & 1)

    def _bends(self, one: int, other: int, point: int) -> bool:
        return self.left(one, other, point) or self.left(other, one, point)

    def on_the_way(self, one: int, other: int) -> tuple[int, ...]:
        """Return the points strictly between two points."""
        return _numbers(self._on[one][other])

    def inside(self, corners: Sequence[int]) -> tuple[int, ...]:
        """Return the other points in or on a convex polygon with these corners, left-turning."""
        within, on = -1, 0
        for one, other in zip(corners, [*corners[1:], corners[0]], strict=True):
            within &= self._left[one][other]
            on |= self._on[one][other]
        return _numbers(within | on)

    def cross(self, edge: Edge, other: Edge) -> bool:
        """Tell whether two edges meet in a point that is strictly inside both."""
        return self._parts(edge, other) and self._parts(other, edge)

    def _parts(self, edge: Edge, other: Edge) -> bool:
        """Tell whether the ends of `other` lie strictly on the two sides of an edge."""
        (a, b), (c, d) = edge, other
        if self.left(a, b, c):
            return self.left(b, a, d)
        return self.left(b, a, c) and self.left(a, b, d)

    @cached_property
    def hull(self) -> frozenset[Edge]:
        """Return the edges of the convex hull, split at the points on them."""
        return frozenset(
            edge_of(one, other)
            for one, left in enumerate(self._left)
            for other in range(len(left))
            if one != other
            and not left[other]
            and not self._on[one][other]
            and any(self._left[other])
        )

    @cached_property
    def quadrilaterals(self) -> tuple[Quadrilateral, ...]:
        """Return all quadrilaterals in which a diagonal can flip, once each, in order."""
        count = len(self.points)
        found = []
        for one in range(count):
            for other in range(one + 1, count):
                if self._on[one][other]:
                    continue
                apexes = list(self._apexes(one, other))
                for under in self._apexes(other, one):
                    found += [
                        _quadrilateral(one, under, other, over)
                        for over in apexes
                        if (one, other) < edge_of(under, over)
                        and self.left(under, over, one)
                        and self.left(over, under, other)
                    ]
            if len(found) > FLIPS_MAX:
                raise InputError(f"more than {FLIPS_MAX} flips among {count} points: too many")
        return tuple(sorted(found, key=lambda each: each.corners))

    def _apexes(self, one: int, other: int) -> Iterator[int]:
        """Yield the points left of an edge that make an empty triangle with it."""
        left, on = self._left, self._on
        beside = left[one][other]
        for apex in _numbers(beside):
            within = beside & left[other][apex] & left[apex][one]
            if not (within or on[other][apex] or on[apex][one]):
                yield apex

    def why_no_flip(self, corners: Sequence[int]) -> str | None:
        """Say why no diagonal can flip in the quadrilateral of four points; None if one can."""
        for place, corner in enumerate(corners):
            others = [*corners[:place], *corners[place + 1 :]]
            a, b, c = others if self.left(others[0], others[1], others[2]) else others[::-1]
            if not self.left(a, b, c):
                return (
                    f"not convex: points {others[0]}, {others[1]} and {others[2]} lie on one line"
                )
            if not any(self.left(two, one, corner) for one, two in ((a, b), (b, c), (c, a))):
                return f"not convex: point {corner} lies in the triangle of the other three"
        stray = self.inside(self._round(corners))
        return f"not empty: point {stray[0]} lies in it or on its side" if stray else None

    def _round(self, corners: Sequence[int]) -> list[int]:
        """Return the corners of a convex quadrilateral counter-clockwise."""
        a, *others = corners
        first = next(b for b in others if all(c == b or self.left(a, b, c) for c in others))
        last = next(b for b in others if all(c == b or self.left(b, a, c) for c in others))
        return [a, first, next(b for b in others if b not in (first, last)), last]

    def sweep(self, direction: str) -> frozenset[Edge]:
        """Return the triangulation that grows point by point in one of the directions `SWEEPS`.

        Points are taken in that direction, ties counter-clockwise of it; each is joined to all
        that it sees of those before it (the placing, or lexicographic, triangulation).
        """
        dx, dy = SWEEPS[direction]
        key = [(dx * x + dy * y, dx * y - dy * x) for x, y in self.points]
        waiting = sorted(range(len(self.points)), key=key.__getitem__)
        line = waiting[:2]
        place = 2
        while not self._bends(line[0], line[1], waiting[place]):
            line.append(waiting[place])
            place += 1
        first = waiting[place]
        found = {edge_of(a, b) for a, b in pairwise(line)}
        found |= {edge_of(a, first) for a in line}
        border = [*(line if self.left(line[0], line[1], first) else line[::-1]), first]
        for point in waiting[place + 1 :]:
            border = self._grown(border, point, found)
        return frozenset(found)

    def _grown(self, border: list[int], point: int, found: set[Edge]) -> list[int]:
        """Join a point outside to what it sees of the border, and return the new border."""
        count = len(border)
        seen = [self.left(border[(k + 1) % count], border[k], point) for k in range(count)]
        # Turn the border so that what is seen comes first.
        begin = next(k for k in range(count) if seen[k] and not seen[k - 1])
        border = border[begin:] + border[:begin]
        length = sum(seen)
        found |= {edge_of(corner, point) for corner in border[: length + 1]}
        return [border[0], point, *border[length:]]


def distinct_edges(values: Iterable[object], count: int) -> tuple[Edge, ...]:
    """Return the edges between `count` points that pairs of numbers stand for, in their order.

    Either end may come first. InputError names the first that is none, or stands twice.
    """
    found: dict[Edge, None] = {}
    for value in values:
        edge = _edge(value, count)
        if edge is None:
            raise InputError(f"{value!r} is no edge between two points of 0 to {count - 1}")
        if edge in found:
            raise InputError(f"edge {list(edge)} stands twice")
        found[edge] = None
    return tuple(found)


def _edge(value: object, count: int) -> Edge | None:
    match value:
        case (one, other) if type(one) is int and type(other) is int and one != other:
            return edge_of(one, other) if min(one, other) >= 0 and max(one, other) < count else None
        case _:
            return None


def edge_of(one: int, other: int) -> Edge:
    """Return the edge between two points."""
    return (one, other) if one < other else (other, one)


def _quadrilateral(a: int, b: int, c: int, d: int) -> Quadrilateral:
    sides = frozenset((edge_of(a, b), edge_of(b, c), edge_of(c, d), edge_of(d, a)))
    return Quadrilateral((edge_of(a, c), edge_of(b, d)), sides)


def _bits(rows: NDArray[np.bool_]) -> list[int]:
    packed = np.packbits(rows.astype(bool), axis=1, bitorder="little")
    return [int.from_bytes(row.tobytes(), "little") for row in packed]


def _numbers(bits: int) -> tuple[int, ...]:
    return tuple(number for number in range(bits.bit_length()) if bits >> number & 1)
