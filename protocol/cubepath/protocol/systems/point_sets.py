"""Point sets of the plane, in exact arithmetic: hull, sweeps, empty polygons and flips.

All arithmetic is on integers. Points may be collinear: an edge never passes through a point, and a
side of the hull with points on it is several edges. There may be many thousand points, so flips are
not listed in advance. Runs and environments do need the full list, to number everything that could
ever happen; shortening and search do not.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cmp_to_key
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order

Point: TypeAlias = tuple[int, int]
Edge: TypeAlias = tuple[int, int]
"""Two numbers of points, the lesser first."""
Numbers: TypeAlias = NDArray[np.intp]
"""Numbers of points."""

SWEEPS = {"right": (1, 0), "left": (-1, 0), "up": (0, 1), "down": (0, -1)}
"""The directions in which a sweep can process the points one by one."""
_SPAN_MAX = 2**30
"""Below this span of coordinates no product overflows 64 bits."""


@dataclass(frozen=True, slots=True)
class Quadrilateral:
    """A strictly convex quadrilateral of points with no other point in it or on its sides."""

    diagonals: tuple[Edge, Edge]
    sides: frozenset[Edge]

    @property
    def corners(self) -> tuple[int, ...]:
        """Return the four corners, in increasing order; they identify the quadrilateral."""
        return tuple(sorted(self.diagonals[0] + self.diagonals[1]))


class PointSet:
    """Numbered points that are distinct and not all on one line."""

    def __init__(self, points: Iterable[Point]) -> None:
        """Check the points; raise InputError as `hull_of`."""
        self.points = tuple(points)
        self.hull = frozenset(edge_of(*edge) for edge in hull_of(self.points))
        """The edges of the convex hull, split at the points on them."""
        both = np.array(self.points, dtype=object)
        both -= both.min(axis=0)
        if both.max() < _SPAN_MAX:
            both = both.astype(np.int64)
        # Sorted by x, so a box is found within the strip of its columns.
        self._by_x = np.argsort(both[:, 0], kind="stable")
        self._x: NDArray[Any] = both[:, 0]
        self._y: NDArray[Any] = both[:, 1]
        self._columns = self._x[self._by_x]
        self._every = np.arange(len(self.points))

    @property
    def small(self) -> NDArray[np.int64] | None:
        """Return the coordinates, shape (points, 2), moved so that no product of two overflows.

        None if their span is too great.
        """
        if self._x.dtype != np.int64:
            return None
        return np.stack((self._x, self._y), axis=1).astype(np.int64)

    def turn(self, one: int, other: int, point: int) -> int:
        """Return twice the signed area of a triangle, positive where it turns left."""
        return turn(self.points, one, other, point)

    def left(self, one: int, other: int, point: int) -> bool:
        """Return whether a point lies strictly left of the line from `one` to `other`."""
        return turn(self.points, one, other, point) > 0

    def length(self, edge: Edge) -> int:
        """Return the square of the length of an edge."""
        (ax, ay), (bx, by) = self.points[edge[0]], self.points[edge[1]]
        return (bx - ax) ** 2 + (by - ay) ** 2

    def _turns(self, one: int, other: int, at: Numbers) -> NDArray[Any]:
        """Return `turn` for many points at once."""
        x, y = self._x, self._y
        dx, dy = x[other] - x[one], y[other] - y[one]
        found: NDArray[Any] = dx * (y[at] - y[one]) - dy * (x[at] - x[one])
        return found

    def sides(self, one: int, other: int) -> tuple[int, int]:
        """Return the points strictly left and right of a line, as bits of integers."""
        turns = self._turns(one, other, self._every)
        return bits_of(turns > 0), bits_of(turns < 0)

    def _boxed(self, corners: Sequence[int], *, grown: int = 0) -> Numbers:
        """Return the points in the bounding box of `corners`, grown by this many sides."""
        x, y = self._x[list(corners)], self._y[list(corners)]
        by = grown * max(x.max() - x.min(), y.max() - y.min())
        first = np.searchsorted(self._columns, x.min() - by, "left")
        last = np.searchsorted(self._columns, x.max() + by, "right")
        strip = self._by_x[first:last]
        rows = self._y[strip]
        found: Numbers = strip[(rows >= y.min() - by) & (rows <= y.max() + by)]
        return found

    def on_the_way(self, one: int, other: int) -> tuple[int, ...]:
        """Return the points strictly between two points."""
        near = self._boxed((one, other))
        on = near[self._turns(one, other, near) == 0].tolist()
        return tuple(sorted(set(on) - {one, other}))

    def inside(self, corners: Sequence[int]) -> tuple[int, ...]:
        """Return the other points in or on a convex polygon with these corners, left-turning."""
        near = self._boxed(corners)
        for one, other in zip(corners, [*corners[1:], corners[0]], strict=True):
            near = near[self._turns(one, other, near) >= 0]
        return tuple(sorted(set(near.tolist()) - set(corners)))

    def empty(self, one: int, other: int, apex: int) -> bool:
        """Return whether three points make a triangle with no other point in it or on its sides."""
        sign = self.turn(one, other, apex)
        corners = (one, other, apex) if sign > 0 else (other, one, apex)
        return sign != 0 and not self.inside(corners)

    def crossings(self, edge: Edge, others: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return for each row of an array of edges whether it meets `edge` strictly inside both."""
        ends = [np.sign(self._turns(*edge, others[:, end])) for end in (0, 1)]
        found: NDArray[np.bool_] = (ends[0] * ends[1] < 0).astype(bool)
        apart = others[found]
        x, y = self._x, self._y
        a, b = apart[:, 0], apart[:, 1]
        dx, dy = x[b] - x[a], y[b] - y[a]
        sides = [np.sign(dx * (y[end] - y[a]) - dy * (x[end] - x[a])) for end in edge]
        found[found] = (sides[0] * sides[1] < 0).astype(bool)
        return found

    def around(self, edge: Edge) -> tuple[Quadrilateral, ...]:
        """Return the quadrilaterals of which an edge is a diagonal, by their corners."""
        if self.on_the_way(*edge):
            return ()
        everywhere = np.arange(len(self.points))
        found = list(self._around(edge, everywhere))
        return tuple(sorted(found, key=lambda each: each.corners))

    def can_flip(self, edge: Edge, near: Sequence[int]) -> bool:
        """Return whether an edge through no point is a diagonal of some quadrilateral.

        The search begins among the points around those of `near`, where it nearly always succeeds.
        """
        boxed = self._boxed((*edge, *near), grown=1)
        for each in self._around(edge, boxed):
            # Found among few points: another point could lie in it.
            if not self.inside(self.ring(each.corners)):
                return True
        return bool(self.around(edge))

    def _around(self, edge: Edge, among: Numbers) -> Iterator[Quadrilateral]:
        """Yield the quadrilaterals with this diagonal that hold no other point of `among`."""
        one, other = edge
        overs = self._apexes(one, other, among)
        for under in self._apexes(other, one, among) if overs else ():
            for over in overs:
                if self.left(under, over, one) and self.left(over, under, other):
                    yield quadrilateral(one, under, other, over)

    def _apexes(self, one: int, other: int, among: Numbers) -> list[int]:
        """Return the points left of an edge whose triangle with it holds no other point of `among`.

        Of the points on the left, the nearest to the line makes such a triangle. A point whose
        triangle holds that point makes none, and of the remaining points the nearest again makes
        one.
        """
        height = self._turns(one, other, among)
        rest, height = among[height > 0], height[height > 0]
        found = []
        while len(rest):
            apex = int(rest[np.argmin(height)])
            found.append(apex)
            free = (self._turns(one, apex, rest) < 0) | (self._turns(apex, other, rest) < 0)
            rest, height = rest[free], height[free]
        return found

    def why_no_flip(self, corners: Sequence[int]) -> str | None:
        """Return why no diagonal can flip in the quadrilateral of four points; None if one can."""
        for place, corner in enumerate(corners):
            others = [*corners[:place], *corners[place + 1 :]]
            a, b, c = others if self.left(others[0], others[1], others[2]) else others[::-1]
            if not self.left(a, b, c):
                return (
                    f"not convex: points {others[0]}, {others[1]} and {others[2]} lie on one line"
                )
            if not any(self.left(two, one, corner) for one, two in ((a, b), (b, c), (c, a))):
                return f"not convex: point {corner} lies in the triangle of the other three"
        stray = self.inside(self.ring(corners))
        return f"not empty: point {stray[0]} lies in it or on its side" if stray else None

    def ring(self, corners: Sequence[int]) -> tuple[int, int, int, int]:
        """Return the corners of a convex quadrilateral counter-clockwise."""
        a, *others = corners
        first = next(b for b in others if all(c == b or self.left(a, b, c) for c in others))
        last = next(b for b in others if all(c == b or self.left(b, a, c) for c in others))
        return a, first, next(b for b in others if b not in (first, last)), last

    def sweep(self, direction: str) -> frozenset[Edge]:
        """Return the triangulation that grows point by point in one of the directions `SWEEPS`.

        Points are taken in that direction, ties counter-clockwise of it; each is joined to all
        earlier points that it sees (the placing, or lexicographic, triangulation).
        """
        dx, dy = SWEEPS[direction]
        key = [(dx * x + dy * y, dx * y - dy * x) for x, y in self.points]
        waiting = sorted(range(len(self.points)), key=key.__getitem__)
        line = waiting[:2]
        place = 2
        while not self.turn(line[0], line[1], waiting[place]):
            line.append(waiting[place])
            place += 1
        first = waiting[place]
        found = {edge_of(a, b) for a, b in pairwise(line)}
        found |= {edge_of(a, first) for a in line}
        border = [first, *(line if self.left(line[0], line[1], first) else line[::-1])]
        for point in waiting[place + 1 :]:
            border = self._grown(border, point, found)
        return frozenset(found)

    def _grown(self, border: list[int], point: int, found: set[Edge]) -> list[int]:
        """Join an outside point to the part of the border that it sees; return the new border.

        The border begins with the previous point. It is the last so far in the direction of the
        sweep, so the next point sees a side that ends there.
        """
        count = len(border)
        ahead = behind = 0
        while self.left(border[(ahead + 1) % count], border[ahead], point):
            ahead += 1
        while self.left(border[-behind], border[-behind - 1], point):
            behind += 1
        seen = [*border[count - behind :], *border[: ahead + 1]]
        found.update(edge_of(corner, point) for corner in seen)
        return [point, *border[ahead:], border[0]][: 2 + count - behind - ahead]


def bits_of(row: NDArray[np.bool_]) -> int:
    """Return the integer whose bits are the entries of a row, the first one the lowest."""
    packed = np.packbits(row.astype(bool), bitorder="little")
    return int.from_bytes(packed.tobytes(), "little")


def turn(points: Sequence[Point], one: int, other: int, third: int) -> int:
    """Return twice the signed area of a triangle of numbered points, positive where it turns left.

    >>> turn([(0, 0), (2, 0), (0, 3)], 0, 1, 2)
    6
    """
    (ax, ay), (bx, by), (cx, cy) = points[one], points[other], points[third]
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


def hull_of(points: Sequence[Point]) -> list[Edge]:
    """Return the directed edges of the hull, counter-clockwise, split at the points on them.

    Raises InputError for fewer than three points, two that coincide, and points on one line.
    """
    if len(points) < 3:
        raise InputError(f"{len(points)} points, expected at least 3")
    order = sorted(range(len(points)), key=points.__getitem__)
    for one, other in pairwise(order):
        if points[one] == points[other]:
            raise InputError(f"points {min(one, other)} and {max(one, other)} are the same")
    under, over = _chain(points, order), _chain(points, order[::-1])
    if under == over[::-1]:
        raise InputError(
            f"all {len(points)} points lie on one line: there is nothing to triangulate"
        )
    return [*pairwise(under), *pairwise(over)]


def _chain(points: Sequence[Point], order: Iterable[int]) -> list[int]:
    chain: list[int] = []
    for number in order:
        while len(chain) >= 2 and turn(points, chain[-2], chain[-1], number) < 0:
            chain.pop()
        chain.append(number)
    return chain


def distinct_edges(values: Iterable[object], count: int) -> tuple[Edge, ...]:
    """Return the edges between `count` points that pairs of numbers denote, in their order.

    Either end may come first. Raises InputError for the first pair that is no edge, or stands
    twice.
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


def edges_of(sites: Iterable[Site]) -> list[Edge]:
    """Return the edges that sites are, in order; TypeError for a site that is none."""
    found: list[Edge] = []
    for site in in_order(sites):
        match site:
            case (int(one), int(other)):
                found.append((one, other))
            case _:
                raise TypeError(f"{site!r} is no edge of a triangulation")
    return found


def edge_of(one: int, other: int) -> Edge:
    """Return the edge between two points."""
    return (one, other) if one < other else (other, one)


def quadrilateral(a: int, b: int, c: int, d: int) -> Quadrilateral:
    """Return the quadrilateral with these corners, counter-clockwise; it must be convex."""
    sides = frozenset((edge_of(a, b), edge_of(b, c), edge_of(c, d), edge_of(d, a)))
    return Quadrilateral((edge_of(a, c), edge_of(b, d)), sides)


class Triangles:
    """The triangles on both sides of every edge; the hull's edges may be left out of `edges`.

    The constructor checks that the corners of each triangle turn left, that each inner edge has a
    triangle on both sides, and that each edge of the hull has one inside. Then the boundaries of
    all triangles add up to the hull, once round, so each point of the plane inside it lies in just
    one triangle: this is a triangulation, and every numbered point is a corner of it.
    """

    def __init__(self, points: Sequence[Point], edges: Iterable[Edge]) -> None:
        """Find the triangles; raise InputError where the edges make none."""
        self.points = points
        hull = hull_of(points)
        outside = {(b, a) for a, b in hull}
        near: list[set[int]] = [set() for _ in points]
        for one, other in [*edges, *hull]:
            near[one].add(other)
            near[other].add(one)
        # By directed edge: the third corner of the triangle on its left.
        self._apex: dict[Edge, int] = {}
        for one, others in enumerate(near):
            if not others:
                raise InputError(f"no edge ends at point {one}, expected a triangulation")
            around = self._around(one, others)
            for other, apex in pairwise([*around, around[0]]):
                if (one, other) not in outside:
                    self._apex[one, other] = apex
        for (one, other), apex in self._apex.items():
            if self._apex.get((other, apex)) != one or turn(points, one, other, apex) <= 0:
                raise InputError(
                    f"no triangle left of the edge from {one} to {other}, expected a triangulation"
                )

    def _around(self, one: int, others: Iterable[int]) -> list[int]:
        """Return the neighbours of a point counter-clockwise; InputError if two edges overlap."""
        x, y = self.points[one]

        def half(other: int) -> int:
            dx, dy = self.points[other][0] - x, self.points[other][1] - y
            return 0 if (dy, dx) > (0, 0) else 1

        def compare(first: int, second: int) -> int:
            return half(first) - half(second) or -turn(self.points, one, first, second)

        around = sorted(sorted(others), key=cmp_to_key(compare))
        for first, second in pairwise(around):
            if compare(first, second) == 0:
                raise InputError(
                    f"edges {list(edge_of(one, first))} and {list(edge_of(one, second))} overlap"
                )
        return around

    def apexes(self, edge: Edge) -> tuple[int, ...]:
        """Return the third corners of the one or two triangles at an edge."""
        a, b = edge
        both = self._apex.get((a, b)), self._apex.get((b, a))
        return tuple(apex for apex in both if apex is not None)

    def convex(self, edge: Edge) -> bool:
        """Return whether the triangles on both sides of an inner edge let it flip."""
        a, b = edge
        c, d = self._apex[a, b], self._apex[b, a]
        return turn(self.points, d, c, a) > 0 > turn(self.points, d, c, b)

    def corners(self, edge: Edge) -> tuple[int, int, int, int]:
        """Return the quadrilateral around an edge, counter-clockwise from its lesser end.

        Raises InputError if the edge is not in the triangulation, or cannot flip.
        """
        a, b = edge
        if (a, b) not in self._apex and (b, a) not in self._apex:
            raise InputError("no edge of the triangulation at this time")
        if (a, b) not in self._apex or (b, a) not in self._apex:
            raise InputError("on the hull, with a triangle on one side only")
        c, d = self._apex[a, b], self._apex[b, a]
        # Seen from d to c, a lies on the left and b on the right.
        for end, bend in ((a, turn(self.points, d, c, a)), (b, -turn(self.points, d, c, b))):
            if bend <= 0:
                raise InputError(
                    f"its quadrilateral {sorted((a, b, c, d))} is not strictly convex at point"
                    f" {end}"
                )
        return a, d, b, c

    def flip(self, corners: tuple[int, int, int, int]) -> None:
        """Flip the diagonal of a quadrilateral that `corners` has returned."""
        a, d, b, c = corners
        del self._apex[a, b], self._apex[b, a]
        for one, two, three in ((a, d, c), (d, b, c)):
            self._apex[one, two] = three
            self._apex[two, three] = one
            self._apex[three, one] = two

    def edges(self) -> frozenset[Edge]:
        """Return all edges, including those of the hull."""
        return frozenset(edge_of(*edge) for edge in self._apex)
