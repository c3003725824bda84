"""An exact triangulation of numbered points, in which a flip costs only two triangles.

All arithmetic is on integers. There may be many thousand points, and some may be collinear.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cmp_to_key
from itertools import pairwise

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.systems.point_sets import Edge, Point, edge_of, hull_of, turn


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
