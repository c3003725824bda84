"""Triangulations of a planar point set under flips of diagonals, as a system."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from itertools import combinations
from typing import Any, ClassVar, Self

import msgspec

from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import ExcludedError, InputError
from cubepath.protocol.core.sites import Site, in_order, to_json
from cubepath.protocol.core.system import Bound
from cubepath.protocol.systems.listed import TabledSystem
from cubepath.protocol.systems.point_sets import (
    Edge,
    Point,
    PointSet,
    Quadrilateral,
    distinct_edges,
)


class FlipSystem(TabledSystem):
    """A site is an edge ``(a, b)`` between points a < b, a module a diagonal of a triangulation.

    Source: the paper's "triangulations of polygons with edge-flipping as the generator". A flip is
    named by the corners of its quadrilateral, which is strictly convex and holds no other point;
    its support is the four sides, on, and both diagonals, which are its trace. `fixed` are the
    edges of the hull and any others that are in every triangulation. All triangulations of the
    points can be reached from one (Lawson 1972).
    """

    table: ClassVar[str] = "triangulation"

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

    def to_table(self) -> dict[str, Any]:
        """Return the points."""
        return {"points": to_json(self.plane.points)}

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Self:
        """Return the system of a table ``[triangulation]``; docs/files.md has its keys."""
        return cls(msgspec.convert(table, _PointsTable).points)

    def bounds(self, start: State, goal: State) -> Iterable[Bound]:
        """Return the bounds by crossings, and by the triangles that there are."""
        yield Bound(crossing_bound(self, start, goal), "an edge's crossings halve")
        yield Bound(flip_bound(self, start, goal), "flips at one time")

    def potential(self, goal: State) -> Callable[[Site], int]:
        """Return how many edges of the goal an edge crosses.

        Some flip lessens the sum as long as there is any (Hanke, Ottmann and Schuierer 1996).
        """
        cross = self.plane.cross
        edges = _edges(goal)
        return lambda site: sum(cross(one, edge) for one in _edges((site,)) for edge in edges)

    def modules_among(self, sites: Iterable[Site]) -> tuple[Edge, ...]:
        """Return the diagonals among the edges of a triangulation, in their order.

        A file says all edges, or leaves out those that are in every triangulation; either end of
        an edge may come first.
        """
        edges = distinct_edges(sites, len(self.plane.points))
        return tuple(edge for edge in edges if edge not in self.kept)

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
                case (one, other) if type(one) is type(other) is int and 0 <= one < other <= last:
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


def crossing_bound(system: FlipSystem, start: State, goal: State) -> int:
    """Return how often the crossings of one edge must be halved until it can be there.

    The bound is the greatest ``floor(log2(k)) + 1`` over the edges of either triangulation that are
    crossed by k >= 1 edges of the other.

    Proof. Let an edge f of the goal cross k edges of the present triangulation. It runs through
    k + 1 triangles. Only a flip of an edge that f crosses can lessen k, and by one at most; its
    quadrilateral is two triangles that follow each other along f. Flips of one cube have no
    triangle in common, since a diagonal may not be a side of the other's quadrilateral. So one cube
    lessens k by at most floor((k + 1) / 2), to at least floor(k / 2), and f is there only when k
    is 0. Read backwards, the same holds for edges of the start. Quadratic in the edges.

    That log n rounds are of the right order for convex polygons is known: Galtier, Hurtado, Noy,
    Perennes and Urrutia, *Simultaneous edge flipping in triangulations* (2003).
    """
    crossed: dict[Edge, int] = {}
    for edge in _edges(start - goal):
        for other in _edges(goal - start):
            if system.plane.cross(edge, other):
                crossed[edge] = crossed.get(edge, 0) + 1
                crossed[other] = crossed.get(other, 0) + 1
    return max(crossed.values(), default=0).bit_length()


def flip_bound(system: FlipSystem, start: State, goal: State) -> int:
    """Return how many rounds the edges that are missing need, as many at a time as can be.

    Proof. A flip brings one edge and needs two triangles; those of one cube have none in common.
    A triangulation with V points and E edges has E - V + 1 triangles (Euler).
    """
    edges = len(start | system.kept)
    triangles = edges - len(system.plane.points) + 1
    return -(-len(goal - start) // max(1, triangles // 2))


def _edges(sites: Iterable[Site]) -> list[Edge]:
    found: list[Edge] = []
    for site in in_order(sites):
        match site:
            case (int(one), int(other)):
                found.append((one, other))
            case _:
                raise TypeError(f"{site!r} is no edge of a triangulation")
    return found


class _PointsTable(msgspec.Struct, forbid_unknown_fields=True):
    points: list[tuple[int, int]]
