"""A search for short paths between two triangulations, of up to many thousand points.

It begins with the better of some greedy paths, then solves windows of the best path again. The path
is kept in normal form, now from one end and now from the other: in that form every flip is as near
to its own end as it can be, so the last rounds hold few flips, and the path gets shorter as soon as
they hold none. All random choices come from the seed.
"""

from __future__ import annotations

from collections.abc import Iterable
from random import Random
from typing import NamedTuple

import numpy as np

from cubepath.protocol.systems.flip_greedy import STUCK, Flips, Style
from cubepath.protocol.systems.flip_mesh import Mesh, Numbers, connect
from cubepath.protocol.systems.flip_windows import (
    Window,
    greedy,
    quadrilaterals_along,
    retry,
    settle,
)
from cubepath.protocol.systems.point_sets import Edge

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
        style = Style(1.0, 0.0 if number < 2 else 0.3, 1)
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
        style = Style(random.choice(_POWERS), random.choice(_NOISES), random.choice(_TRIES))
        limit = width - 1 if random.random() < _SHORTER else width
        window = Window(last - width + 1, last, limit)
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
    retry(start, path, Window(1, 1, 0), Style(1.0, 0.0, 0), np.ones(1, dtype=np.int64))
