"""Triangulations of a planar point set under flips of diagonals, as a system."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property, lru_cache, partial
from typing import Any, ClassVar, Generic, Self, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.actions import Action, State, action_of_parts
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import ExcludedError, InputError
from cubepath.protocol.core.sites import Site, in_order, to_json
from cubepath.protocol.core.system import KEPT, Bound, System
from cubepath.protocol.systems.flip_greedy import Mesh, crossings
from cubepath.protocol.systems.flip_refuting import TriangulationPair, proved
from cubepath.protocol.systems.flip_search import FlipSearch, mesh_of, prepare
from cubepath.protocol.systems.listed import TabledSystem
from cubepath.protocol.systems.point_sets import (
    SWEEPS,
    Edge,
    Point,
    PointSet,
    Quadrilateral,
    Triangles,
    distinct_edges,
    edge_of,
    edges_of,
    quadrilateral,
)


class FlipSystem(System):
    """A site is an edge ``(a, b)`` between points a < b, a module a diagonal of a triangulation.

    Source: the paper's "triangulations of polygons with edge-flipping as the generator". A flip is
    named by the corners of its quadrilateral, which is strictly convex and holds no other point;
    its support is the four sides, on, and both diagonals, which are its trace. `filled` are the
    edges of the hull and any others that are in every triangulation. All triangulations of the
    points can be reached from one (Lawson 1972).

    Flips are found where they are needed, so there may be many thousand points. Some answers number
    all that could ever happen (a module's slots, the places that it senses). They need the whole
    list, which is built on first use and is limited in size: `whole`.

    >>> square = FlipSystem([(0, 0), (1, 0), (1, 1), (0, 1)])
    >>> [move.target for move in square.moves((0, 2)) if move is not None]
    [(1, 3)]
    """

    table: ClassVar[str] = "triangulation"
    drawing = "chords"
    descends = True

    def __init__(self, points: Iterable[Point]) -> None:
        """Check the points; raise InputError for what is wrong with them."""
        self.plane = PointSet(points)
        self.positions = {
            number: (float(x), float(y)) for number, (x, y) in enumerate(self.plane.points)
        }
        self.site_size = 1
        self.kept = _kept(self.plane)
        """The edges that no other edge can cross: they are in every triangulation."""
        self.filled = self.kept
        self._flips: dict[tuple[int, ...], Move] = {}
        self._between = lru_cache(maxsize=KEPT)(self.plane.on_the_way)

    def __reduce__(self) -> tuple[object, ...]:
        return partial(FlipSystem, self.plane.points), ()

    def to_table(self) -> dict[str, Any]:
        """Return the points."""
        return {"points": to_json(self.plane.points)}

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Self:
        """Return the system of a table ``[triangulation]``; docs/files.md has its keys."""
        return cls(msgspec.convert(table, _PointsTable).points)

    def bounds(self, start: State, goal: State) -> Iterable[Bound]:
        """Return the bounds by crossings, by the number of triangles, and by refutation."""
        one = Bound(crossing_bound(self, start, goal), "an edge's crossings halve")
        other = Bound(flip_bound(self, start, goal), "flips at one time")
        yield one
        yield other
        ends = TriangulationPair(
            frozenset(edges_of(start | self.kept)),
            frozenset(edges_of(goal | self.kept)),
            self.discovery,
            partial(self.halvings, goal | self.kept),
        )
        for cubes in proved(ends, max(one.cubes, other.cubes)):
            yield Bound(cubes, "fewer rounds contradict themselves")

    def halvings(self, goal: State, edges: Sequence[Edge]) -> list[int]:
        """Return how often the crossings of each edge with a triangulation must be halved.

        Few edges are compared with all others. Of many, each is followed through the triangulation,
        at the cost of its crossings, unless coordinates are too wide for that.
        """
        mesh = self._mesh(goal) if len(goal) > _CROSSED_MAX else None
        if mesh is not None:
            return [count.bit_length() for count in crossings(mesh, _rows(edges)).tolist()]
        rows = _rows(edges_of(goal))
        return [int(self.plane.crossings(edge, rows).sum()).bit_length() for edge in edges]

    def potential(self, goal: State) -> Callable[[Site], int]:
        """Return how many edges of the goal an edge crosses.

        While the sum is positive, some flip decreases it (Hanke, Ottmann and Schuierer 1996).
        """
        edges = _rows(edges_of(goal))
        return lambda site: sum(
            int(self.plane.crossings(e, edges).sum()) for e in edges_of((site,))
        )

    def paths(
        self, start: State, goal: State, *, seed: int, known: Iterable[Action] = ()
    ) -> Iterator[Sequence[Action] | None] | None:
        """Return a compiled search; None if the coordinates span more than 64 bits can compute."""
        one, other = self._mesh(start), self._mesh(goal)
        if one is None or other is None:
            return None
        search = FlipSearch(one, other, seed)
        search.take((one, other) for one, other in (edges_of(each.trace) for each in known))
        return self._searched(search)

    def _searched(self, search: FlipSearch) -> Iterator[Sequence[Action] | None]:
        best: tuple[int, int] | None = None
        while search.possible:
            search.step()
            found = search.rounds, search.flips
            # Building the moves of a long path takes longer than many steps.
            if best is None or found[0] < best[0] or found < (best[0], best[1] - best[1] // 50):
                best = found
                yield [self._flip(quadrilateral(*corners)).action for corners in search.corners()]
            else:
                yield None

    def prepare_paths(self) -> bool:
        """Compile the search, or load what was compiled."""
        prepare()
        return True

    def _mesh(self, state: State) -> Mesh | None:
        """Return a triangulation in arrays; None if it is none, or products may overflow."""
        xy = self.plane.small
        return None if xy is None else mesh_of(xy, edges_of(state | self.kept))

    def modules_among(self, sites: Iterable[Site]) -> tuple[Edge, ...]:
        """Return the diagonals among the edges of a triangulation, in their order.

        A file lists all edges, or leaves out those that are in every triangulation; either end of
        an edge may come first.
        """
        edges = distinct_edges(sites, len(self.plane.points))
        return tuple(edge for edge in edges if edge not in self.kept)

    def modules_of(self, edges: Iterable[Edge]) -> tuple[Edge, ...]:
        """Return the edges of a triangulation that are modules, in order."""
        return tuple(sorted(edge for edge in edges if edge not in self.kept))

    # Answers about one edge or one flip are found from the points around it.

    def action(self, generator: str, at: Site) -> Action:
        """Return the flip in the quadrilateral with the corners `at`, in any order.

        Raises InputError if there is none: it names the point inside, or says why it is not convex.
        """
        if generator != "flip":
            raise InputError(f"unknown generator {generator!r}, expected one of flip")
        return self._flip_at(self._corners(at)).action

    def _flip_at(self, corners: tuple[int, int, int, int]) -> Move:
        """Return the flip in the quadrilateral with these corners; InputError if there is none."""
        if corners not in self._flips:
            why = self.plane.why_no_flip(corners)
            if why is not None:
                raise ExcludedError(f"generator 'flip': quadrilateral {list(corners)} is {why}")
            return self._flip(quadrilateral(*self.plane.ring(corners)))
        return self._flips[corners]

    def _flip(self, each: Quadrilateral) -> Move:
        """Return the flip in a quadrilateral, the same object while it is cached."""
        found = self._flips.get(each.corners)
        if found is None:
            if len(self._flips) >= FLIPS_MAX:
                self._flips.clear()
            found = self._flips[each.corners] = flip_of(each)
        return found

    def moves_at(self, site: Site) -> Iterable[Move]:
        """Return the flips of a diagonal, whatever the triangulation."""
        for edge in edges_of((site,)) if self.has_place(site) else ():
            for each in self.plane.around(edge):
                yield _beginning_at(edge, self._flip(each))

    def moves_of(self, action: Action) -> tuple[Move, ...]:
        """Return the flip from each of its diagonals, if the action is a flip."""
        diagonals = [edge for edge in in_order(action.trace) if self.has_place(edge)]
        corners = sorted({end for edge in edges_of(diagonals) for end in edge})
        if len(corners) != 4:
            return ()
        a, b, c, d = corners
        try:
            flip = self._flip_at((a, b, c, d))
        except InputError:
            return ()
        if flip.action != action:
            return ()
        return tuple(_beginning_at(edge, flip) for edge in edges_of(diagonals))

    def discovery(self) -> Callable[[Site], Iterable[Move]]:
        """Return a function that finds just the flips among the edges it was called with."""
        return _Discovery(self.plane, self._known_from).meet

    def _known_from(self, edge: Edge, ring: tuple[int, int, int, int]) -> Move:
        """Return the flip of a diagonal in an empty convex quadrilateral with these corners."""
        a, b, c, d = sorted(ring)
        found = self._flips.get((a, b, c, d))
        # What is not cached is not kept either: it is found once, and there may be millions.
        return flip_of(quadrilateral(*ring)) if found is None else _beginning_at(edge, found)

    def has_place(self, place: Site) -> bool:
        """Return whether an edge is in some triangulations and not in all of them."""
        match place:
            case (int(one), int(other)) if 0 <= one < other < len(self.plane.points):
                return (one, other) not in self.kept and not self._between(one, other)
            case _:
                return False

    # Answers that number all that could ever happen need the whole list.

    @cached_property
    def _quadrilaterals(self) -> tuple[Quadrilateral, ...]:
        return all_quadrilaterals(self.plane)

    @cached_property
    def whole(self) -> TabledSystem:
        """Return the system with its flips listed; InputError if there are too many."""
        return TabledSystem(
            map(self._flip, self._quadrilaterals),
            fixed=self.filled,
            drawing=self.drawing,
            positions=self.positions,
        )

    @property
    def listed(self) -> tuple[Move, ...]:
        """Return all flips, by the corners of their quadrilaterals, each with one direction."""
        return self.whole.listed

    @cached_property
    def places(self) -> tuple[Site, ...]:  # type: ignore[override]
        """Return all edges that are in the support of some flip."""
        return self.whole.places

    @cached_property
    def move_slots(self) -> int:  # type: ignore[override]
        """Return the greatest number of flips of one diagonal; InputError if there are too many.

        It is counted without making the flips, so that a run can be refused before it begins.
        """
        found = Counter(edge for each in self._quadrilaterals for edge in each.diagonals)
        return max(found.values())

    @cached_property
    def sense_slots(self) -> int:  # type: ignore[override]
        """Return the greatest number of edges that a diagonal senses."""
        return self.whole.sense_slots

    @cached_property
    def reach_slots(self) -> int:  # type: ignore[override]
        """Return the greatest number of edges within reach of a diagonal."""
        return self.whole.reach_slots

    def moves(self, site: Site) -> tuple[Move | None, ...]:
        """Return the flips of the diagonal at `site`, by the corners of their quadrilaterals."""
        return self.whole.moves(site)

    def sensed(self, place: Site) -> tuple[Site | None, ...]:
        """Return the edges of all quadrilaterals with this diagonal."""
        return self.whole.sensed(place)

    def listeners(self, place: Site) -> tuple[Site, ...]:
        """Return the edges from which a module senses `place`."""
        return self.whole.listeners(place)

    def reach(self, place: Site) -> tuple[Site, ...]:
        """Return the edges of possible competitors of a module at `place`."""
        return self.whole.reach(place)

    def encode_site(self, site: Site) -> tuple[int, ...]:
        """Return the number of the edge among `places`."""
        return self.whole.encode_site(site)

    def decode_site(self, numbers: Sequence[int], label: int | None) -> Site:
        """Return the edge."""
        return self.whole.decode_site(numbers, label)

    def lines(self) -> Iterable[tuple[Site, Site]]:
        """Return the pairs of edges that a flip exchanges."""
        return self.whole.lines()

    def _corners(self, at: Site) -> tuple[int, int, int, int]:
        last = len(self.plane.points) - 1
        if not (isinstance(at, tuple) and len(set(at)) == len(at) == 4):
            raise InputError(f"generator 'flip': 'at' is four points, found {at!r}")
        for corner in at:
            if not (type(corner) is int and 0 <= corner <= last):
                raise InputError(f"generator 'flip': {corner!r} is no point, expected 0 to {last}")
        a, b, c, d = sorted(at)
        return a, b, c, d

    def check_state(self, sites: Iterable[Site]) -> None:
        """Check that the edges and the fixed edges together make a triangulation."""
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
        if len(set(edges)) < len(edges):
            return  # Scene names the duplicate.
        due = 3 * len(self.plane.points) - 3 - len(self.plane.hull) - len(self.kept)
        if len(edges) != due:
            self._name_crossing(edges)
            raise InputError(f"{len(edges)} diagonals, a triangulation of these points has {due}")
        try:
            Triangles(self.plane.points, (*edges, *self.kept))
        except InputError:
            self._name_crossing(edges)
            raise

    def _name_crossing(self, edges: Sequence[Edge]) -> None:
        """Raise InputError for two edges that cross, if there are any."""
        known = [*edges, *edges_of(self.kept)]
        for place, edge in enumerate(known):
            crossed = self.plane.crossings(edge, _rows(known[place + 1 :])).nonzero()[0]
            if len(crossed):
                other = known[place + 1 + int(crossed[0])]
                raise InputError(f"edges {list(edge)} and {list(other)} cross")


_FEW = 4096
"""With more points than this, the points beside each edge would take too much memory."""


_Found = TypeVar("_Found")


class _Discovery(Generic[_Found]):
    """Flips whose four sides and one diagonal have been on, found when the last edge appears.

    Edges that were never on are ignored, so the cost is that of the visited triangulations. An
    empty triangle is found with its last side, a quadrilateral with its second triangle.
    """

    def __init__(
        self, plane: PointSet, made: Callable[[Edge, tuple[int, int, int, int]], _Found]
    ) -> None:
        """Take the points, and what to yield for a diagonal and the corners around it."""
        self._plane = plane
        self._few = len(plane.points) <= _FEW
        # By directed edge: the points on its left, as bits of an integer, if there are few.
        self._left: dict[Edge, int] = {}
        self._made = made
        self._near: dict[int, set[int]] = {}
        # By directed edge: the corners of the empty triangles on its left.
        self._apexes: dict[Edge, list[int]] = {}

    def meet(self, site: Site) -> Iterator[_Found]:
        """Yield the flips that an edge completes, each from the diagonal that has been on."""
        plane = self._plane
        for one, other in edges_of((site,)):
            near, around = self._near.setdefault(one, set()), self._near.setdefault(other, set())
            near.add(other)
            around.add(one)
            if self._few:
                self._left[one, other], self._left[other, one] = plane.sides(one, other)
            for apex in sorted(near & around):
                a, b = (one, other) if plane.left(one, other, apex) else (other, one)
                if not self._empty(a, b, apex):
                    continue
                for p, q, over in ((a, b, apex), (b, apex, a), (apex, a, b)):
                    for under in self._apexes.get((q, p), ()):
                        if plane.left(under, over, p) and plane.left(over, under, q):
                            yield self._made(edge_of(p, q), (p, under, q, over))
                    self._apexes.setdefault((p, q), []).append(over)

    def _empty(self, a: int, b: int, c: int) -> bool:
        """Return whether no other point lies in a triangle of known edges that turns left."""
        if not self._few:
            return self._plane.empty(a, b, c)
        # No edge passes through a point, so none lies on a side.
        left = self._left
        return not left[a, b] & left[b, c] & left[c, a]


POINTS_MAX = 300
"""The largest point set: random points have about three flips for every pair."""
FLIPS_MAX = 200_000
"""The most flips; n points in convex position have n (n-1) (n-2) (n-3) / 24."""


def all_quadrilaterals(plane: PointSet) -> tuple[Quadrilateral, ...]:
    """Return all quadrilaterals in which a diagonal can flip, once each, by their corners.

    Raises InputError if there are too many to list.
    """
    count = len(plane.points)
    if count > POINTS_MAX:
        raise InputError(
            f"{count} points have too many flips to list them all, expected at most {POINTS_MAX}"
        )

    def made(edge: Edge, ring: tuple[int, int, int, int]) -> Quadrilateral | None:
        """Leave out the greater of the two diagonals."""
        return quadrilateral(*ring) if edge < edge_of(ring[1], ring[3]) else None

    meet = _Discovery(plane, made).meet
    found: list[Quadrilateral] = []
    for one in range(count):
        for other in range(one + 1, count):
            if not plane.on_the_way(one, other):
                found += [each for each in meet((one, other)) if each is not None]
        if len(found) > FLIPS_MAX:
            raise InputError(f"more than {FLIPS_MAX} flips among {count} points: too many")
    return tuple(sorted(found, key=lambda each: each.corners))


def _kept(plane: PointSet) -> frozenset[Edge]:
    """Return the edges that are in every triangulation: the hull and the uncrossed edges.

    An edge that another edge crosses is missing from some triangulation. Flips reach that
    triangulation, so the edge is a diagonal of some quadrilateral. Raises InputError if there is no
    such edge.
    """
    sweeps = [plane.sweep(way) for way in SWEEPS]
    swept = Triangles(plane.points, sweeps[0])
    found = frozenset(
        edge
        for edge in frozenset.intersection(*sweeps)
        if edge in plane.hull
        or not (swept.convex(edge) or plane.can_flip(edge, swept.apexes(edge)))
    )
    if found == sweeps[0]:
        raise InputError("no quadrilateral is convex and empty, so no diagonal can flip")
    return found


def flip_of(each: Quadrilateral) -> Move:
    """Return the flip in a quadrilateral, named by its corners."""
    one, other = each.diagonals
    sides, at = each.sides, each.corners
    lesser, greater = (one, other) if one < other else (other, one)
    action = action_of_parts(
        sides | {one, other},
        frozenset((one, other)),
        (sides | {lesser}, sides | {greater}),
        label=f"flip at {list(at)}",
    )
    return Move(action, "flip", at, ((one, other),))


_CROSSED_MAX = 300
"""More edges than this are counted by walks through the other triangulation, where they can be."""


def _beginning_at(edge: Edge, move: Move) -> Move:
    if move.source == edge:
        return move
    return Move(move.action, move.generator, move.at, ((move.target, move.source),))


def crossing_bound(system: FlipSystem, start: State, goal: State) -> int:
    """Return how often the crossings of one edge must be halved until it can be there.

    The bound is the greatest ``floor(log2(k)) + 1`` over the edges of either triangulation that are
    crossed by k >= 1 edges of the other.

    Proof. Let an edge f of the goal cross k edges of the present triangulation. Then f runs through
    k + 1 triangles. Only a flip of an edge that f crosses can decrease k, by at most one; its
    quadrilateral consists of two consecutive triangles along f. Flips of one cube have no triangle
    in common, since a diagonal may not be a side of the other's quadrilateral. So one cube
    decreases k by at most floor((k + 1) / 2), to at least floor(k / 2), and f is there only when k
    is 0. Read backwards, the same holds for edges of the start.

    Where coordinates span more than 64 bits can compute, only the longest edges are counted, since
    they cross the most.

    For convex polygons, log n rounds are known to be of the right order: Galtier, Hurtado, Noy,
    Perennes and Urrutia, *Simultaneous edge flipping in triangulations* (2003).
    """
    plane, found = system.plane, [0]
    for one, other in ((start, goal), (goal, start)):
        edges = edges_of(one - other)
        if plane.small is None:
            edges = sorted(edges, key=plane.length, reverse=True)[:_CROSSED_MAX]
        found += system.halvings(other, edges)
    return max(found)


def flip_bound(system: FlipSystem, start: State, goal: State) -> int:
    """Return how many rounds the missing edges need, with as many flips at a time as possible.

    Proof. A flip brings one edge and needs two triangles; those of one cube have none in common.
    A triangulation with V points and E edges has E - V + 1 triangles (Euler).
    """
    edges = len(start | system.kept)
    triangles = edges - len(system.plane.points) + 1
    return -(-len(goal - start) // max(1, triangles // 2))


def _rows(edges: Sequence[Edge]) -> NDArray[np.intp]:
    return np.array(edges, dtype=np.intp).reshape(-1, 2)


class _PointsTable(msgspec.Struct, forbid_unknown_fields=True):
    points: list[tuple[int, int]]
