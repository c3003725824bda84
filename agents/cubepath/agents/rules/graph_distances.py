"""Distances on the static graph, for the rules of vehicles.

All vehicles of a process share a graph, so each result is computed once for all of them.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from functools import lru_cache
from weakref import WeakKeyDictionary

from cubepath.protocol.core.system import VehicleGraph

_OPEN = -1
"""Instead of a vertex: none is closed."""
_TABLE_ENTRIES = 1 << 24


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
