"""Checking a proof about vehicles that may follow: no timetable has fewer rounds than this one.

Part of `cubepath verify`; nothing is shared with the code that makes proofs but the format of the
file. Variables and clauses are derived again from the graph, each lemma of the log is followed, and
the timetable is carried out by the definition of its rule. Every variable says something about a
timetable, and each clause holds for every legal timetable under these meanings, so if they cannot
be satisfied there is none. docs/schedules.md has the variables.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from cubepath.coordinator.theory.proof_checking.following import Cell, why_not_in_rounds
from cubepath.coordinator.theory.proof_checking.refutation_clauses import ProofClauses
from cubepath.coordinator.theory.proof_checking.unit_propagation import Refuter, dimacs
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.path_files.following import FollowingLine, FollowingProof
from cubepath.protocol.plans.imported import VehiclePlan

AT, GOES, UP_TO = range(3)
"""Kinds of variables: (vehicle, vertex, time), (source, target, time), (vehicle, vertex, time)."""
LADDER_FROM = 6
"""From this many vehicles on a vertex has a ladder instead of a clause for each pair."""
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
    """Vehicles on a graph, and what must hold for this many rounds of them.

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
        """The vehicles that can be at each vertex at each time, in ascending order."""
        found: dict[tuple[int, int], list[int]] = defaultdict(list)
        for vehicle, spans in enumerate(self._when):
            for vertex, (first, last, _) in spans.items():
                for time in range(first, last + 1):
                    found[vertex, time].append(vehicle)
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
        """Whether some vehicle cannot reach its end in this many rounds, were it alone."""
        return not all(self._when)

    def _can(self, vehicle: int, vertex: int, time: int) -> bool:
        first, last, _ = self._when[vehicle].get(vertex, (1, 0, 0))
        return first <= time <= last

    def _is_at(self, vehicle: int, vertex: int, time: int) -> int:
        """Return the literal that says where somebody is who can be there."""
        return 2 * self._at[self._when[vehicle][vertex][2] + time]

    def _goers(self, source: int, target: int, time: int) -> list[int]:
        """Return who can go along an edge in the round after a time."""
        leaving = self._visitors.get((source, time), ())
        return [vehicle for vehicle in leaving if self._can(vehicle, target, time + 1)]

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
            for vehicle in visitors:
                yield AT, vehicle, vertex, time
            if len(visitors) >= LADDER_FROM:
                for vehicle in visitors[:-1]:
                    yield UP_TO, vehicle, vertex, time
        for (source, target), time, _, _ in self._followed():
            yield GOES, source, target, time

    def clauses(self) -> ProofClauses:
        """Return all clauses, once each variable has its number.

        Literals are ``2 * variable`` and, negated, ``2 * variable + 1``.
        """
        flat, cuts = array("i"), array("q")
        for part in (self._ways(), self._shared(), self._edges()):
            for clause in part:
                flat.extend(clause)
                cuts.append(len(flat))
        return ProofClauses(
            np.frombuffer(flat, dtype=np.int32), np.frombuffer(cuts, dtype=np.int64)
        )

    def _ways(self) -> Iterator[list[int]]:
        """Yield that each vehicle is somewhere, and goes along edges or stays."""
        within: list[list[int]] = []
        for vertex, near in enumerate(self._beside):
            reach = {*near, *(far for each in near for far in self._beside[each])}
            within.append(sorted(far for far in reach if far > vertex))
        numbers = self._at
        for vehicle, spans in enumerate(self._when):
            yield [
                self._is_at(vehicle, vertex, 0) for vertex in spans if self._can(vehicle, vertex, 0)
            ]
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
            standing = [self._is_at(vehicle, vertex, time) for vehicle in visitors]
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
            for vehicle in goers:
                before = self._is_at(vehicle, source, time)
                yield [before + 1, self._is_at(vehicle, target, time + 1) + 1, goes]
            if self._beyond is None:
                back = self._goes[target, source][time]
                if back and source < target:
                    yield [goes + 1, 2 * back + 1]
                continue
            on = self._beyond.get((source, target))
            for vehicle in there:
                clause = [goes + 1, self._is_at(vehicle, target, time) + 1]
                if on is not None and self._can(vehicle, on, time + 1):
                    clause.append(self._is_at(vehicle, on, time + 1))
                yield clause


def _zeros(count: int) -> array[int]:
    return array("i", bytes(4 * count))


_CHUNK = 1 << 16
"""Variables that are looked at as Python's numbers at a time."""


@dataclass(frozen=True, slots=True)
class FewestRoundsResult:
    """What a proof proves that was checked.

    No timetable has `refuted` rounds or fewer, and one has `rounds`. There are no clauses where a
    vehicle has further to go than `refuted`.
    """

    refuted: int
    rounds: int
    variables: int
    clauses: int
    lemmas: int

    @property
    def optimal(self) -> bool:
        """Whether no timetable is shorter than this one."""
        return self.rounds == self.refuted + 1


def check_fewest_rounds(
    proof: FollowingProof, tell: Callable[[str, int], object] | None = None
) -> FewestRoundsResult:
    """Check a proof and return what it proves.

    `tell` is called with what is being done, and how much since the last call. Raises CheckError,
    in one line, for the first thing that does not hold.

    >>> found = check_fewest_rounds(FollowingProof(
    ...     rule="mapf", starts=[(0, 0)], ends=[(2, 0)], vertices=[(0, 0), (1, 0), (2, 0)],
    ...     edges=[(0, 1), (1, 2)], refuted=1, schedule=[[(0, 1)], [(0, 2)]],
    ... ))
    >>> found.optimal, found.rounds, found.clauses
    (True, 2, 0)
    """
    return FollowingRefutation(proof, tell).checked()


class FollowingRefutation:
    """The claim of a proof and its clauses, derived again; CheckError if it does not fit them."""

    def __init__(
        self, proof: FollowingProof, tell: Callable[[str, int], object] | None = None
    ) -> None:
        """Take a proof; what is derived from it is derived when it is asked for."""
        self.proof = proof
        self._tell = tell or (lambda _what, _count: None)

    @cached_property
    def _places(self) -> dict[Cell, int]:
        found = {cell: place for place, cell in enumerate(self.proof.vertices)}
        if len(found) < len(self.proof.vertices):
            raise CheckError("the vertices: one stands twice")
        return found

    @cached_property
    def _edges(self) -> set[tuple[int, int]]:
        """The edges in both directions."""
        count = len(self._places)
        for number, (one, other) in enumerate(self.proof.edges):
            if max(one, other) >= count:
                raise CheckError(f"edge {number}: ends at vertex {max(one, other)} of {count}")
            if one == other:
                raise CheckError(f"edge {number}: joins vertex {one} with itself")
        return {way for one, other in self.proof.edges for way in ((one, other), (other, one))}

    def _vertices(self, what: str, cells: Sequence[Cell]) -> list[int]:
        for vehicle, cell in enumerate(cells):
            if cell not in self._places:
                raise CheckError(
                    f"vehicle {vehicle} {what} at {site_text(cell)}, which is no vertex"
                )
        if len(set(cells)) < len(cells):
            raise CheckError(f"two vehicles {what.removesuffix('s')} at one vertex")
        return [self._places[cell] for cell in cells]

    @cached_property
    def _derived(self) -> ProofClauses | None:
        """The clauses; None if a vehicle has further to go than there are rounds."""
        proof = self.proof
        if len(proof.starts) != len(proof.ends):
            raise CheckError(f"{len(proof.starts)} vehicles start, {len(proof.ends)} end")
        starts, ends = self._vertices("starts", proof.starts), self._vertices("ends", proof.ends)
        beside: list[list[int]] = [[] for _ in proof.vertices]
        for source, target in sorted(self._edges):
            beside[source].append(target)
        beyond = self._beyond() if proof.rule == "cgshop" else None
        task = FollowingClauses(beside, starts, ends, proof.refuted, beyond)
        if task.too_far:
            return None
        if task.least_variables > len(proof.variables):
            raise CheckError(
                f"{len(proof.variables)} variables, expected {task.least_variables} or more for"
                f" {counted(proof.refuted, 'round')}"
            )
        self._tell("clauses", 0)
        self._number(task)
        return task.clauses()

    def _beyond(self) -> dict[tuple[int, int], int]:
        """Return where one comes to from each edge by going on straight."""
        found: dict[tuple[int, int], int] = {}
        for source, target in self._edges:
            (x, y), (to_x, to_y) = self.proof.vertices[source], self.proof.vertices[target]
            on = self._places.get((2 * to_x - x, 2 * to_y - y))
            if on is not None and (target, on) in self._edges:
                found[source, target] = on
        return found

    def _number(self, task: FollowingClauses) -> None:
        """Number the variables of the clauses as the proof does, if they are those that must be."""
        rows = self.proof.variables
        for begin in range(0, len(rows), _CHUNK):
            meanings = map(tuple, rows[begin : begin + _CHUNK].tolist())
            for number, meaning in enumerate(meanings, begin + 1):
                kept = task.place(meaning)
                if kept is None:
                    continue
                numbers, place = kept
                if numbers[place]:
                    raise CheckError(
                        f"variable {number}: means the same as variable {numbers[place]}"
                    )
                numbers[place] = number
        needed = bytearray(len(rows) + 1)
        for meaning in task.meanings():
            kept = task.place(meaning)
            number = 0 if kept is None else kept[0][kept[1]]
            if not number:
                raise CheckError(f"no variable means that {self._meaning_text(meaning)}")
            needed[number] = 1
        stray = needed.find(0, 1)
        if stray > 0:
            raise CheckError(f"variable {stray}: nothing needs it, or it means nothing")

    def _meaning_text(self, meaning: Meaning) -> str:
        kind, one, other, time = meaning
        there = site_text(self.proof.vertices[other])
        if kind == GOES:
            source = site_text(self.proof.vertices[one])
            return f"somebody goes from {source} to {there} in round {time + 1}"
        vehicle = f"vehicle {one}" if kind == AT else f"one of the vehicles up to {one}"
        return f"{vehicle} is at {there} after {time} rounds"

    @property
    def clauses(self) -> ProofClauses:
        """The clauses; an empty one if a vehicle has further to go than there are rounds."""
        return ProofClauses.empty() if self._derived is None else self._derived

    def dimacs(self) -> Iterator[bytes]:
        """Yield the clauses as a DIMACS file, for other checkers."""
        return dimacs(0 if self._derived is None else len(self.proof.variables), *self.clauses)

    def other_task(self, plan: VehiclePlan) -> str | None:
        """Return why the proof is not about the vehicles and the workspace of a plan, or None."""
        proof = self.proof
        for what, stated, given in (
            ("starts", proof.starts, plan.starts),
            ("ends", proof.ends, plan.ends),
        ):
            if len(stated) != len(given):
                return f"has {len(given)} vehicles, the proof {len(stated)}"
            for vehicle, (here, there) in enumerate(zip(stated, given, strict=True)):
                if here != there:
                    where = f"{site_text(there)}, in the proof at {site_text(here)}"
                    return f"has another task: vehicle {vehicle} {what} at {where}"
        edges: set[frozenset[Site]] = {
            frozenset((proof.vertices[one], proof.vertices[other])) for one, other in self._edges
        }
        apart = edges ^ {frozenset(edge) for edge in plan.edges()}
        return "has another workspace: its edges are not those of the proof" if apart else None

    def checked(self) -> FewestRoundsResult:
        """Return what the proof proves; CheckError for the first thing that does not hold."""
        proof, rounds = self.proof, len(self.proof.schedule)
        if rounds <= proof.refuted:
            raise CheckError(
                f"the timetable has {rounds} rounds, itself no more than the {proof.refuted} that"
                " are said to be impossible"
            )
        clauses = self._derived
        self._check_schedule()
        variables = len(proof.variables)
        if clauses is None:
            if variables:
                raise CheckError("there are variables, and nothing that they would be needed for")
            if any(proof.log):
                raise CheckError("there is a log, and nothing that it would be needed for")
            return FewestRoundsResult(proof.refuted, rounds, 0, 0, 0)
        lemmas = Refuter(variables, *clauses).follow(proof.log, self._tell)
        return FewestRoundsResult(proof.refuted, rounds, variables, len(clauses.ends), lemmas)

    def _check_schedule(self) -> None:
        proof, at = self.proof, list(self.proof.starts)
        lines: list[FollowingLine] = []
        for number, moves in enumerate(proof.schedule, 1):
            where = f"round {number} of the timetable"
            left = list(at)
            for vehicle, place in moves:
                if vehicle >= len(at) or place >= len(proof.vertices):
                    raise CheckError(
                        f"{where}: vehicle {vehicle} goes to vertex {place}, expected less than"
                        f" {len(at)} and {len(proof.vertices)}"
                    )
                source, target = left[vehicle], proof.vertices[place]
                if (self._places[source], place) not in self._edges:
                    goes = f"vehicle {vehicle} goes from {site_text(source)} to {site_text(target)}"
                    raise CheckError(f"{where}: {goes}, which is no edge")
                lines.append(FollowingLine(vehicle, source, target, round=number))
                at[vehicle] = target
        why = why_not_in_rounds(lines, proof.starts, proof.rule)
        if why is not None:
            raise CheckError(f"the timetable: {why}")
        for vehicle, (here, end) in enumerate(zip(at, proof.ends, strict=True)):
            if here != end:
                raise CheckError(
                    f"after the timetable vehicle {vehicle} is at {site_text(here)}, expected"
                    f" {site_text(end)}"
                )
