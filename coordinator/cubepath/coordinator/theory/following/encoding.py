"""Clauses that hold for a timetable of so many rounds in which vehicles may follow.

x(a, v, t) says that vehicle a is at vertex v after t rounds; it exists only where a can come from
its start in t rounds, and from where it can reach its goal in those that are left.

- A vehicle goes from where it is along an edge or stays, forwards and backwards in time. Of two
  vertices with a common neighbour it is at one at most: as it begins at one vertex, it is then at
  one vertex at every time.
- At most one vehicle is at a vertex at a time.
- e(u, v, t) holds if some vehicle goes from u to v in round t + 1. Nobody goes from v to u then.
- Under the rule of CG:SHOP 2021, if e(u, v, t), whoever is at v after t rounds goes on in the same
  direction in round t + 1. This excludes that two swap, too.
- Where many can be at a vertex there is a ladder: one of the vehicles up to some number is there.

A vehicle may stay, so a timetable of fewer rounds satisfies them as well.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.following.timetable import Rule
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.core.sites import Site

Cell = tuple[int, int]
Schedule = list[list[tuple[int, Cell, Cell]]]
LITERALS_MAX = 30_000_000
"""The greatest number of literals: Python takes some seconds for ten millions."""
_PAIRS_MAX = 5
"""Of so many variables at most one holds by pairs, of more by a ladder of further variables."""
_FAR = 1 << 30
AT, GOES, UP_TO = range(3)
"""Kinds of variables: (vehicle, vertex, time), (source, target, time), (vehicle, vertex, time)."""


class FollowingTooLargeError(CubepathError):
    """The clauses would be more than can be built in reasonable time."""


@dataclass(frozen=True, eq=False)
class VehicleTask:
    """Vehicles on a graph: where each begins and ends; the vertices are cells (x, y).

    `edges` are those of the workspace, `rule` that by which vehicles may follow.
    """

    starts: tuple[Cell, ...]
    ends: tuple[Cell, ...]
    edges: Sequence[tuple[Site, Site]]
    rule: Rule

    @cached_property
    def beside(self) -> dict[Site, list[Site]]:
        """The neighbours of each vertex, in the order of the edges."""
        found: dict[Site, list[Site]] = {cell: [] for cell in (*self.starts, *self.ends)}
        for one, other in self.edges:
            found.setdefault(one, []).append(other)
            found.setdefault(other, []).append(one)
        return found

    @cached_property
    def places(self) -> dict[Site, int]:
        """The number of each vertex, from 0 on."""
        return {cell: place for place, cell in enumerate(self.beside)}

    def distances(self, cell: Cell) -> dict[Site, int]:
        """Return how many edges lead from a vertex to each that can be reached."""
        found: dict[Site, int] = {cell: 0}
        front: list[Site] = [cell]
        while front:
            reached: list[Site] = []
            for here in front:
                for there in self.beside[here]:
                    if there not in found:
                        found[there] = found[here] + 1
                        reached.append(there)
            front = reached
        return found

    @cached_property
    def windows(self) -> list[tuple[dict[Site, int], dict[Site, int]]]:
        """For each vehicle the distances from its start, and to its goal."""
        return [
            (self.distances(start), self.distances(end))
            for start, end in zip(self.starts, self.ends, strict=True)
        ]

    @cached_property
    def least(self) -> int:
        """The most edges that a vehicle has to go: no timetable has fewer rounds."""
        ways = zip(self.windows, self.ends, strict=True)
        return max((window[0].get(end, _FAR) for window, end in ways), default=0)


@dataclass(eq=False)
class VehicleClauses:
    """Clauses as arrays: clause c is ``literals[ends[c - 1]:ends[c]]``, the first from 0 on."""

    task: VehicleTask
    rounds: int
    at: list[list[dict[Site, int]]] = field(default_factory=list[list[dict[Site, int]]])
    """The variable of a vehicle at a vertex: by vehicle, time and vertex."""
    flat: array[int] = field(default_factory=lambda: array("i"))
    cuts: array[int] = field(default_factory=lambda: array("q"))
    meant: array[int] = field(default_factory=lambda: array("i"))
    """Four numbers for each variable: its kind, two of vehicles and vertices, and a time."""

    def new(self, kind: int, one: int, other: int, time: int) -> int:
        """Return a new variable with this meaning."""
        self.meant.extend((kind, one, other, time))
        return len(self.meant) // 4

    @property
    def meanings(self) -> NDArray[np.int32]:
        """What the variables mean, with shape (variables, 4): kind, index, index, time."""
        return np.array(self.meant, dtype=np.int32).reshape(-1, 4)

    def add(self, *clause: int) -> None:
        """Add a clause; TooLargeError if there are too many."""
        self.flat.extend(clause)
        self.cuts.append(len(self.flat))
        if len(self.flat) > LITERALS_MAX:
            raise FollowingTooLargeError(
                f"{self.rounds} rounds take more than {LITERALS_MAX} literals of clauses"
            )

    @property
    def variables(self) -> range:
        """The variables, from 1 on."""
        return range(1, len(self.meant) // 4 + 1)

    @property
    def literals(self) -> NDArray[np.int32]:
        """All literals, with shape (literals,)."""
        return np.array(self.flat, dtype=np.int32)

    @property
    def ends(self) -> NDArray[np.int64]:
        """Where each clause ends, with shape (clauses,)."""
        return np.array(self.cuts, dtype=np.int64)

    def each(self) -> Iterator[list[int]]:
        """Yield the clauses one by one."""
        begin = 0
        for end in self.cuts:
            yield self.flat[begin:end].tolist()
            begin = end

    def schedule(self, true: NDArray[np.bool_]) -> Schedule:
        """Return vehicle, source and target of the moves of each round.

        `true` has the truth of each variable, with shape (variables,).
        """
        found: Schedule = [[] for _ in range(self.rounds)]
        for who, times in enumerate(self.at):
            here = [next(v for v, name in each.items() if true[name - 1]) for each in times]
            for turn, (source, target) in enumerate(pairwise(here)):
                if source != target:
                    found[turn].append((who, cell_of(source), cell_of(target)))
        return found


def cell_of(site: Site) -> Cell:
    """Return a vertex as the cell that it is."""
    match site:
        case (int(x), int(y)):
            return x, y
        case _:
            raise TypeError(f"{site!r} is no cell (x, y)")


def clauses_of(
    task: VehicleTask, rounds: int, go_on: Callable[[], object] = lambda: None
) -> VehicleClauses:
    """Return clauses that can be satisfied iff `rounds` rounds are enough.

    `go_on` is called now and then, and may raise to give up. TooLargeError if there are more than
    `LITERALS_MAX` literals of them.
    """
    found = VehicleClauses(task, rounds)
    places = task.places
    for who, (forth, back) in enumerate(task.windows):
        go_on()
        cells = [v for v in forth if forth[v] + back.get(v, _FAR) <= rounds]
        found.at.append(
            [
                {
                    v: found.new(AT, who, places[v], t)
                    for v in cells
                    if forth[v] <= t and back[v] <= rounds - t
                }
                for t in range(rounds + 1)
            ]
        )
    for times in found.at:
        go_on()
        _add_ways(found, times)
    for t in range(rounds + 1):
        go_on()
        standing = _standing(found, t)
        for v, names in standing.items():
            _at_most_one(found, names, v, t)
        if t < rounds:
            _add_edges(found, t, standing)
    return found


def _standing(found: VehicleClauses, t: int) -> dict[Site, dict[int, int]]:
    """Return who can be at each vertex at a time: the variables by vehicle."""
    standing: dict[Site, dict[int, int]] = {}
    for who, times in enumerate(found.at):
        for v, name in times[t].items():
            standing.setdefault(v, {})[who] = name
    return standing


def _add_ways(found: VehicleClauses, times: Sequence[dict[Site, int]]) -> None:
    """Add that a vehicle is somewhere, and goes along edges or stays."""
    beside = found.task.beside
    found.add(*times[0].values())  # its start, or none: then nothing can be satisfied
    for t, here in enumerate(times):
        for v, name in here.items():
            near = (v, *beside[v])
            if t + 1 < len(times):
                found.add(-name, *_known(times[t + 1], near))
            if t:
                found.add(-name, *_known(times[t - 1], near))
            others = dict.fromkeys(w for u in near for w in (u, *beside[u]) if w != v)
            for other in _known(here, others):
                if other > name:
                    found.add(-name, -other)


def _known(names: dict[Site, int], cells: Iterable[Site]) -> list[int]:
    return [names[v] for v in cells if v in names]


def _at_most_one(found: VehicleClauses, names: dict[int, int], v: Site, t: int) -> None:
    """Add that at most one vehicle is at a vertex; a ladder is Sinz's sequential counter (2005)."""
    if len(names) <= _PAIRS_MAX:
        for one, other in combinations(names.values(), 2):
            found.add(-one, -other)
        return
    before = 0
    for place, (who, name) in enumerate(names.items()):
        if before:
            found.add(-before, -name)
        if place + 1 < len(names):
            some = found.new(UP_TO, who, found.task.places[v], t)
            found.add(-name, some)
            if before:
                found.add(-before, some)
            before = some


def _add_edges(found: VehicleClauses, t: int, standing: dict[Site, dict[int, int]]) -> None:
    """Add what may happen along edges in round t + 1."""
    task = found.task
    goes: dict[tuple[Site, Site], int] = {}
    for source, names in standing.items():
        for target in task.beside[source]:
            movers = {
                who: (name, there)
                for who, name in names.items()
                if (there := found.at[who][t + 1].get(target)) is not None
            }
            # Only where one may go while another is at the target.
            ahead = standing.get(target, {}).keys()
            if movers and len(movers.keys() | ahead) > 1 and ahead:
                edge = found.new(GOES, task.places[source], task.places[target], t)
                goes[source, target] = edge
                for name, there in movers.values():
                    found.add(-name, -there, edge)
    for (source, target), edge in goes.items():
        if task.rule == "cgshop":
            (x, y), (to_x, to_y) = cell_of(source), cell_of(target)
            beyond = 2 * to_x - x, 2 * to_y - y
            for who, name in standing[target].items():
                on = found.at[who][t + 1].get(beyond)
                found.add(-edge, -name, *(() if on is None else (on,)))
        elif (back := goes.get((target, source))) is not None and back > edge:
            found.add(-edge, -back)
