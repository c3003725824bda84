"""Checking a proof about vehicles that may follow: no timetable has fewer rounds than this one.

Part of `cubepath verify`. Variables and clauses are derived again from the graph
(`following_clauses`), each lemma of the log is followed, and the timetable is carried out by the
definition of its rule. Nothing is shared with the code that makes proofs but the format of the
file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from cubepath.coordinator.theory.proof_checking.following_clauses import (
    AT,
    GOES,
    FollowingClauses,
    Meaning,
)
from cubepath.coordinator.theory.proof_checking.following_rules import Cell, why_not_in_rounds
from cubepath.coordinator.theory.proof_checking.refutation_clauses import Clauses
from cubepath.coordinator.theory.proof_checking.unit_propagation import Refuter, dimacs
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.core.plurals import counted
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.path_files.following import FollowingLine
from cubepath.protocol.path_files.following_proofs import FollowingProof
from cubepath.protocol.plans.vehicle_plan import VehiclePlan

_CHUNK = 1 << 16
"""Variables that are looked at as Python's numbers at a time."""


@dataclass(frozen=True, slots=True)
class ProvedFewest:
    """What a proof proves that was checked.

    No timetable has `refuted` rounds or fewer, and one has `rounds`. If not `proved`, two solvers
    agreed on that, and nobody can check it: all but that was checked. There are no clauses where a
    vehicle has further to go than `refuted`.
    """

    refuted: int
    rounds: int
    proved: bool
    variables: int
    clauses: int
    lemmas: int

    @property
    def optimal(self) -> bool:
        """Whether no timetable is shorter than this one, so far as that is proved."""
        return self.proved and self.rounds == self.refuted + 1


def check_fewest_rounds(
    proof: FollowingProof, tell: Callable[[str, int], object] | None = None
) -> ProvedFewest:
    """Check a proof and return what it proves.

    `tell` is told what is being done, and how much since the last call. Raises CheckError, in one
    line, for the first thing that does not hold.

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
        for who, cell in enumerate(cells):
            if cell not in self._places:
                raise CheckError(f"vehicle {who} {what} at {site_text(cell)}, which is no vertex")
        if len(set(cells)) < len(cells):
            raise CheckError(f"two vehicles {what.removesuffix('s')} at one vertex")
        return [self._places[cell] for cell in cells]

    @cached_property
    def _derived(self) -> Clauses | None:
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
                raise CheckError(f"no variable means that {self._told(meaning)}")
            needed[number] = 1
        stray = needed.find(0, 1)
        if stray > 0:
            raise CheckError(f"variable {stray}: nothing needs it, or it means nothing")

    def _told(self, meaning: Meaning) -> str:
        kind, one, other, time = meaning
        there = site_text(self.proof.vertices[other])
        if kind == GOES:
            source = site_text(self.proof.vertices[one])
            return f"somebody goes from {source} to {there} in round {time + 1}"
        who = f"vehicle {one}" if kind == AT else f"one of the vehicles up to {one}"
        return f"{who} is at {there} after {time} rounds"

    @property
    def clauses(self) -> Clauses:
        """The clauses; an empty one if a vehicle has further to go than there are rounds."""
        return Clauses.empty() if self._derived is None else self._derived

    def dimacs(self) -> Iterator[bytes]:
        """Yield the clauses as a DIMACS file, for other checkers."""
        return dimacs(0 if self._derived is None else len(self.proof.variables), *self.clauses)

    def other_task(self, plan: VehiclePlan) -> str | None:
        """Return why the proof is not about the vehicles and the workspace of a plan, or None."""
        proof = self.proof
        for what, said, given in (
            ("starts", proof.starts, plan.starts),
            ("ends", proof.ends, plan.ends),
        ):
            if len(said) != len(given):
                return f"has {len(given)} vehicles, the proof {len(said)}"
            for who, (here, there) in enumerate(zip(said, given, strict=True)):
                if here != there:
                    where = f"{site_text(there)}, in the proof at {site_text(here)}"
                    return f"has another task: vehicle {who} {what} at {where}"
        told: set[frozenset[Site]] = {
            frozenset((proof.vertices[one], proof.vertices[other])) for one, other in self._edges
        }
        apart = told ^ {frozenset(edge) for edge in plan.edges()}
        return "has another workspace: its edges are not those of the proof" if apart else None

    def checked(self) -> ProvedFewest:
        """Return what the proof proves; CheckError for the first thing that does not hold."""
        proof, rounds = self.proof, len(self.proof.schedule)
        if rounds <= proof.refuted:
            raise CheckError(
                f"the timetable has {rounds} rounds, itself no more than the {proof.refuted} that"
                " are said to be impossible"
            )
        clauses = self._derived
        self._check_schedule()
        proved, variables = proof.standing == "proved", len(proof.variables)
        if clauses is None and variables:
            raise CheckError("there are variables, and nothing that they would be needed for")
        if (clauses is None or not proved) and any(proof.log):
            raise CheckError("there is a log, and nothing that it would be needed for")
        if clauses is None:
            return ProvedFewest(proof.refuted, rounds, proved, 0, 0, 0)
        lemmas = 0
        if proved:
            lemmas = Refuter(variables, *clauses).follow(proof.log, self._tell)
        return ProvedFewest(proof.refuted, rounds, proved, variables, len(clauses.ends), lemmas)

    def _check_schedule(self) -> None:
        proof, at = self.proof, list(self.proof.starts)
        lines: list[FollowingLine] = []
        for number, moves in enumerate(proof.schedule, 1):
            where = f"round {number} of the timetable"
            left = list(at)
            for who, place in moves:
                if who >= len(at) or place >= len(proof.vertices):
                    raise CheckError(
                        f"{where}: vehicle {who} goes to vertex {place}, expected less than"
                        f" {len(at)} and {len(proof.vertices)}"
                    )
                source, target = left[who], proof.vertices[place]
                if (self._places[source], place) not in self._edges:
                    goes = f"vehicle {who} goes from {site_text(source)} to {site_text(target)}"
                    raise CheckError(f"{where}: {goes}, which is no edge")
                lines.append(FollowingLine(who, source, target, round=number))
                at[who] = target
        why = why_not_in_rounds(lines, proof.starts, proof.rule)
        if why is not None:
            raise CheckError(f"the timetable: {why}")
        for who, (here, end) in enumerate(zip(at, proof.ends, strict=True)):
            if here != end:
                raise CheckError(
                    f"after the timetable vehicle {who} is at {site_text(here)}, expected"
                    f" {site_text(end)}"
                )
