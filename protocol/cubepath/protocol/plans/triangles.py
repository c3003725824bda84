"""A triangulation of numbered points, exactly, in which edges flip at the cost of two triangles.

All arithmetic is on whole numbers; there may be many thousand points, and some on one line.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cmp_to_key
from itertools import pairwise

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.systems.point_sets import Edge, Point, edge_of


class Triangles:
    """The triangles on both sides of every edge; the hull's edges may be left out of `edges`.

    Checked when made: of each triangle the corners turn left, each edge that is not of the hull has
    a triangle on both sides, and each of the hull has one inside. Then the boundaries of all
    triangles add up to the hull, once round, so each point of the plane inside it lies in just
    one triangle: this is a triangulation, and every numbered point is a corner of it.
    """

    def __init__(self, points: Sequence[Point], edges: Iterable[Edge]) -> None:
        """Find the triangles; InputError says where the edges make none."""
        self.points = points
        hull = _hull(points)
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
            if self._apex.get((other, apex)) != one or self._turn(one, other, apex) <= 0:
                raise InputError(
                    f"no triangle left of the edge from {one} to {other}, expected a triangulation"
                )

    def _turn(self, one: int, other: int, third: int) -> int:
        (ax, ay), (bx, by), (cx, cy) = self.points[one], self.points[other], self.points[third]
        return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)

    def _around(self, one: int, others: Iterable[int]) -> list[int]:
        """Return the neighbours of a point counter-clockwise; InputError if two lie one way."""
        x, y = self.points[one]

        def half(other: int) -> int:
            dx, dy = self.points[other][0] - x, self.points[other][1] - y
            return 0 if (dy, dx) > (0, 0) else 1

        def compare(first: int, second: int) -> int:
            return half(first) - half(second) or -self._turn(one, first, second)

        around = sorted(sorted(others), key=cmp_to_key(compare))
        for first, second in pairwise(around):
            if compare(first, second) == 0:
                raise InputError(
                    f"edges {list(edge_of(one, first))} and {list(edge_of(one, second))} overlap"
                )
        return around

    def corners(self, edge: Edge) -> tuple[int, int, int, int]:
        """Return the quadrilateral round an edge, counter-clockwise from its lesser end.

        InputError where the edge is none of the triangulation, or cannot flip.
        """
        a, b = edge
        if (a, b) not in self._apex and (b, a) not in self._apex:
            raise InputError("no edge of the triangulation at this time")
        if (a, b) not in self._apex or (b, a) not in self._apex:
            raise InputError("on the hull, with a triangle on one side only")
        c, d = self._apex[a, b], self._apex[b, a]
        # Seen from d to c, a lies on the left and b on the right.
        for end, turn in ((a, self._turn(d, c, a)), (b, -self._turn(d, c, b))):
            if turn <= 0:
                raise InputError(
                    f"its quadrilateral {sorted((a, b, c, d))} is not strictly convex at point"
                    f" {end}"
                )
        return a, d, b, c

    def flip(self, corners: tuple[int, int, int, int]) -> None:
        """Put the other diagonal into a quadrilateral that `corners` has returned."""
        a, d, b, c = corners
        del self._apex[a, b], self._apex[b, a]
        for one, two, three in ((a, d, c), (d, b, c)):
            self._apex[one, two] = three
            self._apex[two, three] = one
            self._apex[three, one] = two

    def edges(self) -> frozenset[Edge]:
        """Return all edges, those of the hull among them."""
        return frozenset(edge_of(*edge) for edge in self._apex)


def _hull(points: Sequence[Point]) -> list[Edge]:
    """Return the directed edges of the hull, counter-clockwise, split at the points on them."""
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
        cx, cy = points[number]
        while len(chain) >= 2:
            (ax, ay), (bx, by) = points[chain[-2]], points[chain[-1]]
            if (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) >= 0:
                break
            chain.pop()
        chain.append(number)
    return chain
