"""Lower bounds on the number of cubes between two states, whatever the homotopy class.

Each bound is a few lines with its proof beside it; the greatest of them counts. What they have in
common: the moves of one cube write disjoint sets of sites, so in one round a module takes part in
at most one move.

Room: coordinator; touches nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from cubepath.protocol.core.actions import State
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import System
from cubepath.protocol.systems.flips import FlipSystem
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.systems.lattice import LatticeSystem
from cubepath.protocol.systems.listed import TabledSystem
from cubepath.protocol.systems.point_sets import Edge

Neighbours = Callable[[Site], Iterable[Site]]


@dataclass(frozen=True, slots=True)
class Bound:
    """No path has fewer than `cubes` cubes; `why` names the argument, for people."""

    cubes: int
    why: str


def lower_bound(system: System | None, start: State, goal: State, *, within: int) -> Bound:
    """Return the greatest of the bounds that hold for the system.

    `within` is the number of cubes of some path that is known, which bounds all searches. Without
    a system nothing is known of its moves but that they change something.
    """
    found = [Bound(0 if start == goal else 1, "the ends differ" if start != goal else "no move")]
    if system is not None and start != goal:
        found.append(Bound(module_bound(system, start, goal, within=within), "way of a module"))
    if isinstance(system, FlipSystem) and start != goal:
        found.append(Bound(crossing_bound(system, start, goal), "an edge's crossings halve"))
        found.append(Bound(flip_bound(system, start, goal), "flips at one time"))
    return max(found, key=lambda bound: bound.cubes)


def module_bound(system: System, start: State, goal: State, *, within: int) -> int:
    """Return how far the module that has the farthest way must go, when all are paired best.

    Definition. Let two sites be neighbours where some move of the system takes a module from one to
    the other, and the distance of sites that in this graph, whatever else stands there. The bound
    is the least r such that the modules at the start can be paired with the sites that are on
    at the goal at distances of at most r (bottleneck matching). For labelled vehicles the pairing
    is forced, and this is the longest shortest path; for words, the letters of a position.

    Proof. Follow the modules through any path to the goal: a move takes each module of its trace
    to one site of it, one to one, so this pairs start and goal. The moves of a cube write disjoint
    sites, so a cube takes no module further than to a neighbour, and the path has at least as many
    cubes as the farthest pair of *its* pairing is apart; the least over all pairings is no more.

    Where a move does not take modules one to one (a file may say so), each end is only compared
    with the nearest other. 0 for a system of an unknown kind. Costs a breadth-first search for each
    module and augmenting paths over all pairs: modules^2 to modules^3 steps.
    """
    found = neighbours_of(system)
    if found is None:
        return 0
    near, one_to_one = found
    sources, targets = in_order(start - system.filled), in_order(goal - system.filled)
    if isinstance(system, GraphSystem) and system.labels is not None:
        return _farthest(near, sources, targets, within)
    if isinstance(system, LatticeSystem) and system.workspace is None and not system.obstacles:
        away = _free_distances(system, near, sources, targets, within)
    else:
        away = [_distances(near, site, targets, within) for site in sources]
    if one_to_one and len(sources) == len(targets):
        return bottleneck(away, within)
    rows = [min(row, default=0) for row in away]
    columns = [min(column) for column in zip(*away, strict=True)]
    return min(within, max(rows + columns, default=0))


def neighbours_of(system: System) -> tuple[Neighbours, bool] | None:
    """Return where a module at a site can go by some move, and whether that is one to one."""
    if isinstance(system, GraphSystem):
        return _along_edges(system), True
    if isinstance(system, LatticeSystem):
        return _on_lattice(system)
    if isinstance(system, TabledSystem):
        listed: dict[Site, dict[Site, None]] = {}
        for move in system.listed:
            for one, other in move.motion:
                listed.setdefault(one, {})[other] = None
                listed.setdefault(other, {})[one] = None
        return (lambda site: listed.get(site, {})), _one_to_one(m.motion for m in system.listed)
    return None


def _one_to_one(all_goes: Iterable[Sequence[tuple[Site, Site]]]) -> bool:
    return all(
        len({source for source, _ in motion})
        == len({target for _, target in motion})
        == len(motion)
        for motion in all_goes
    )


def _along_edges(system: GraphSystem) -> Neighbours:
    def near(site: Site) -> Iterable[Site]:
        place = system.place_of(site)
        if system.labels is None or not isinstance(site, tuple):
            return system.listeners(place)
        return [(other, site[1]) for other in system.listeners(place)]

    return near


def _on_lattice(system: LatticeSystem) -> tuple[Neighbours, bool]:
    """Return the neighbours under all placings, also those whose support does not fit."""
    catalogue = system.catalogue
    lattice = catalogue.lattice
    pairs = [
        pair
        for generator in catalogue.generators
        for one, other in generator.motion
        for pair in ((one, other), (other, one))
    ]

    def near(site: Site) -> Iterable[Site]:
        cell = lattice.check(site)
        found: dict[Site, None] = {}
        for source, target in pairs:
            by = lattice.between(source, cell)
            if by is not None:
                found[lattice.shift(target, by)] = None
        return [other for other in found if system.has_place(other)]

    return near, _one_to_one(generator.motion for generator in catalogue.generators)


def _distances(near: Neighbours, site: Site, targets: Sequence[Site], within: int) -> list[int]:
    """Return the distance of each target from a site, `within` + 1 where it is no nearer."""
    waiting, known, layer, distance = set(targets), {site}, [site], 0
    found = dict.fromkeys(targets, within + 1)
    while layer:
        for here in layer:
            if here in waiting:
                waiting.remove(here)
                found[here] = distance
        if not waiting or distance == within:
            break
        distance += 1
        following: list[Site] = []
        for here in layer:
            for there in near(here):
                if there not in known:
                    known.add(there)
                    following.append(there)
        layer = following
    return [found[target] for target in targets]


def _farthest(
    near: Neighbours, sources: Sequence[Site], targets: Sequence[Site], within: int
) -> int:
    """Return the longest of the shortest paths of labelled vehicles."""
    ends = {site[1]: site for site in targets if isinstance(site, tuple)}
    labelled = [(site, ends[site[1]]) for site in sources if isinstance(site, tuple)]
    return min(within, max(_distances(near, one, [end], within)[0] for one, end in labelled))


def _free_distances(
    system: LatticeSystem,
    near: Neighbours,
    sources: Sequence[Site],
    targets: Sequence[Site],
    within: int,
) -> list[list[int]]:
    """Return all distances on a lattice without obstacles, where only the difference counts."""
    catalogue, lattice = system.catalogue, system.catalogue.lattice
    cells = [lattice.check(site) for site in sources]
    shifted = [
        [
            lattice.shift(lattice.check(site), tuple(-by for by in cell[: lattice.dimension]))
            for site in targets
        ]
        for cell in cells
    ]
    known: dict[Site, dict[Site, int]] = {}
    for orbit in dict.fromkeys(map(catalogue.orbit, cells)):
        mine = [
            row for cell, row in zip(cells, shifted, strict=True) if catalogue.orbit(cell) == orbit
        ]
        wanted = in_order({site for row in mine for site in row})
        known[orbit] = dict(zip(wanted, _distances(near, orbit, wanted, within), strict=True))
    return [
        [known[catalogue.orbit(cell)][site] for site in row]
        for cell, row in zip(cells, shifted, strict=True)
    ]


def bottleneck(away: Sequence[Sequence[int]], within: int) -> int:
    """Return the least r, at most `within`, so that a perfect matching has all entries up to r.

    `away` is a square matrix. The threshold rises from the greatest of the least entries of rows
    and columns, and augmenting paths extend the matching that is already there.

    >>> bottleneck([[0, 2], [1, 5]], 9)
    2
    """
    if not away:
        return 0
    columns = list(zip(*away, strict=True))
    threshold: int = max(*map(min, away), *map(min, columns))
    entries = sorted({entry for row in away for entry in row if entry > threshold})
    row_of: list[int | None] = [None] * len(away)
    for row in range(len(away)):
        while threshold < within and not _augment(away, row, row_of, threshold):
            threshold = entries.pop(0) if entries else within
    return min(threshold, within)


def _augment(
    away: Sequence[Sequence[int]], row: int, row_of: list[int | None], threshold: int
) -> bool:
    """Find a column for a row, breadth first; rows that have one may change it for another."""
    came: dict[int, int] = {}
    waiting = [row]
    for one in waiting:
        for column, entry in enumerate(away[one]):
            if entry > threshold or column in came:
                continue
            came[column] = one
            holder = row_of[column]
            if holder is not None:
                waiting.append(holder)
                continue
            held = {other: place for place, other in enumerate(row_of) if other is not None}
            free: int | None = column
            while free is not None:
                owner = came[free]
                row_of[free] = owner
                free = held.get(owner)
            return True
    return False


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
