"""How many moves each site of a finite system is from a module's goals, if nobody is in the way.

It follows from the static map and the goals, which a module knows from birth.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import FIRST_LABEL, MODULE, System

Hops: TypeAlias = NDArray[np.uint16]
"""The number of moves from each site, by number, to the nearest goal; `NEVER` without a way."""

NEVER = (1 << 16) - 1
"""More than any number of moves: there are at most so many sites."""


class Sites:
    """The sites of a finite system by number, and from which of them a move leads to which.

    A label makes no difference, so in a labelled system the sites are the places. No reference to
    the system is kept, so that what is cached for a system does not keep it.
    """

    def __init__(self, system: System) -> None:
        """Number the sites and list the moves between them."""
        self._index, arcs = _roads(system) if system.graph is not None else _moves(system)
        self.count = len(self._index)
        self._at_place: dict[Site, list[int]] = {}
        """The numbers of the sites at each place with letters."""
        if system.letters:
            for site, number in self._index.items():
                self._at_place.setdefault(system.place_of(site), []).append(number)
        self._targets: dict[Site, tuple[int, NDArray[np.intp]]] = {}
        rows = np.array(arcs, np.int64).reshape(-1, 2)
        rows = rows[rows[:, 1].argsort(kind="stable")]
        # The sites from which a move leads to site i are sources[first[i]:first[i + 1]].
        self._sources = rows[:, 0].copy()
        self._first = np.searchsorted(rows[:, 1], np.arange(self.count + 1))

    def hops(self, goals: Iterable[Site]) -> Hops:
        """Return how many moves each site is from the nearest of these places or sites."""
        ends: set[int] = set()
        for goal in goals:
            ends.update(self._at_place.get(goal, ()))
            if goal in self._index:
                ends.add(self._index[goal])
        queue = np.zeros(self.count, np.int64)
        queue[: len(ends)] = sorted(ends)
        found = np.full(self.count, NEVER, np.uint16)
        found[queue[: len(ends)]] = 0
        spread = _spread.for_work(self.count + len(self._sources), by_entries=True)
        spread(self._first, self._sources, found, queue, len(ends))
        return found

    def targets(self, system: System, site: Site) -> tuple[int, NDArray[np.intp]]:
        """Return the number of a site, and by move slot that of the site where its move ends.

        The latter has shape ``(move_slots,)``; a slot without a move has the site itself.
        """
        key = _key(system, site)
        known = self._targets.get(key)
        if known is None:
            own = self._index[key]
            ends = [
                own if move is None else self._index[_key(system, move.target)]
                for move in system.moves(site)
            ]
            known = self._targets[key] = own, np.array(ends, np.intp)
        return known


def sites_of(system: System) -> Sites | None:
    """Return the sites of a system, numbered; None for a lattice and where there are too many.

    A lattice may have no end, and where its goals lie is told by coordinates. Elsewhere a table for
    each module takes two bytes for each site. Each letter counts at each place.
    """
    if system.catalogue is not None or not system.bounded:
        return None
    if not 0 < len(system.places) * max(1, len(system.letters)) <= NEVER:
        return None
    found = Sites(system)
    return found if found.count <= NEVER else None


def _key(system: System, site: Site) -> Site:
    return site if system.labels is None else system.place_of(site)


def _roads(system: System) -> tuple[Mapping[Site, int], list[tuple[int, int]]]:
    """Return the numbers of the vertices, and the two ends of each road, both ways."""
    graph = system.graph
    if graph is None:
        raise AssertionError("a system without a graph has no roads")
    index = graph.index
    return index, [
        (index[vertex], index[other]) for vertex in graph.vertices for other in graph.near[vertex]
    ]


def _moves(system: System) -> tuple[Mapping[Site, int], list[tuple[int, int]]]:
    """Return the numbers of the sites, and where each move begins and ends."""
    codes = (MODULE, *range(FIRST_LABEL, FIRST_LABEL + len(system.letters)))
    if system.labels is not None:
        codes = (FIRST_LABEL,)
    known = [system.site_at(place, code) for place in system.places for code in codes]
    index: dict[Site, int] = {}
    ways: list[tuple[Site, Site]] = []
    for site in known:  # grows by the sites of places that the system does not list
        if site is None or _key(system, site) in index:
            continue
        index[_key(system, site)] = len(index)
        targets = [move.target for move in system.moves_at(site)]
        ways += [(_key(system, site), _key(system, target)) for target in targets]
        known += targets
    return index, [(index[one], index[other]) for one, other in ways]


@compiled
def _spread(
    first: NDArray[np.int64],
    sources: NDArray[np.int64],
    hops: Hops,
    queue: NDArray[np.int64],
    filled: int,
) -> None:
    """Write the number of moves to the sites that are first in the queue, where `hops` is 0.

    `queue` has room for all sites; `hops` is `NEVER` everywhere else.
    """
    done = 0
    while done < filled:
        site = queue[done]
        done += 1
        for arc in range(first[site], first[site + 1]):
            near = sources[arc]
            if hops[near] == NEVER:
                hops[near] = hops[site] + 1
                queue[filled] = near
                filled += 1
