"""What one module sees as numbers from -1 to 1 that hide where it is: input for a network.

The relative observation follows from the observation that `observe` makes and from what a module
knows from the start, the static map and its goals. So it is as local as that observation. It also
says how many moves each site of a finite system is from the module's goals on an otherwise empty
map.

`RelativeObserver` serves one module. The vectorised form takes the absolute observations of many
modules and returns the same numbers bit for bit: what depends on a module's own site is computed
once per site and goals, and what it senses is looked up for all modules together.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import fsum
from typing import Literal, TypeAlias, cast, get_args
from weakref import WeakKeyDictionary, WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import FAR, FIRST_LABEL, MODULE, System

Hops: TypeAlias = NDArray[np.uint16]
"""The number of moves from each site, by number, to the nearest goal; `NEVER` without a way."""

NEVER = (1 << 16) - 1
"""More than any number of moves: there are at most this many sites."""


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

    A lattice may have no end, and coordinates say where its goals lie. Elsewhere a table for each
    module takes two bytes for each site. Each letter counts at each place.
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


Showing: TypeAlias = Literal["absolute", "relative"]
"""The array ``observation``: that of `observe`, or that of `RelativeObserver`."""


def checked_showing(showing: str) -> Showing:
    """Return which observation is shown; InputError if it is neither of the two."""
    if showing not in get_args(Showing):
        raise InputError(f"observation={showing!r}: expected 'absolute' or 'relative'")
    return cast(Showing, showing)


class RelativeLayout:
    """Which entry of the relative observations of a system means what.

    `parts` names the slices of the vector, in this order; an empty slice is left out by the system:

    - ``goal``: 1 if the own site or place is one of the module's goals;
    - ``kind``: one entry for each orbit of a lattice that has several (`orbits`), then one for each
      letter: 1 for those of the own site;
    - ``way``: `System.dimension` entries, ``d / (1 + max(abs(d)))``, where d leads from the own
      place to the mean of the goals; 0 without goals;
    - ``nearer``: where `sites` is not None, one entry for each move slot: 1 if the move brings the
      module nearer to its nearest goal, counted in moves that nobody is in the way of, -1 if it
      brings it farther away, else 0;
    - ``sensed``: for each sensed slot `width` entries: free, module, occupied obstacle, no place,
      then one for each letter, of which 1 is what it shows; then 1 if the place, or what is on
      there, is one of the module's goals.

    That moves are marked by whether they lead nearer follows Ma, Luo and Ma, *Distributed heuristic
    multi-agent path finding with communication* (2021).
    """

    def __init__(self, system: System) -> None:
        """Lay out the entries."""
        self.sites: Sites | None = sites_of(system)
        """The sites by number, for ``nearer``; None if there are no such entries."""
        found = {} if system.catalogue is None else _orbits(system)
        self.orbits: Mapping[tuple[int, ...], int] = found if len(found) > 1 else {}
        """The place in ``kind`` of each orbit, by its representative."""
        letters = len(system.letters)
        self.looks: NDArray[np.float32] = _looks(system)
        """The entries of a slot in row ``2 * code + flag``, shape ``(2 * codes, width)``."""
        self.width = self.looks.shape[1]
        lengths = {
            "goal": 1,
            "kind": len(self.orbits) + letters,
            "way": system.dimension,
            "nearer": 0 if self.sites is None else system.move_slots,
            "sensed": system.sense_slots * self.width,
        }
        self.parts: dict[str, slice] = {}
        self.length = 0
        for name, length in lengths.items():
            self.parts[name] = slice(self.length, self.length + length)
            self.length += length
        self._observers: WeakValueDictionary[tuple[Site, ...], RelativeObserver] = (
            WeakValueDictionary()
        )

    @property
    def low(self) -> NDArray[np.float32]:
        """Return the least value of each entry, -1 or 0; the greatest is always 1."""
        found = np.zeros(self.length, np.float32)
        found[self.parts["way"]] = found[self.parts["nearer"]] = -1
        return found

    def observer(self, system: System, goals: tuple[Site, ...]) -> RelativeObserver:
        """Return the observer of the modules with these goals; they share it."""
        found = self._observers.get(goals)
        if found is None:
            found = self._observers[goals] = RelativeObserver(system, self, goals)
        return found


class RelativeObserver:
    """Turns the observations of modules that have the same goals into relative ones."""

    def __init__(self, system: System, layout: RelativeLayout, goals: tuple[Site, ...]) -> None:
        """Take the goals in; InputError if one is too far away to tell the way."""
        self.layout = layout
        self._system = system
        self._count = len(goals)
        self.total = _total(system, goals)
        """The sum of the coordinates of the goals."""
        self.hops = None if layout.sites is None else layout.sites.hops(goals)
        """The number of moves to the nearest goal, by the numbers of `sites`."""
        self._label = None if system.labels is None else 0
        _, self._kind, self._way, self._nearer, self._sensed = layout.parts.values()

    @property
    def length(self) -> int:
        """Return the number of entries."""
        return self.layout.length

    def of(self, numbers: NDArray[np.int32]) -> NDArray[np.float32]:
        """Return the relative observation, float32 of shape ``(length,)``, values from -1 to 1.

        `numbers` is the array ``observation`` of `observe`; `RelativeLayout` has the entries.
        """
        system, layout = self._system, self.layout
        size = system.site_size
        # The label is the module's own, and nothing here depends on it.
        site = system.decode_site(numbers[:size].tolist(), self._label)
        found = np.zeros(layout.length, np.float32)
        found[0] = numbers[size]
        if self._kind.stop > self._kind.start:
            self._write_kind(found, site)
        if self.total:
            found[self._way] = self._way_from(site)
        if layout.sites is not None and self.hops is not None:
            own, targets = layout.sites.targets(system, site)
            here, there = self.hops.item(own), self.hops.take(targets)
            np.subtract(there < here, there > here, found[self._nearer], dtype=np.float32)
        looks = 2 * numbers[size + 1 :: 2] + numbers[size + 2 :: 2]
        found[self._sensed] = layout.looks.take(looks, axis=0).ravel()
        return found

    def _write_kind(self, found: NDArray[np.float32], site: Site) -> None:
        system, layout = self._system, self.layout
        catalogue = system.catalogue
        if layout.orbits and catalogue is not None:
            orbit = layout.orbits.get(catalogue.orbit(catalogue.lattice.check(site)))
            if orbit is not None:
                found[self._kind.start + orbit] = 1
        if system.letters:
            letter = system.code_of(site) - FIRST_LABEL
            if letter >= 0:
                found[self._kind.start + len(layout.orbits) + letter] = 1

    def _way_from(self, site: Site) -> list[float]:
        """Return the entries ``way`` from a site, as float64.

        On a lattice the differences are exact, so that they are the same wherever the scene lies.
        """
        system, count = self._system, self._count
        own = system.coordinates(system.place_of(site))
        way = [(total - count * x) / count for total, x in zip(self.total, own, strict=True)]
        far = 1 + max(map(abs, way))
        return [step / far for step in way]


_layouts: WeakKeyDictionary[System, RelativeLayout] = WeakKeyDictionary()


def relative_layout(system: System) -> RelativeLayout:
    """Return the layout of a system, shared by all modules in this process."""
    found = _layouts.get(system)
    if found is None:
        found = _layouts[system] = RelativeLayout(system)
    return found


def relative_observer(system: System, goals: tuple[Site, ...]) -> RelativeObserver:
    """Return what makes the relative observations of a module with these goals."""
    return relative_layout(system).observer(system, goals)


def _orbits(system: System) -> dict[tuple[int, ...], int]:
    """Return the orbits that the generators of a catalogue speak of, in canonical order."""
    catalogue = system.catalogue
    if catalogue is None:
        raise AssertionError("a system without a catalogue has no orbits")
    found = {catalogue.orbit(cell) for each in catalogue.generators for cell in each.support}
    return {orbit: number for number, orbit in enumerate(sorted(found))}


def _looks(system: System) -> NDArray[np.float32]:
    """Return the entries of a slot by code and goal flag: a label shows as a module."""
    looks = FIRST_LABEL + len(system.letters)
    found = np.zeros((system.codes, 2, looks + 1), np.float32)
    for code in range(system.codes):
        found[code, :, code if code < looks else MODULE] = 1
    found[:, 1, looks] = 1
    return found.reshape(-1, looks + 1)


def _total(system: System, goals: tuple[Site, ...]) -> tuple[float, ...]:
    """Return the sum of the coordinates of the goals, in float64."""
    spots: list[tuple[float, ...]] = []
    for goal in goals if system.dimension else ():
        # In a labelled system goals are places already.
        spot = system.coordinates(goal if system.labels is not None else system.place_of(goal))
        if not all(-FAR < number < FAR for number in spot):
            raise InputError(f"goal {goal!r}: too far away to tell the way, expected below {FAR}")
        spots.append(spot)
    return tuple(map(fsum, zip(*spots, strict=True)))


_KNOWN_MAX = 1 << 18
"""At most this many sites are remembered, each with goals: then all are asked again."""


class RelativeRows:
    """Makes the relative observations of the modules of one scene in many environments."""

    def __init__(self, system: System, goals: Sequence[tuple[Site, ...]]) -> None:
        """Take in each module's goals, by number."""
        self.layout = relative_layout(system)
        found = [relative_observer(system, each) for each in goals]
        self._observers = list({id(each): each for each in found}.values())
        place = {id(each): number for number, each in enumerate(self._observers)}
        self._observer_of = [place[id(each)] for each in found]
        self._size = system.site_size
        self._forget()

    def _forget(self) -> None:
        self._known: list[dict[bytes, int]] = [{} for _ in self._observers]
        self._count = 0
        self._heads = np.zeros((64, self.layout.parts["sensed"].start), np.float32)

    def of(self, numbers: NDArray[np.int32]) -> NDArray[np.float32]:
        """Return float32 of shape (E, n, `layout.length`), from int32 of shape (E, n, ...).

        `numbers` has what `observe` gives each module as ``observation``; it is left as it is.
        """
        size, sensed = self._size, self.layout.parts["sensed"]
        found = np.zeros((*numbers.shape[:2], self.layout.length), np.float32)
        if not found.size:
            return found
        if self._count > _KNOWN_MAX:
            self._forget()
        own = np.ascontiguousarray(numbers[:, :, : size + 1])
        keys = own.view(f"V{own.itemsize * (size + 1)}")[:, :, 0].tolist()
        rows: list[int] = []
        for environment, each in enumerate(keys):
            for module, (observer, key) in enumerate(zip(self._observer_of, each, strict=True)):
                row = self._known[observer].get(key)
                if row is None:
                    row = self._learn(observer, key, numbers[environment, module])
                rows.append(row)
        heads = self._heads.take(rows, axis=0)
        found[:, :, : sensed.start] = heads.reshape(*numbers.shape[:2], -1)
        looks = 2 * numbers[:, :, size + 1 :: 2] + numbers[:, :, size + 2 :: 2]
        shown = self.layout.looks.take(looks, axis=0)
        found[:, :, sensed] = shown.reshape(*looks.shape[:2], -1)
        return found

    def _learn(self, observer: int, key: bytes, numbers: NDArray[np.int32]) -> int:
        """Return the row of a site that is new to modules with these goals."""
        row = self._known[observer][key] = self._count
        self._count += 1
        if row == len(self._heads):
            self._heads = np.concatenate([self._heads, np.zeros_like(self._heads)])
        self._heads[row] = self._observers[observer].of(numbers)[: self._heads.shape[1]]
        return row
