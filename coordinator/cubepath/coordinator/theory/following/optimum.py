"""The fewest rounds of all timetables in which vehicles may follow, asked of SAT solvers.

From the greatest number of rounds that is known to be too few the question is asked for one more
and one more, until the answer is a timetable: a shortest one. That fewer are not enough is proved
by the log of the solver, which `proofs` puts into a file. Where that is too long to be checked, a
solver of another family is asked, and what both say is called agreed, not proved.

It touches processes, and temporary files for logs.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from tempfile import TemporaryFile
from typing import IO, Any

from cubepath.coordinator.theory.following.encoding import (
    FollowingTooLargeError,
    Schedule,
    VehicleClauses,
    VehicleTask,
    clauses_of,
)
from cubepath.coordinator.theory.following.timetable import Rule
from cubepath.coordinator.theory.satisfiability.proving import PROPAGATION, SEARCH
from cubepath.coordinator.theory.satisfiability.solver_process import (
    LOG_MAX,
    SECOND_SOLVER,
    SOLVER,
    SolverAnswer,
    SolverError,
    SolverProblem,
    SolverProcess,
    check_installed,
)
from cubepath.protocol.path_files.following import FollowingFile, FollowingHead, FollowingLine
from cubepath.protocol.plans.imported import VehiclePlan

_POLL_S = 0.2
WAY = "way of a vehicle"
"""What refutes fewer rounds than some vehicle has edges to go."""


@dataclass(frozen=True)
class Refuted:
    """Why no timetable has so many `rounds` or fewer, by a log of a solver, or by the ways alone.

    `log` is None where unit propagation of the clauses does it. `clauses` is None where some
    vehicle has further to go.
    """

    task: VehicleTask
    rounds: int
    why: str
    clauses: VehicleClauses | None = None
    log: IO[bytes] | None = None


@dataclass(frozen=True)
class FewestRounds:
    """What is known of the fewest rounds under a rule, between the ends of a plan.

    `rounds` are those of the best timetable that is known, and `timetable` is one if it is shorter
    than the plan's own. No timetable has fewer rounds than `lower_bound`, by `refuted`, which is
    None where nothing moves. By the word of two solvers none has fewer than `agreed`, None if they
    were not both asked. `ended` is done, time, interrupt, or why solvers could not go on.
    """

    rounds: int
    lower_bound: int
    agreed: int | None
    timetable: FollowingFile | None
    seconds: float
    ended: str
    refuted: Refuted | None

    @property
    def proved_by(self) -> str | None:
        """What proves the lower bound, None where nothing moves."""
        return None if self.refuted is None else self.refuted.why

    @property
    def optimal(self) -> bool | None:
        """Whether no timetable is shorter, None if that is not proved."""
        return True if self.rounds == self.lower_bound else None

    def document(self) -> dict[str, Any]:
        """Return the keys that ``shorten --following RULE --prove SECONDS`` adds."""
        return {
            "improved": self.rounds,
            "lower_bound": self.lower_bound,
            "agreed": self.agreed,
            "optimal": self.optimal,
            "proved_by": self.proved_by,
            "ended": self.ended,
        }


def fewest_rounds(
    plan: VehiclePlan,
    rule: Rule,
    *,
    within: int,
    seconds: float,
    seed: int = 0,
    tick: Callable[[int], object] | None = None,
    logs: ExitStack | None = None,
    log_max: int = LOG_MAX,
) -> FewestRounds:
    """Search for a timetable of fewer than `within` rounds that ends as the plan does.

    Every vehicle ends where the plan takes it, on the plan's workspace. An interrupt ends the
    search as the time does. `tick` is called with the number of rounds that is asked for next.
    Logs of more than `log_max` bytes are given up. That of what was refuted can be read until
    `logs` is closed; without `logs` it is closed already.
    InputError if the solvers are not installed.

    >>> from pathlib import Path
    >>> _ = Path("round.json").write_text(
    ...     '{"starts": [[0, 0]], "goals": [[0, 1]], "rounds": [1, 1, 1],'
    ...     ' "moves": [[[0, 0], [1, 0]], [[1, 0], [1, 1]], [[1, 1], [0, 1]]]}'
    ... )
    >>> found = fewest_rounds(read_vehicle_plan("round.json"), "mapf", within=3, seconds=60)
    >>> found.rounds, found.lower_bound, found.optimal
    (1, 1, True)
    """
    check_installed("--prove")
    task = VehicleTask(plan.starts, plan.ends, plan.edges(), rule)
    search = _Search(task, within, seed, tick, log_max)
    with ExitStack() as stack:
        search.run(seconds, stack if logs is None else logs)
    found = None if search.best is None else _file(search.best, plan, rule)
    return FewestRounds(
        search.within,
        search.least,
        search.agreed,
        found,
        round(time.monotonic() - search.began, 3),
        search.ended,
        search.refuted,
    )


class _Search:
    """One search, and what is known so far."""

    def __init__(
        self,
        task: VehicleTask,
        within: int,
        seed: int,
        tick: Callable[[int], object] | None,
        log_max: int,
    ) -> None:
        self.task = task
        self.within = within
        self.best: Schedule | None = None
        self.least = min(task.least, within)
        self.agreed: int | None = None
        self.ended = "done"
        self.began = time.monotonic()
        self.refuted = Refuted(task, self.least - 1, WAY) if self.least else None
        self._seed = seed
        self._tick = tick
        self._log_max = log_max

    def run(self, seconds: float, logs: ExitStack) -> None:
        """Ask for more and more rounds, until there is a timetable or the time is up."""
        end = self.began + seconds
        try:
            with (
                SolverProcess(SOLVER, log_max=self._log_max) as first,
                SolverProcess(SECOND_SOLVER) as second,
            ):
                for rounds in range(self.least, self.within):
                    if not self._ask(rounds, (first, second), end, logs):
                        return
        except (FollowingTooLargeError, SolverError) as error:
            self.ended = str(error)
        except TimeoutError:
            self.ended = "time"
        except KeyboardInterrupt:
            self.ended = "interrupt"

    def _ask(
        self, rounds: int, solvers: tuple[SolverProcess, SolverProcess], end: float, logs: ExitStack
    ) -> bool:
        """Return whether so many rounds are too few, by a log or by both solvers."""
        if self._tick is not None:
            self._tick(rounds)

        def go_on() -> None:
            if time.monotonic() > end:
                raise TimeoutError

        clauses = clauses_of(self.task, rounds, go_on)
        first, second = solvers
        answer = _answered(first, clauses, end, self._seed, _log(logs))
        if answer is not None and answer.satisfiable is False:
            if answer.log is not None:
                self._note(rounds, clauses, answer.log)
                return True
            answer = _answered(second, clauses, end, self._seed, None)
            if answer is not None and answer.satisfiable:
                raise SolverError(f"two SAT solvers contradict each other on {rounds} rounds")
        if answer is None:
            self.ended = "time"
            return False
        if answer.satisfiable:
            self.best, self.within = clauses.schedule(answer.true), rounds
            return False
        self.agreed = rounds + 1
        return True

    def _note(self, rounds: int, clauses: VehicleClauses, log: IO[bytes]) -> None:
        """Note that so many rounds are refuted, in a way that can be checked."""
        if self.refuted is not None and self.refuted.log is not None:
            self.refuted.log.close()
        size = os.fstat(log.fileno()).st_size
        why = SEARCH if size else PROPAGATION
        self.refuted = Refuted(self.task, rounds, why, clauses, log if size else None)
        self.least = rounds + 1
        if self.agreed is not None and self.agreed <= self.least:
            self.agreed = None


def _log(logs: ExitStack) -> IO[bytes]:
    """Return a file without a name, which is closed with all others."""
    try:
        return logs.enter_context(TemporaryFile())
    except OSError as error:
        raise SolverError(f"no file for the log of a SAT solver: {error.strerror}") from None


def _answered(
    solver: SolverProcess, problem: SolverProblem, end: float, seed: int, log: IO[bytes] | None
) -> SolverAnswer | None:
    """Return the answer of a solver, None if the time is up before."""
    if time.monotonic() >= end:
        return None
    solver.ask(problem, seed=seed, log=log)
    while (left := end - time.monotonic()) > 0:
        answer = solver.answer(min(left, _POLL_S))
        if answer is not None:
            return answer
    solver.end()
    return None


def _file(schedule: Schedule, plan: VehiclePlan, rule: Rule) -> FollowingFile:
    lines = [
        FollowingLine(who, source, target, round=number)
        for number, moves in enumerate(schedule, 1)
        for who, source, target in moves
    ]
    rounds = max((line.round or 0 for line in lines), default=0)
    head = FollowingHead(rule, vehicles=len(plan.starts), moves=len(lines), rounds=rounds)
    return FollowingFile(head, tuple(lines))
