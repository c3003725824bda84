"""A search that walks while it learns: bounded thought before each walk, and no lost ends.

Source: Koenig and Sun, Comparing real-time and incremental heuristic search for real-time situated
agents (LSS-LRTA*, 2009), after Korf, Real-time heuristic search (1990); with estimates that need
not be consistent, and states that can be entered from wherever they lead.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from heapq import heappop, heappush
from typing import Generic, TypeVar

S = TypeVar("S", bound=Hashable)
T = TypeVar("T")


@dataclass
class RealTimeSearch(Generic[S, T]):
    """Finds the next steps towards a goal, and remembers what it has learned about states.

    `near` returns the steps from a state with the states that they lead to; for each step there is
    one back. `estimate` is how far a state may be from the goal: at least 0, and 0 only there.

    Guarantee. If the goal can be reached from the start, and finitely many states can, then walks,
    each from the end of the last, come to the goal. Let h be the learned distances, at first the
    estimates, M the greatest estimate and d the true distance. Learning raises h(s) to 1 + min h
    over the states one step away where it was less, so h <= M + d stays true: the right side falls
    by one along a shortest path. A step leads from s to a t with h(t) <= h(s) - 1. So the sum of h
    over all states, less h where the walk stands, is a whole number that never falls, rises by at
    least one with each step, and is bounded.

    >>> line = RealTimeSearch(near=lambda x: [(1, x + 1), (-1, x - 1)], estimate=abs)
    >>> line.walk(3, most=2)
    [-1, -1]
    """

    near: Callable[[S], Sequence[tuple[T, S]]]
    estimate: Callable[[S], int]
    horizon: int = 100
    """How many states are expanded before each walk."""
    _learned: dict[S, int] = field(default_factory=dict[S, int])

    def distance(self, state: S) -> int:
        """Return how far a state seems to be from the goal; remembered, and never less later."""
        if state not in self._learned:
            self._learned[state] = self.estimate(state)
        return self._learned[state]

    def walk(self, state: S, most: int) -> list[T] | None:
        """Return the next steps, at most `most`; none at the goal, None if it cannot be reached."""
        inside = self._expanded(state)
        if inside and not self._learn(inside):
            return None
        steps: list[T] = []
        while state in inside and len(steps) < most:
            step, state = min(inside[state], key=lambda way: self.distance(way[1]))
            steps.append(step)
        return steps

    def _expanded(self, start: S) -> dict[S, Sequence[tuple[T, S]]]:
        """Return the steps from the states that look best, in the order in which they were met."""
        inside: dict[S, Sequence[tuple[T, S]]] = {}
        met = {start}
        queue = [(self.distance(start), 0, start)]
        while queue and len(inside) < self.horizon and self.distance(queue[0][2]):
            state = heappop(queue)[2]
            inside[state] = self.near(state)
            for _, there in inside[state]:
                if there not in met:
                    met.add(there)
                    heappush(queue, (self.distance(there), len(met), there))
        return inside

    def _learn(self, inside: dict[S, Sequence[tuple[T, S]]]) -> bool:
        """Raise the distances of the states inside by those around; return whether there are any.

        States are settled by increasing distance, as Dijkstra's algorithm does: a state inside is
        one step farther than the nearest next to it, and no nearer than it was.
        """
        back: dict[S, list[S]] = {}
        for state, ways in inside.items():
            for _, there in ways:
                back.setdefault(there, []).append(state)
        border = [state for state in back if state not in inside]
        queue = [(self.distance(state), number, state) for number, state in enumerate(border)]
        queue.sort()
        met = len(queue)
        settled: set[S] = set(border)
        while queue:
            distance, _, state = heappop(queue)
            for before in back.get(state, ()):
                if before not in settled:
                    settled.add(before)
                    met += 1
                    self._learned[before] = max(self.distance(before), distance + 1)
                    heappush(queue, (self._learned[before], met, before))
        return bool(border)
