"""Checking a proof of optimality: nothing shorter exists, and this schedule is one.

Part of `cubepath verify`. What a proof says is derived again from the moves: windows, variables,
clauses, then each lemma of its log, then its schedule. See docs/proofs.md; nothing is shared with
the code that makes proofs but the format of the file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence, Set as AbstractSet
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cubepath.coordinator.normal_form.definitions import is_cube
from cubepath.coordinator.theory.proof_checking.refutation_clauses import (
    ProofClauses,
    clauses_of,
    roles_of,
)
from cubepath.coordinator.theory.proof_checking.refutation_moves import Moves
from cubepath.coordinator.theory.proof_checking.refutation_variables import Meanings
from cubepath.coordinator.theory.proof_checking.unit_propagation import Refuter, dimacs
from cubepath.coordinator.verification.rounds import make, why_not
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import Site, in_order, site_text
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.path_files.optimality_proofs import OptimalityProof
from cubepath.protocol.scenes.toml import scene_from_toml

Tell = Callable[[str, int], object]
"""Is told what is being done, and how much of it was done since the last call."""


@dataclass(frozen=True, slots=True)
class ProofResult:
    """What a proof proves that was checked.

    No schedule has `refuted` rounds or fewer, and one has `cubes`. If not `proved`, two solvers
    agreed on that, and nobody can check it: all but that was checked. `lemmas` is how many of the
    log were needed; none if unit propagation of the clauses alone refutes them, and there are no
    clauses if the windows alone do.
    """

    refuted: int
    cubes: int
    proved: bool
    moves: int
    variables: int
    clauses: int
    lemmas: int

    @property
    def optimal(self) -> bool:
        """Whether no schedule is shorter than this one, so far as that is proved."""
        return self.proved and self.cubes == self.refuted + 1


def check_optimality(proof: OptimalityProof, tell: Tell | None = None) -> ProofResult:
    """Check a proof and return what it proves.

    Raises CheckError, in one line, for the first thing that does not hold.

    >>> left, right = Action([1, 2], [1, 2], [1], [2]), Action([2, 3], [2, 3], [2], [3])
    >>> found = check_optimality(OptimalityProof(
    ...     system=None, start=[1], goal=[3], refuted=1, cubes=2,
    ...     moves=[left, right], schedule=[[0], [1]],
    ... ))
    >>> found.proved, found.optimal, found.clauses
    (True, True, 0)
    """
    return ClaimedRefutation(proof, tell).checked()


class ClaimedRefutation:
    """The claim of a proof and its clauses, derived again; CheckError if it does not fit them."""

    def __init__(self, proof: OptimalityProof, tell: Tell | None = None) -> None:
        """Take a proof; what is derived from it is derived when it is asked for."""
        self.proof = proof
        self._tell: Tell = tell or (lambda _what, _count: None)
        self._start = _state("the start", proof.start)
        self._goal = _state("the goal", proof.goal)

    @cached_property
    def scene(self) -> Scene | None:
        """The scene that names the system of the claim, None if its moves are listed."""
        if self.proof.system is None:
            return None
        try:
            return scene_from_toml(self.proof.system, "the system")
        except InputError as error:
            raise CheckError(str(error)) from None

    @cached_property
    def system(self) -> System | None:
        """The system of the claim, None if its moves are listed."""
        if self.scene is None:
            return None
        system = self.scene.system
        if not system.local:
            raise CheckError("the system is not local, so it has no schedules")
        for name, state in (("the start", self._start), ("the goal", self._goal)):
            for site in in_order(system.filled - state):
                raise CheckError(f"{name}: the obstacle {site_text(site)} is off, expected on")
            for site in in_order(system.empty & state):
                raise CheckError(f"{name}: the obstacle {site_text(site)} is on, expected off")
        return system

    def action(self, number: int) -> Action:
        """Return an action of the proof, by the number that it gives it."""
        move = self.proof.moves[number]
        if isinstance(move, Action):
            if self.system is not None:
                raise CheckError(f"move {number}: has no name, expected one of the system")
            return move
        if self.system is None:
            raise CheckError(f"move {number}: has a name, and there is no system")
        try:
            return self.system.action(move.generator, move.at)
        except InputError as error:
            raise CheckError(f"move {number}: {error}") from None

    def _numbers(self, moves: Moves) -> list[int]:
        """Return the numbers in `moves` of the actions of the proof, -1 of what is not there."""
        found: list[int] = []
        places: dict[int | Action, int] = {}
        for place in range(len(self.proof.moves)):
            number, key = moves.numbered[place], None
            if number < 0:  # the proof has another name for it, or no schedule could use it
                key = self.action(place)
                number = moves.number(key)
            known = places.setdefault(key if key is not None and number < 0 else number, place)
            if known != place:
                raise CheckError(f"move {place}: is the same as move {known}, expected another")
            found.append(number)
        return found

    @cached_property
    def _clauses(self) -> tuple[int, ProofClauses] | None:
        """The number of moves that can be made, and the clauses; None if windows refute alone."""
        rounds, proof = self.proof.refuted, self.proof
        moves = Moves(self._start, self._goal, proof.moves)
        if self.system is None:
            for number in range(len(proof.moves)):
                moves.take(self.action(number))
            usable = np.ones(2 * len(proof.moves), dtype=np.bool_)
        else:
            usable = moves.find(self.system, rounds, lambda count: self._tell("moves", count))
        numbers = self._numbers(moves)
        table = moves.table
        windows = moves.windows(table, rounds, usable)
        if windows.refuting_site() is not None:
            for what, given in (
                ("variables", proof.variables),
                ("ladders", proof.ladders),
                ("groups", proof.groups),
            ):
                if len(given):
                    raise CheckError(f"there are {what}, and nothing that they would be needed for")
            return None
        self._tell("clauses", 0)
        meanings = Meanings(proof, moves, table, windows, numbers)
        roles = roles_of(table, windows, len(moves.sites))
        ladders, groups = meanings.ladders(roles), meanings.groups()
        found = clauses_of(table, meanings.slots, roles, ladders, groups)
        return int((windows.first <= windows.last).sum()), found

    @property
    def clauses(self) -> ProofClauses:
        """The clauses; an empty one if the windows alone refute the claim."""
        if self._clauses is None:
            return ProofClauses.empty()
        return self._clauses[1]

    def dimacs(self) -> Iterator[bytes]:
        """Yield the clauses as a DIMACS file, for other checkers."""
        return dimacs(len(self.proof.variables) if self._clauses else 0, *self.clauses)

    def other_task(
        self,
        system: System | None,
        start: AbstractSet[Site],
        goal: AbstractSet[Site],
        actions: Iterable[Action],
    ) -> str | None:
        """Return why the proof is not about these states and moves, None if it is.

        The moves are those of the system; without one they are `actions`.
        """
        for name, said, given in (("start", self._start, start), ("goal", self._goal, goal)):
            apart = in_order(said ^ given)
            if apart:
                where = "there" if apart[0] in given else "in the proof"
                return f"has another {name}: {site_text(apart[0])} is on only {where}"
        if (self.system is None) != (system is None):
            told = "moves of a system" if system is None else "listed moves"
            return f"has other moves: the proof is about {told}"
        if self.system is None or system is None:
            apart_moves = set(self.proof.moves) ^ set(actions)
            return "has other moves than the proof" if apart_moves else None
        same = (self.system.table, self.system.to_table()) == (system.table, system.to_table())
        return None if same else "has another system"

    def checked(self) -> ProofResult:
        """Return what the proof proves; CheckError for the first thing that does not hold."""
        proof = self.proof
        if proof.cubes <= proof.refuted:
            raise CheckError(
                f"the schedule has {proof.cubes} rounds, itself no more than the {proof.refuted}"
                " that are said to be impossible"
            )
        self._check_schedule()
        proved = proof.standing == "proved"
        derived = self._clauses
        if (derived is None or not proved) and any(proof.log):
            raise CheckError("there is a log, and nothing that it would be needed for")
        if derived is None:
            return ProofResult(proof.refuted, proof.cubes, proved, 0, 0, 0, 0)
        moves, (literals, ends) = derived
        variables = len(proof.variables)
        lemmas = 0
        if proved:
            lemmas = Refuter(variables, literals, ends).follow(proof.log, self._tell)
        return ProofResult(proof.refuted, proof.cubes, proved, moves, variables, len(ends), lemmas)

    def _check_schedule(self) -> None:
        proof, state = self.proof, set(self._start)
        if len(proof.schedule) != proof.cubes:
            raise CheckError(
                f"the schedule has {len(proof.schedule)} cubes, expected the {proof.cubes} that"
                " the proof speaks of"
            )
        for number, cube in enumerate(proof.schedule, 1):
            self._carry_out(f"cube {number} of the schedule", cube, state)
        if frozenset(state) != self._goal:
            stray = in_order(state ^ self._goal)[0]
            is_on = "on" if stray in state else "off"
            raise CheckError(
                f"after the schedule {site_text(stray)} is {is_on}, which it is not at the goal"
            )

    def _carry_out(self, where: str, cube: Sequence[int], state: set[Site]) -> None:
        for number in cube:
            if number >= len(self.proof.moves):
                raise CheckError(
                    f"{where}: move number {number}, expected less than {len(self.proof.moves)}"
                )
        actions = [self.action(number) for number in cube]
        if not is_cube(actions):
            raise CheckError(f"{where}: its moves do not commute")
        for action in actions:
            why = why_not(action, state)
            if why is not None:
                raise CheckError(f"{where}: {why}")
            make(action, state)


def _state(name: str, sites: Sequence[Site]) -> frozenset[Site]:
    found = frozenset(sites)
    if len(found) != len(sites):
        twice = next(site for site in sites if sites.count(site) > 1)
        raise CheckError(f"{name}: {site_text(twice)} stands twice")
    return found
