"""The clauses of "vehicles that may follow get there in so many rounds", derived from the graph.

Every variable says something about a timetable: a vehicle is at a vertex after so many rounds; some
vehicle goes along an edge, in one direction, in a round; one of the vehicles up to some number is
at a vertex. Each clause holds for every legal timetable under these meanings, so if they cannot be
satisfied there is none. Which variables there must be is derived here too: docs/following.md.

Room: coordinator; touches nothing. Part of `cubepath verify`. Nothing is shared with the code that
asks solvers.
"""

from __future__ import annotations

from array import array
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.verification.refutation_clauses import Clauses

AT, GOES, UP_TO = range(3)
"""Kinds of variables: (vehicle, vertex, time), (source, target, time), (vehicle, vertex, time)."""
LADDER_FROM = 6
"""From so many vehicles on a vertex has a ladder instead of a clause for each pair."""
Meaning = tuple[int, int, int, int]
Span = tuple[int, int]


def reached(beside: Sequence[Sequence[int]], origin: int) -> list[int | None]:
    """Return the number of edges from a vertex to each, None where no way leads."""
    steps: list[int | None] = [None] * len(beside)
    steps[origin] = 0
    queue = [origin]
    for here in queue:
        for there in beside[here]:
            if steps[there] is None:
                steps[there] = (steps[here] or 0) + 1
                queue.append(there)
    return steps


class FollowingClauses:
    """Vehicles on a graph, and what must hold for so many rounds of them.

    `beside` has the neighbours of each vertex, and `beyond`, under the rule of CG:SHOP 2021 alone,
    the vertex that one comes to from an edge (source, target) by going on straight, where there is
    one. `starts` and `ends` are vertices by vehicle.
    """

    def __init__(
        self,
        beside: Sequence[Sequence[int]],
        starts: Sequence[int],
        ends: Sequence[int],
        rounds: int,
        beyond: Mapping[Span, int] | None,
    ) -> None:
        """Find when each vehicle can be where: between its way from the start and to the end."""
        self._beside = beside
        self._beyond = beyond
        self._rounds = rounds
        self._when: list[dict[int, Span]] = []
        for start, end in zip(starts, ends, strict=True):
            before, after = reached(beside, start), reached(beside, end)
            spans = {
                vertex: (first, rounds - left)
                for vertex, (first, left) in enumerate(zip(before, after, strict=True))
                if first is not None and left is not None and first + left <= rounds
            }
            self._when.append(spans)

    @cached_property
    def _visitors(self) -> dict[Span, list[int]]:
        """Who can be at each vertex at each time."""
        found: dict[Span, list[int]] = defaultdict(list)
        for who, spans in enumerate(self._when):
            for vertex, (first, last) in spans.items():
                for time in range(first, last + 1):
                    found[vertex, time].append(who)
        return found

    @property
    def least_variables(self) -> int:
        """How many variables say where vehicles are; all that is derived grows with it."""
        return sum(last - first + 1 for spans in self._when for first, last in spans.values())

    @property
    def too_far(self) -> bool:
        """Whether some vehicle cannot reach its end in so many rounds, were it alone."""
        return not all(self._when)

    def _can(self, who: int, vertex: int, time: int) -> bool:
        first, last = self._when[who].get(vertex, (1, 0))
        return first <= time <= last

    def _goers(self, source: int, target: int, time: int) -> list[int]:
        """Return who can go along an edge in the round after a time."""
        leaving = self._visitors.get((source, time), ())
        return [who for who in leaving if self._can(who, target, time + 1)]

    def _followed(self) -> Iterator[tuple[Span, int, list[int], list[int]]]:
        """Yield where somebody can go to where another can be: edge, time, who goes, who is there.

        Under any rule this is all that two vehicles can do to one another on edges.
        """
        for (target, time), there in self._visitors.items():
            if time == self._rounds:
                continue
            for source in self._beside[target]:
                goers = self._goers(source, target, time)
                if goers and len({*goers, *there}) > 1:
                    yield (source, target), time, goers, there

    def meanings(self) -> Iterator[Meaning]:
        """Yield the meaning of every variable that there must be."""
        for (vertex, time), visitors in self._visitors.items():
            for who in visitors:
                yield AT, who, vertex, time
            if len(visitors) >= LADDER_FROM:
                for who in visitors[:-1]:
                    yield UP_TO, who, vertex, time
        for (source, target), time, _, _ in self._followed():
            yield GOES, source, target, time

    def clauses(self, names: Mapping[Meaning, int]) -> Clauses:
        """Return all clauses; `names` has the number of each variable.

        Literals are ``2 * variable`` and, negated, ``2 * variable + 1``.
        """
        flat, cuts = array("i"), array("q")
        for part in (self._ways(names), self._shared(names), self._edges(names)):
            for clause in part:
                flat.extend(clause)
                cuts.append(len(flat))
        literals: NDArray[np.int32] = np.array(flat, dtype=np.int32)
        return Clauses(literals, np.array(cuts, dtype=np.int64))

    def _ways(self, names: Mapping[Meaning, int]) -> Iterator[list[int]]:
        """Yield that each vehicle is somewhere, and goes along edges or stays."""
        within: list[list[int]] = []
        for vertex, near in enumerate(self._beside):
            reach = {*near, *(far for each in near for far in self._beside[each])}
            within.append(sorted(far for far in reach if far > vertex))
        for who, spans in enumerate(self._when):
            yield [2 * names[AT, who, vertex, 0] for vertex in spans if self._can(who, vertex, 0)]
            for vertex, (first, last) in spans.items():
                for time in range(first, last + 1):
                    here = 2 * names[AT, who, vertex, time] + 1
                    for other in (time - 1, time + 1):
                        if 0 <= other <= self._rounds:
                            near = (vertex, *self._beside[vertex])
                            yield [
                                here,
                                *(
                                    2 * names[AT, who, each, other]
                                    for each in near
                                    if self._can(who, each, other)
                                ),
                            ]
                    for far in within[vertex]:
                        if self._can(who, far, time):
                            yield [here, 2 * names[AT, who, far, time] + 1]

    def _shared(self, names: Mapping[Meaning, int]) -> Iterator[list[int]]:
        """Yield that at most one vehicle is at a vertex at a time."""
        for (vertex, time), visitors in self._visitors.items():
            standing = [2 * names[AT, who, vertex, time] for who in visitors]
            if len(visitors) < LADDER_FROM:
                for one, other in combinations(standing, 2):
                    yield [one + 1, other + 1]
                continue
            up_to = [2 * names[UP_TO, who, vertex, time] for who in visitors[:-1]]
            for place, some in enumerate(up_to):
                yield [standing[place] + 1, some]
                yield [some + 1, standing[place + 1] + 1]
                if place:
                    yield [up_to[place - 1] + 1, some]

    def _edges(self, names: Mapping[Meaning, int]) -> Iterator[list[int]]:
        """Yield when one may go to where another is, and that no two swap places."""
        for (source, target), time, goers, there in self._followed():
            goes = 2 * names[GOES, source, target, time]
            for who in goers:
                before, after = names[AT, who, source, time], names[AT, who, target, time + 1]
                yield [2 * before + 1, 2 * after + 1, goes]
            if self._beyond is None:
                back = names.get((GOES, target, source, time))
                if back is not None and source < target:
                    yield [goes + 1, 2 * back + 1]
                continue
            on = self._beyond.get((source, target))
            for who in there:
                clause = [goes + 1, 2 * names[AT, who, target, time] + 1]
                if on is not None and self._can(who, on, time + 1):
                    clause.append(2 * names[AT, who, on, time + 1])
                yield clause
