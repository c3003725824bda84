"""The clauses of "vehicles that may follow get there in so many rounds", derived from the graph.

Every variable says something about a timetable: a vehicle is at a vertex after so many rounds; some
vehicle goes along an edge, in one direction, in a round; one of the vehicles up to some number is
at a vertex. Each clause holds for every legal timetable under these meanings, so if they cannot be
satisfied there is none. Which variables there must be is derived here too: docs/following.md.

Part of `cubepath verify`. Nothing is shared with the code that asks solvers.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from itertools import combinations

import numpy as np

from cubepath.coordinator.theory.proof_checking.refutation_clauses import Clauses

AT, GOES, UP_TO = range(3)
"""Kinds of variables: (vehicle, vertex, time), (source, target, time), (vehicle, vertex, time)."""
LADDER_FROM = 6
"""From so many vehicles on a vertex has a ladder instead of a clause for each pair."""
Meaning = tuple[int, int, int, int]
Span = tuple[int, int, int]
"""The first and the last time at which a vehicle can be at a vertex, and what is added to a time to
find its place among the variables that say so."""


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
        beyond: Mapping[tuple[int, int], int] | None,
    ) -> None:
        """Find when each vehicle can be where: between its way from the start and to the end."""
        self._beside = beside
        self._beyond = beyond
        self._rounds = rounds
        self._when: list[dict[int, Span]] = []
        count = 0
        for start, end in zip(starts, ends, strict=True):
            before, after = reached(beside, start), reached(beside, end)
            spans: dict[int, Span] = {}
            for vertex, (first, left) in enumerate(zip(before, after, strict=True)):
                if first is not None and left is not None and first + left <= rounds:
                    spans[vertex] = first, rounds - left, count - first
                    count += rounds - left - first + 1
            self._when.append(spans)
        self.least_variables = count
        """How many variables say where vehicles are; all that is derived grows with it."""

    @cached_property
    def _visitors(self) -> dict[tuple[int, int], list[int]]:
        """Who can be at each vertex at each time, in ascending order."""
        found: dict[tuple[int, int], list[int]] = defaultdict(list)
        for who, spans in enumerate(self._when):
            for vertex, (first, last, _) in spans.items():
                for time in range(first, last + 1):
                    found[vertex, time].append(who)
        return found

    # The numbers of variables, 0 for what has none. There are millions, so each takes four bytes.

    @cached_property
    def _at(self) -> array[int]:
        return _zeros(self.least_variables)

    @cached_property
    def _goes(self) -> dict[tuple[int, int], array[int]]:
        """By edge, and then by time."""
        ways = [(one, other) for one, near in enumerate(self._beside) for other in near]
        return {way: _zeros(self._rounds) for way in ways}

    @cached_property
    def _up_to(self) -> dict[tuple[int, int], array[int]]:
        """By vertex and time, and then in the order of those who can be there."""
        return {
            place: _zeros(len(visitors))
            for place, visitors in self._visitors.items()
            if len(visitors) >= LADDER_FROM
        }

    def place(self, meaning: Meaning) -> tuple[array[int], int] | None:
        """Return where the number of the variable with this meaning is kept, None if nowhere."""
        kind, one, other, time = meaning
        if kind == AT and 0 <= one < len(self._when):
            first, last, at = self._when[one].get(other, (1, 0, 0))
            return (self._at, at + time) if first <= time <= last else None
        if kind == GOES and 0 <= time < self._rounds and (one, other) in self._goes:
            return self._goes[one, other], time
        if kind == UP_TO and (other, time) in self._up_to:
            visitors = self._visitors[other, time]
            rank = bisect_left(visitors, one)
            if rank < len(visitors) and visitors[rank] == one:
                return self._up_to[other, time], rank
        return None

    @property
    def too_far(self) -> bool:
        """Whether some vehicle cannot reach its end in so many rounds, were it alone."""
        return not all(self._when)

    def _can(self, who: int, vertex: int, time: int) -> bool:
        first, last, _ = self._when[who].get(vertex, (1, 0, 0))
        return first <= time <= last

    def _is_at(self, who: int, vertex: int, time: int) -> int:
        """Return the literal that says where somebody is who can be there."""
        return 2 * self._at[self._when[who][vertex][2] + time]

    def _goers(self, source: int, target: int, time: int) -> list[int]:
        """Return who can go along an edge in the round after a time."""
        leaving = self._visitors.get((source, time), ())
        return [who for who in leaving if self._can(who, target, time + 1)]

    def _followed(self) -> Iterator[tuple[tuple[int, int], int, list[int], list[int]]]:
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

    def clauses(self) -> Clauses:
        """Return all clauses, once each variable has its number.

        Literals are ``2 * variable`` and, negated, ``2 * variable + 1``.
        """
        flat, cuts = array("i"), array("q")
        for part in (self._ways(), self._shared(), self._edges()):
            for clause in part:
                flat.extend(clause)
                cuts.append(len(flat))
        return Clauses(np.frombuffer(flat, dtype=np.int32), np.frombuffer(cuts, dtype=np.int64))

    def _ways(self) -> Iterator[list[int]]:
        """Yield that each vehicle is somewhere, and goes along edges or stays."""
        within: list[list[int]] = []
        for vertex, near in enumerate(self._beside):
            reach = {*near, *(far for each in near for far in self._beside[each])}
            within.append(sorted(far for far in reach if far > vertex))
        numbers = self._at
        for who, spans in enumerate(self._when):
            yield [self._is_at(who, vertex, 0) for vertex in spans if self._can(who, vertex, 0)]
            for vertex, (first, last, at) in spans.items():
                near_spans = [
                    spans[each] for each in (vertex, *self._beside[vertex]) if each in spans
                ]
                far_spans = [spans[far] for far in within[vertex] if far in spans]
                for time in range(first, last + 1):
                    here = 2 * numbers[at + time] + 1
                    for other in (time - 1, time + 1):
                        if 0 <= other <= self._rounds:
                            yield [here] + [
                                2 * numbers[to + other]
                                for begin, end, to in near_spans
                                if begin <= other <= end
                            ]
                    for begin, end, to in far_spans:
                        if begin <= time <= end:
                            yield [here, 2 * numbers[to + time] + 1]

    def _shared(self) -> Iterator[list[int]]:
        """Yield that at most one vehicle is at a vertex at a time."""
        for (vertex, time), visitors in self._visitors.items():
            standing = [self._is_at(who, vertex, time) for who in visitors]
            if len(visitors) < LADDER_FROM:
                for one, other in combinations(standing, 2):
                    yield [one + 1, other + 1]
                continue
            up_to = [2 * number for number in self._up_to[vertex, time][:-1]]
            for place, some in enumerate(up_to):
                yield [standing[place] + 1, some]
                yield [some + 1, standing[place + 1] + 1]
                if place:
                    yield [up_to[place - 1] + 1, some]

    def _edges(self) -> Iterator[list[int]]:
        """Yield when one may go to where another is, and that no two swap places."""
        for (source, target), time, goers, there in self._followed():
            goes = 2 * self._goes[source, target][time]
            for who in goers:
                before = self._is_at(who, source, time)
                yield [before + 1, self._is_at(who, target, time + 1) + 1, goes]
            if self._beyond is None:
                back = self._goes[target, source][time]
                if back and source < target:
                    yield [goes + 1, 2 * back + 1]
                continue
            on = self._beyond.get((source, target))
            for who in there:
                clause = [goes + 1, self._is_at(who, target, time) + 1]
                if on is not None and self._can(who, on, time + 1):
                    clause.append(self._is_at(who, on, time + 1))
                yield clause


def _zeros(count: int) -> array[int]:
    return array("i", bytes(4 * count))
