"""A search for short paths between two triangulations, of up to many thousand points.

It begins with the better of some greedy paths, then solves windows of the best path again. The path
is kept in normal form, alternately from one end and from the other: in that form every flip is as
near to its end as it can be, so the last rounds hold few flips, and the path gets shorter as soon
as they hold none. All random choices come from the seed.

A window is some consecutive rounds. The edges that flip in it fall into parts that share no
triangle, so each part is a small separate task: from its edges before the window to those after it.
A part that takes all rounds of the window is solved again, greedily from either end, in one round
less. If that succeeds for all such parts of the last rounds, the path is one round shorter.
"""

from collections.abc import Iterable
from random import Random
from typing import NamedTuple

import numpy as np

from cubepath.protocol.compiled import compiled, inner
from cubepath.protocol.systems.flip_greedy import (
    STUCK,
    Flips,
    FlipTask,
    GreedyStyle,
    Mesh,
    Numbers,
    connect,
    convex,
    draw,
    flip,
    room_for,
    run,
    run_often,
    undo,
)
from cubepath.protocol.systems.point_sets import Edge

_ROOM = 8
"""Room for this many times as many flips as there were, or as there are edges."""
_BACK = 0.5
"""The share of parts that are solved from their end."""


@inner
def _copy(mesh: Mesh) -> Mesh:
    return Mesh(mesh.xy, mesh.ends.copy(), mesh.apex.copy(), mesh.side.copy(), mesh.spoke.copy())


@inner
def set_spokes(mesh: Mesh) -> None:
    """Note an edge at each point, after flips."""
    for edge in range(len(mesh.ends)):
        mesh.spoke[mesh.ends[edge, 0]] = edge
        mesh.spoke[mesh.ends[edge, 1]] = edge


@compiled
def settle(mesh: Mesh, edges: Numbers) -> tuple[Flips, int]:
    """Return flips of a mesh in normal form: as early as possible, and without those taken back.

    The mesh is changed to the one at the end. The second result is `STUCK` if one of them cannot
    flip, and else 0. A flip follows the last flips of its edge and of the four sides, since the
    last flip of a triangle's three edges is the one that made the triangle.
    """
    count = len(edges)
    last = np.full(len(mesh.ends), -1, dtype=np.int64)
    before = np.empty(count, dtype=np.int64)
    level = np.zeros(count, dtype=np.int64)
    for place, edge in enumerate(edges):
        if not convex(mesh, edge):
            return Flips(edges[:0], edges[:0]), STUCK
        under = 0
        for way in range(4):
            other = last[mesh.side[edge, way]]
            if other >= 0:
                under = max(under, level[other])
        own = level[last[edge]] if last[edge] >= 0 else 0
        flip(mesh, edge)
        if own > under:
            # Nothing near has changed since this edge flipped: both leave no trace.
            level[last[edge]] = 0
            last[edge] = before[last[edge]]
            continue
        level[place] = max(own, under) + 1
        before[place] = last[edge]
        last[edge] = place
    order = np.argsort(level, kind="mergesort")
    order = order[level[order] > 0]
    return Flips(edges[order], level[order]), 0


@inner
def _root(parent: Numbers, edge: int) -> int:
    while parent[edge] != edge:
        parent[edge] = parent[parent[edge]]
        edge = parent[edge]
    return edge


class RoundWindow(NamedTuple):
    """Some rounds of a path, from `first` to `last`, whose parts may take at most `limit`."""

    first: int
    last: int
    limit: int


class _Parts(NamedTuple):
    """Edges sorted into parts: the part of each, -1 for none; where the parts begin; the edges."""

    of: Numbers
    begins: Numbers
    edges: Numbers


@inner
def _between(path: Flips, window: RoundWindow) -> tuple[int, int]:
    """Return the places of a path where a window begins and ends."""
    low = np.searchsorted(path.round, window.first, side="left")
    return int(low), int(np.searchsorted(path.round, window.last, side="right"))


@inner
def _parts(mesh: Mesh, flipped: Numbers) -> _Parts:
    """Sort flipped edges into parts: those that have a triangle in common are of one.

    Then edges of two parts never have a triangle in common later: the flip that first gave them one
    would be of an edge that had a triangle in common with both.
    """
    edges = len(mesh.ends)
    parent = np.full(edges, -1, dtype=np.int64)
    for edge in flipped:
        parent[edge] = edge
    for edge in flipped:
        for place in range(4):
            side = mesh.side[edge, place]
            if parent[side] >= 0:
                parent[_root(parent, side)] = _root(parent, edge)
    begins = np.zeros(edges + 1, dtype=np.int64)
    for edge in range(edges):
        if parent[edge] >= 0:
            parent[edge] = _root(parent, edge)
            begins[parent[edge] + 1] += 1
    for edge in range(edges):
        begins[edge + 1] += begins[edge]
    filled = begins[:-1].copy()
    members = np.empty(begins[-1], dtype=np.int64)
    for edge in range(edges):
        if parent[edge] >= 0:
            members[filled[parent[edge]]] = edge
            filled[parent[edge]] += 1
    return _Parts(parent, begins, members)


@inner
def _match(one: Mesh, other: Mesh, edges: Numbers, into: Numbers) -> bool:
    """Write the number in `other` of each of the edges of `one`; return whether all are there."""
    width = len(one.xy)
    mine, its = np.empty(len(edges), dtype=np.int64), np.empty(len(edges), dtype=np.int64)
    for place, edge in enumerate(edges):
        a, b = one.ends[edge, 0], one.ends[edge, 1]
        mine[place] = min(a, b) * width + max(a, b)
        a, b = other.ends[edge, 0], other.ends[edge, 1]
        its[place] = min(a, b) * width + max(a, b)
    by_mine, by_its = np.argsort(mine), np.argsort(its)
    for place in range(len(edges)):
        if mine[by_mine[place]] != its[by_its[place]]:
            return False
    for place in range(len(edges)):
        into[edges[by_mine[place]]] = edges[by_its[place]]
    return True


@inner
def _renamed(task: FlipTask, back: int, flips: Flips, count: int, into: Numbers) -> Numbers:
    """Return the flips that solve a part, from its beginning on, as edges of the beginning.

    `back` is 1 if the task begins at the end, else 0. `into` becomes what the edges of the old end
    are called at the new one. No flips are returned if they do not lead to the goal.
    """
    for edge in flips.edge[:count]:
        flip(task.mesh, edge)
    old, new = (task.mesh, task.goal) if back else (task.goal, task.mesh)
    fits = _match(old, new, task.edges, into)
    undo(task.mesh, flips, count)
    if not fits:
        return flips.edge[:0]
    return into[flips.edge[:count][::-1]] if back else flips.edge[:count].copy()


@compiled
def retry(
    base: Mesh, path: Flips, window: RoundWindow, style: GreedyStyle, random: Numbers
) -> tuple[Numbers, int, int]:
    """Solve the parts of a window again that reach its last round.

    `path` is in normal form from `base` on. Return the edges of the new path, the number of such
    parts, and how many were solved again. `random` is the state of the random numbers.
    """
    edges = len(base.ends)
    low, high = _between(path, window)
    start = _copy(base)
    for edge in path.edge[:low]:
        flip(start, edge)
    end = _copy(start)
    for edge in path.edge[low:high]:
        flip(end, edge)
    set_spokes(start)
    set_spokes(end)
    parts = _parts(start, path.edge[low:high])
    most = _ROOM * (high - low) + _ROOM
    flips = Flips(np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64))
    new = np.empty(most, dtype=np.int64)
    done = np.zeros(edges, dtype=np.int64)
    weights, into, room = np.ones(edges), np.arange(edges), room_for(edges, random)
    late = solved = fresh = 0
    for edge in path.edge[low:high][path.round[low:high] == window.last]:
        part = parts.of[edge]
        if done[part]:
            continue
        done[part] = 1
        late += 1
        own = parts.edges[parts.begins[part] : parts.begins[part + 1]]
        back = int(draw(random) < _BACK)
        task = FlipTask(end if back else start, start if back else end, weights, own)
        rounds, many = run_often(task, window.limit, style, room, flips)
        weights[own] = 1.0
        if rounds == STUCK or fresh + many > most:
            continue
        found = _renamed(task, back, flips, many, into)
        if len(found) < many:
            continue
        new[fresh : fresh + many] = found
        fresh += many
        done[part] = 2
        solved += 1
    within = path.edge[low:high]
    kept = within[done[parts.of[within]] < 2]
    parts_of_path = (path.edge[:low], kept, new[:fresh], into[path.edge[high:]])
    return np.concatenate(parts_of_path), late, solved


@compiled
def greedy(
    base: Mesh, goal: Mesh, limit: int, style: GreedyStyle, random: Numbers
) -> tuple[Numbers, int]:
    """Flip a mesh until it is the goal; return the edges that flipped, and the rounds.

    The rounds are `STUCK` if that takes more than `limit`, or fails. The mesh is as before.
    """
    edges = len(base.ends)
    most = _ROOM * edges
    while True:
        flips = Flips(np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64))
        task = FlipTask(_copy(base), goal, np.ones(edges), np.arange(edges))
        begun = random.copy()
        rounds, count = run(task, limit, style, room_for(edges, random), flips)
        if count < most:
            return flips.edge[:count].copy(), rounds
        # More flips than expected: the same again with more room.
        most *= _ROOM
        random[:] = begun


@compiled
def quadrilaterals_along(mesh: Mesh, edges: Numbers) -> Numbers:
    """Flip edges one after another; return the corners of each flip, counter-clockwise.

    The mesh is changed. Shape (flips, 4); the first and the third corner are the ends of the edge.
    """
    found = np.empty((len(edges), 4), dtype=np.int64)
    for place in range(len(edges)):
        edge = edges[place]
        found[place, 0], found[place, 2] = mesh.ends[edge, 0], mesh.ends[edge, 1]
        found[place, 1], found[place, 3] = mesh.apex[edge, 1], mesh.apex[edge, 0]
        flip(mesh, edge)
    return found


Corners = tuple[int, int, int, int]
"""The corners of a quadrilateral, counter-clockwise, the diagonal before the flip first."""

_BEGINNINGS = 8
"""Greedy paths at the beginning."""
_ROUNDS_MAX = 1 << 20
_PATIENCE = 6
"""Windows tried in vain before the path is turned."""
_POWERS = (0.5, 1.0, 1.0, 2.0)
_NOISES = (0.0, 0.1, 0.3, 1.0)
_TRIES = (1, 4, 16)
_TAIL = 0.8
"""The exponent of the Pareto distribution of the widths of windows."""
_AT_THE_END = 0.7
"""The share of windows that end with the last round."""
_SHORTER = 0.7
"""The share of windows that are to be a round shorter; the others may only come out differently."""


class _Cost(NamedTuple):
    rounds: int
    late: int
    """The flips of the last round."""
    flips: int


def mesh_of(xy: Numbers, edges: Iterable[Edge]) -> Mesh | None:
    """Return the triangulation with these edges, numbered in order; None if it is none."""
    ends = np.array(sorted(edges), dtype=np.int64).reshape(-1, 2)
    count = len(ends)
    mesh = Mesh(
        xy,
        ends,
        np.empty((count, 2), dtype=np.int64),
        np.empty((count, 4), dtype=np.int64),
        np.empty(len(xy), dtype=np.int64),
    )
    return mesh if connect(mesh) else None


def copy_of(mesh: Mesh) -> Mesh:
    """Return a mesh that flips on its own."""
    return Mesh(mesh.xy, *(each.copy() for each in mesh[1:]))


class FlipSearch:
    """The best path between two triangulations so far; it never gets longer."""

    def __init__(self, start: Mesh, goal: Mesh, seed: int) -> None:
        """Take two triangulations of the same points."""
        self._first, self._goal = start, goal
        self._random = Random(seed)  # noqa: S311 - nothing secret
        self._state = np.array([1 + seed % 2147483646], dtype=np.int64)
        self._base, self._turned, self._vain = start, False, 0
        self._path: Flips | None = None
        self._cost = _Cost(_ROUNDS_MAX, 0, 0)
        self._begun = 0

    @property
    def rounds(self) -> int:
        """Return the number of rounds, a great number if no path is known."""
        return self._cost.rounds

    @property
    def flips(self) -> int:
        """Return the number of flips."""
        return self._cost.flips

    @property
    def possible(self) -> bool:
        """Return whether there is anything left to try."""
        return self._begun < _BEGINNINGS or (self._path is not None and self.rounds > 1)

    def take(self, changes: Iterable[tuple[Edge, Edge]]) -> None:
        """Take a known path, as the two edges of each flip, in any order; ignore what is none."""
        numbers = {(one, other): n for n, (one, other) in enumerate(self._first.ends.tolist())}
        edges: list[int] = []
        for one, other in changes:
            old, new = (one, other) if one in numbers else (other, one)
            if old not in numbers:
                return
            numbers[new] = numbers.pop(old)
            edges.append(numbers[new])
        if numbers.keys() == {(one, other) for one, other in self._goal.ends.tolist()}:
            self._propose(self._first, np.array(edges, dtype=np.int64), turned=False)

    def step(self) -> None:
        """Do a bounded piece of work: a greedy path, or a window."""
        if self._begun < _BEGINNINGS:
            self._begin()
        elif self.possible:
            self._window()

    def _begin(self) -> None:
        number, turned = self._begun, self._begun % 2 == 1
        self._begun += 1
        one, other = (self._goal, self._first) if turned else (self._first, self._goal)
        style = GreedyStyle(1.0, 0.0 if number < 2 else 0.3, 1)
        edges, rounds = greedy(one, other, _ROUNDS_MAX, style, self._state)
        if rounds != STUCK:
            self._propose(one, edges, turned=turned)

    def _propose(self, base: Mesh, edges: Numbers, *, turned: bool) -> None:
        """Take a path from one of the two ends if it is better."""
        path, error = settle(copy_of(base), edges)
        if error or (cost := _cost(path)) >= self._cost:
            return
        self._base, self._path, self._cost, self._turned = base, path, cost, turned
        self._vain = 0

    def _window(self) -> None:
        path, random = self._path, self._random
        if path is None:
            return
        if self._vain > _PATIENCE:
            path = self._turn(path)
        rounds = self.rounds
        width = min(rounds, 2 + int(random.paretovariate(_TAIL)))
        last = rounds if random.random() < _AT_THE_END else random.randint(width, rounds)
        style = GreedyStyle(random.choice(_POWERS), random.choice(_NOISES), random.choice(_TRIES))
        limit = width - 1 if random.random() < _SHORTER else width
        window = RoundWindow(last - width + 1, last, limit)
        edges, _, solved = retry(self._base, path, window, style, self._state)
        self._vain += 1
        if not solved:
            return
        new, error = settle(copy_of(self._base), edges)
        cost = _cost(new)
        if not error and cost[:2] <= self._cost[:2]:
            if cost[:2] < self._cost[:2]:
                self._vain = 0
            self._path, self._cost = new, cost

    def _turn(self, path: Flips) -> Flips:
        """Go through the same path from its other end."""
        base = copy_of(self._base)
        settle(base, path.edge)
        path, _ = settle(copy_of(base), path.edge[::-1].copy())
        self._base, self._path, self._cost = base, path, _cost(path)
        self._turned, self._vain = not self._turned, 0
        return path

    def corners(self) -> list[Corners]:
        """Return the quadrilaterals of the flips of the best path, from the start to the goal."""
        if self._path is None:
            return []
        mesh = copy_of(self._base)
        rows = quadrilaterals_along(mesh, self._path.edge)
        if self._turned:
            rows = rows[::-1]
        return [(a, b, c, d) for a, b, c, d in rows.tolist()]


def _cost(path: Flips) -> _Cost:
    if not len(path.round):
        return _Cost(0, 0, 0)
    last = int(path.round[-1])
    return _Cost(last, int((path.round == last).sum()), len(path.round))


def prepare() -> None:
    """Compile everything here, or load what was compiled, so that no timed search waits for it."""
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.int64)
    sides = ((0, 1), (1, 2), (2, 3), (0, 3))
    start, goal = mesh_of(square, [*sides, (0, 2)]), mesh_of(square, [*sides, (1, 3)])
    if start is None or goal is None:
        raise AssertionError("a square with a diagonal is a triangulation")
    search = FlipSearch(start, goal, 0)
    search.step()
    search.corners()
    path = Flips(np.zeros(1, dtype=np.int64), np.ones(1, dtype=np.int64))
    retry(start, path, RoundWindow(1, 1, 0), GreedyStyle(1.0, 0.0, 0), np.ones(1, dtype=np.int64))
