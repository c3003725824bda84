"""Distances on the static graph, for the rules of vehicles.

All vehicles of a process share a graph, so each result is computed once for all of them.
"""

from __future__ import annotations

from array import array
from collections.abc import Collection, Iterable
from functools import lru_cache
from typing import TypeAlias
from weakref import WeakKeyDictionary

from cubepath.protocol.core.system import VehicleGraph

_OPEN = -1
"""Instead of a vertex: none is closed."""
_TABLE_ENTRIES = 1 << 24
Traveller: TypeAlias = tuple[int, int]
"""Where a vehicle stands, and its goal."""


class Roads:
    """Distances on a static graph, with vertices by number.

    The vehicles of a process share it; it holds nothing about them. It keeps no reference to the
    graph, so the graph can be garbage-collected.
    """

    def __init__(self, near: Iterable[Iterable[int]]) -> None:
        """Take the neighbours of each vertex; cached tables are bounded by their total entries."""
        self.near = tuple(tuple(around) for around in near)
        size = max(1, _TABLE_ENTRIES // len(self.near))
        self.distances = lru_cache(maxsize=size)(self._distances)

    def _distances(self, goal: int, closed: int = _OPEN) -> array[int]:
        """Return every vertex's distance to `goal`; -1 if no way avoids `closed`."""
        found = array("i", [-1]) * len(self.near)
        found[goal] = 0
        rim = [goal]
        while rim:
            further: list[int] = []
            for vertex in rim:
                for other in self.near[vertex]:
                    if found[other] < 0 and other != closed:
                        found[other] = found[vertex] + 1
                        further.append(other)
            rim = further
        return found

    def nearer(self, vertex: int, goal: int) -> list[int]:
        """Return the neighbours of a vertex that are nearer to the goal, by increasing number."""
        distance = self.distances(goal)
        return [other for other in self.near[vertex] if distance[other] == distance[vertex] - 1]

    def deeper(self, pusher: int, pushed: int, at: int) -> list[int]:
        """Return where a vehicle at `at` pushes to: to `pushed`, or one further from it.

        The distance from `pushed`, the depth, is that on the map without the vertex `pusher`.
        """
        if at == pusher:
            return [pushed]
        depth = self.distances(pushed, pusher)
        return [other for other in self.near[at] if depth[other] == depth[at] + 1]

    def swap(self, pusher: Traveller, pushed: Traveller, shut: Collection[int]) -> bool:
        """Return whether one vehicle must change places with its neighbour, and can.

        It must if it would push the other along a corridor that leads nowhere else, or along which
        the other has its goal, so that the other will want to pass it again. It can if behind it
        there is a junction, where one lets the other pass. Vehicles stay on the vertices `shut`.
        Source: Okumura, Improving LaCAM (swap operation). Both look only at the static map.
        """
        return self._must_swap(pusher, pushed, shut) and self._can_swap(pusher[0], pushed[0], shut)

    def _must_swap(self, pusher: Traveller, pushed: Traveller, shut: Collection[int]) -> bool:
        (at, goal), (ahead, other_goal) = pusher, pushed
        mine, others = self.distances(goal), self.distances(other_goal)
        while mine[ahead] < mine[at]:
            ways = self._onward(at, ahead, shut)
            if len(ways) > 1:
                return False
            if not ways:
                break
            at, ahead = ahead, ways[0]
        return others[at] < others[ahead] and (at == goal or mine[ahead] < mine[at])

    def _can_swap(self, at: int, ahead: int, shut: Collection[int]) -> bool:
        first = at
        ways = self._onward(ahead, at, shut)
        while len(ways) == 1 and ways[0] != first:
            at, ahead = ways[0], at
            ways = self._onward(ahead, at, shut)
        return len(ways) > 1

    def _onward(self, origin: int, at: int, shut: Collection[int]) -> list[int]:
        """Return where a vehicle that came to `at` from `origin` can go on to."""
        return [way for way in self.near[at] if way != origin and way not in shut]


_roads: WeakKeyDictionary[VehicleGraph, Roads] = WeakKeyDictionary()


def roads_of(graph: VehicleGraph) -> Roads:
    """Return the roads of a graph, shared by all vehicles in this process."""
    found = _roads.get(graph)
    if found is None:
        index = graph.index
        found = _roads[graph] = Roads(
            sorted(index[other] for other in graph.near[vertex]) for vertex in graph.vertices
        )
    return found
