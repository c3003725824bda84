"""Triangulations of a planar point set under flips of diagonals, as a system."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from itertools import combinations

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import ExcludedError, InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.systems.listed import TabledSystem
from cubepath.protocol.systems.point_sets import Edge, Point, PointSet, Quadrilateral


class FlipSystem(TabledSystem):
    """A site is an edge ``(a, b)`` between points a < b, a module a diagonal of a triangulation.

    Source: the paper's "triangulations of polygons with edge-flipping as the generator". A flip is
    named by the corners of its quadrilateral, which is strictly convex and holds no other point;
    its support is the four sides, on, and both diagonals, which are its trace. `fixed` are the
    edges of the hull and any others that are in every triangulation. All triangulations of the
    points can be reached from one (Lawson 1972).
    """

    def __init__(self, points: Iterable[Point]) -> None:
        """Find all flips; InputError says what is wrong with the points."""
        self.plane = PointSet(points)
        moves = [flip_of(quadrilateral) for quadrilateral in self.plane.quadrilaterals]
        if not moves:
            raise InputError("no quadrilateral is convex and empty, so no diagonal can flip")
        moving = {site for move in moves for site in move.action.trace}
        self.kept = self.plane.sweep("right") - moving
        super().__init__(
            moves,
            fixed=self.kept,
            drawing="chords",
            positions={
                number: (float(x), float(y)) for number, (x, y) in enumerate(self.plane.points)
            },
        )

    def __reduce__(self) -> tuple[object, ...]:
        # The points say all, and are far fewer than the flips.
        return partial(FlipSystem, self.plane.points), ()

    def modules_of(self, edges: Iterable[Edge]) -> tuple[Edge, ...]:
        """Return the edges of a triangulation that are modules, in order."""
        return tuple(sorted(edge for edge in edges if edge not in self.kept))

    def action(self, generator: str, at: Site) -> Action:
        """Return the flip in the quadrilateral with the corners `at`, in any order.

        InputError where there is none: which point is in it, or why it is not convex.
        """
        if generator == "flip" and (generator, at) not in self.by_name:
            corners = self._corners(at)
            why = self.plane.why_no_flip(corners)
            if why is not None:
                raise ExcludedError(f"generator 'flip': quadrilateral {list(corners)} is {why}")
            at = corners
        return super().action(generator, at)

    def _corners(self, at: Site) -> tuple[int, ...]:
        last = len(self.plane.points) - 1
        if not (isinstance(at, tuple) and len(set(at)) == len(at) == 4):
            raise InputError(f"generator 'flip': 'at' is four points, found {at!r}")
        for corner in at:
            if not (type(corner) is int and 0 <= corner <= last):
                raise InputError(f"generator 'flip': {corner!r} is no point, expected 0 to {last}")
        return tuple(sorted(at))

    def check_state(self, sites: Iterable[Site]) -> None:
        """Check that the edges make a triangulation together with those that are fixed."""
        edges: list[Edge] = []
        last = len(self.plane.points) - 1
        for site in sites:
            match site:
                case (int(one), int(other)) if 0 <= one < other <= last:
                    edges.append((one, other))
                case _:
                    raise InputError(f"{site!r} is no edge [a, b] of points a < b up to {last}")
            between = self.plane.on_the_way(one, other)
            if between:
                raise InputError(f"edge {[one, other]} passes through point {between[0]}")
            if (one, other) in self.kept:
                raise InputError(f"edge {[one, other]} is in every triangulation and no module")
        for edge, other_edge in combinations((*edges, *self.kept), 2):
            if self.plane.cross(edge, other_edge):
                raise InputError(f"edges {list(edge)} and {list(other_edge)} cross")
        due = len(self.modules_of(self.plane.sweep("right")))
        if len(edges) != due:
            raise InputError(f"{len(edges)} diagonals, a triangulation of these points has {due}")


def flip_of(quadrilateral: Quadrilateral) -> Move:
    """Return the flip in a quadrilateral, named by its corners."""
    one, other = quadrilateral.diagonals
    sides, at = quadrilateral.sides, quadrilateral.corners
    support = {*sides, one, other}
    label = f"flip at {list(at)}"
    action = Action(support, (one, other), {*sides, one}, {*sides, other}, label=label)
    return Move(action, "flip", at, ((one, other),))
