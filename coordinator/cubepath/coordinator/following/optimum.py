"""The fewest rounds of all timetables in which vehicles may follow, asked of SAT solvers.

From the greatest number of rounds that is known to be too few the question is asked for one more
and one more, until the answer is a timetable: a shortest one. That fewer are not enough takes the
word of two solvers of different families, and is called agreed, not proved.

Room: coordinator; touches processes.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cubepath.coordinator.following.encoding import Schedule, Task, TooLargeError, clauses_of
from cubepath.coordinator.following.rules import Rule
from cubepath.coordinator.satisfiability.solver_process import (
    SECOND_SOLVER,
    SOLVER,
    Answer,
    Problem,
    SolverError,
    SolverProcess,
    check_installed,
)
from cubepath.protocol.path_files.following import FollowingFile, FollowingHead, FollowingLine
from cubepath.protocol.plans.vehicle_plan import VehiclePlan

_POLL_S = 0.2


@dataclass(frozen=True)
class FewestRounds:
    """What is known of the fewest rounds under a rule, between the ends of a plan.

    `rounds` are those of the best timetable that is known, and `timetable` is one if it is shorter
    than the plan's own. No timetable has fewer rounds than `lower_bound`, the most edges that one
    vehicle has to go; by the word of two solvers none has fewer than `agreed`, None if they were
    not both asked. `ended` is done, time, interrupt, or why solvers could not go on.
    """

    rounds: int
    lower_bound: int
    agreed: int | None
    timetable: FollowingFile | None
    seconds: float
    ended: str

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
) -> FewestRounds:
    """Search for a timetable of fewer than `within` rounds that ends as the plan does.

    Every vehicle ends where the plan takes it, on the plan's workspace. An interrupt ends the
    search as the time does. `tick` is called with the number of rounds that is asked for next.
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
    search = _Search(Task(plan.starts, plan.ends, plan.edges(), rule), within, seed, tick)
    search.run(seconds)
    found = None if search.best is None else _file(search.best, plan, rule)
    return FewestRounds(
        search.within,
        search.least,
        search.agreed,
        found,
        round(time.monotonic() - search.began, 3),
        search.ended,
    )


class _Search:
    """One search, and what is known so far."""

    def __init__(
        self, task: Task, within: int, seed: int, tick: Callable[[int], object] | None
    ) -> None:
        self.task = task
        self.within = within
        self.best: Schedule | None = None
        self.least = min(task.least, within)
        self.agreed: int | None = None
        self.ended = "done"
        self.began = time.monotonic()
        self._seed = seed
        self._tick = tick

    def run(self, seconds: float) -> None:
        """Ask for more and more rounds, until there is a timetable or the time is up."""
        end = self.began + seconds
        try:
            with SolverProcess(SOLVER) as first, SolverProcess(SECOND_SOLVER) as second:
                for rounds in range(self.least, self.within):
                    if not self._ask(rounds, (first, second), end):
                        return
        except (TooLargeError, SolverError) as error:
            self.ended = str(error)
        except TimeoutError:
            self.ended = "time"
        except KeyboardInterrupt:
            self.ended = "interrupt"

    def _ask(self, rounds: int, solvers: tuple[SolverProcess, SolverProcess], end: float) -> bool:
        """Return whether so many rounds are too few, by both solvers."""
        if self._tick is not None:
            self._tick(rounds)

        def go_on() -> None:
            if time.monotonic() > end:
                raise TimeoutError

        clauses = clauses_of(self.task, rounds, go_on)
        for number, solver in enumerate(solvers):
            answer = _answered(solver, clauses, end, self._seed)
            if answer is None:
                self.ended = "time"
                return False
            if answer.satisfiable:
                if number:
                    raise SolverError(f"two SAT solvers contradict each other on {rounds} rounds")
                self.best, self.within = clauses.schedule(answer.true), rounds
                return False
        self.agreed = rounds + 1
        return True


def _answered(solver: SolverProcess, problem: Problem, end: float, seed: int) -> Answer | None:
    """Return the answer of a solver, None if the time is up before."""
    if time.monotonic() >= end:
        return None
    solver.ask(problem, seed=seed)
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
