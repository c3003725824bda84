"""From a path down and from a bound up, until both meet: the optimum, and the refutation of less.

Two solvers work side by side. One looks for a path below the best, in great steps while they are
quick and in small ones at last; the other refutes one length after another from the bound on. At
the last length that is open both work at it. A path that has been found is made normal, which may
shorten it further; a length that is refuted refutes all below it, since rounds may be idle.

It touches the clock, the processes of solvers, and temporary files for logs.
"""

from __future__ import annotations

import os
import select
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import IO, Self

from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.theory.satisfiability.encoding import (
    Encoding,
    TooLargeError,
    encode,
    refuted_by_windows,
)
from cubepath.coordinator.theory.satisfiability.met_moves import MetMoves, window_bound
from cubepath.coordinator.theory.satisfiability.solver_process import (
    LOG_MAX,
    SECOND_SOLVER,
    SOLVER,
    SolverAnswer,
    SolverError,
    SolverProcess,
    new_log,
)
from cubepath.protocol.core.actions import Action

CubePath = tuple[tuple[Action, ...], ...]
_PATIENCE = 0.25
"""The share of the time that a great step down may take."""
_POLL_S = 0.25
WINDOWS, PROPAGATION, SEARCH = "windows of the moves", "unit propagation", "SAT solver"
"""What has refuted a length."""


@dataclass(frozen=True)
class Refutation:
    """Why no path has `rounds` rounds or fewer: clauses, and a log (None: propagation does it).

    `why` names the argument, and `log` is a file of the `Prover`, until that is closed.
    """

    rounds: int
    why: str
    log: IO[bytes] | None
    problem: Encoding = field(repr=False, compare=False)


@dataclass
class Prover:
    """The search for the optimum between the ends of `met`, from what is known before it.

    `best` is the best path so far, `bound` what is proved: no path has fewer cubes. `agreed` may be
    greater: two solvers found no path with fewer cubes, but the log is too long to be checked.
    `stopped_by` says why the search ended early, if not by time. Use as a context manager; `run`
    may be called once, and an exception out of it (an interrupt, the end of a budget) leaves what
    is known so far here.
    """

    met: MetMoves
    best: CubePath
    bound: int
    seed: int = 0
    watch: Callable[[CubePath], object] | None = None
    tick: Callable[[], object] | None = None
    log_max: int = LOG_MAX
    agreed: int = 0
    refutation: Refutation | None = None
    problems: int = 0
    stopped_by: str | None = None
    _single: dict[int, Encoding] = field(default_factory=dict)
    _doubtful: int = 0
    _stack: ExitStack = field(default_factory=ExitStack)

    def __enter__(self) -> Self:
        """Return the prover."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the solvers, and close the logs."""
        self._stack.close()

    @property
    def _least(self) -> int:
        """The least number of cubes that is still worth a question."""
        return max(self.bound, self.agreed)

    def run(self, seconds: float, *, refute: bool = False) -> None:
        """Search until the optimum is known or the time is up.

        With `refute`, a path that is known to be optimal is proved to be once more, by clauses.
        """
        end = time.monotonic() + seconds
        patience = max(1.0, _PATIENCE * seconds)
        try:
            jobs = _Job(0, self._stack, self.log_max), _Job(1, self._stack, self.log_max)
            self._search(jobs, end, patience)
            refuted = 0 if self.refutation is None else self.refutation.rounds + 1
            if refute and refuted < self.bound == len(self.best):
                self.bound -= 1
                self._search(jobs, end, patience)
        except (TooLargeError, SolverError) as error:
            self.stopped_by = str(error)

    def _search(self, jobs: tuple[_Job, _Job], end: float, patience: float) -> None:
        window_bound(self.met, self.bound, len(self.best), raised=self._refuted_by_windows)
        while self._least < len(self.best) and time.monotonic() < end:
            self._assign(*jobs, patience)
            self._wait(jobs, end)

    def _refuted_by_windows(self, rounds: int) -> None:
        self._refuted(Refutation(rounds, WINDOWS, None, refuted_by_windows(self.met, rounds)))

    def _refuted(self, found: Refutation) -> None:
        """Note that no path has so few rounds."""
        if found.rounds >= self.bound:
            if self.refutation is not None and self.refutation.log is not None:
                self.refutation.log.close()
            self.bound, self.refutation = found.rounds + 1, found
        if self.tick is not None:
            self.tick()

    def _assign(self, down: _Job, up: _Job, patience: float) -> None:
        """End what has become pointless, and give each solver that is idle its next problem."""
        for job in (down, up):
            if job.problem is not None and not self._is_open(job.problem.rounds):
                job.end()
        self._ask_again(down, up)
        if down.problem is None and self._least < len(self.best) < down.most:
            gap = len(self.best) - max(self._least, self._doubtful)
            down.step = max(1, min(down.step, gap // 2))
            self._begin(down, len(self.best) - down.step, patience)
        if up.problem is None and self._least < len(self.best):
            self._begin(up, self._least)

    def _is_open(self, rounds: int) -> bool:
        return self._least <= rounds < len(self.best)

    def _ask_again(self, down: _Job, up: _Job) -> None:
        """Have another solver decide what one has decided without a log that can be checked."""
        for rounds in [rounds for rounds in self._single if not self._is_open(rounds)]:
            del self._single[rounds]
        if self._single and not any(job.second and job.problem is not None for job in (down, up)):
            job = down if down.problem is None else up
            job.begin(self._single[max(self._single)], SECOND_SOLVER)
            job.second = True

    def _begin(self, job: _Job, rounds: int, patience: float = 0.0) -> None:
        """Have a solver work at a length; a great step ends with the patience."""
        self.problems += 1
        try:
            problem = encode(self.met, rounds)
        except TooLargeError:
            if rounds == self._least:
                raise
            job.most = len(self.best)
            return
        if problem.impossible:
            self._refuted(Refutation(rounds, WINDOWS, None, problem))
            return
        if patience and job.step > 1:
            # What finds paths quickly; what it refutes, the other will, with a log.
            job.begin(problem, SECOND_SOLVER)
            job.until = time.monotonic() + patience
        else:
            job.begin(problem, SOLVER, seed=2 * self.seed + job.number, log=new_log(self._stack))

    def _wait(self, jobs: Iterable[_Job], end: float) -> None:
        """Wait until some solver answers, a great step takes too long, or the time is up."""
        busy = [job for job in jobs if job.problem is not None]
        if busy:
            wait = max(0.0, min(end - time.monotonic(), _POLL_S))
            select.select([job.solver for job in busy], [], [], wait)
        for job in busy:
            answer = job.solver.answer(0)
            if answer is not None:
                self._take(job, answer)
            elif job.until is not None and time.monotonic() > job.until:
                job.step //= 2
                job.end()
        if self.tick is not None:
            self.tick()

    def _take(self, job: _Job, answer: SolverAnswer) -> None:
        great, second = job.until is not None, job.second
        problem = job.taken()
        if answer.satisfiable:
            job.step *= 2
            moves = (action for cube in problem.schedule(answer.true) for action in cube)
            found = normal_cube_path(moves)
            if len(found) < len(self.best):
                self.best = found
                if self.watch is not None:
                    self.watch(found)
        elif second:
            self.agreed = max(self.agreed, problem.rounds + 1)
        elif great:
            self._doubtful = max(self._doubtful, problem.rounds + 1)
        elif answer.log is None:
            self._single[problem.rounds] = problem
        elif os.fstat(answer.log.fileno()).st_size == 0:
            self._refuted(Refutation(problem.rounds, PROPAGATION, None, problem))
        else:
            self._refuted(Refutation(problem.rounds, SEARCH, answer.log, problem))


class _Job:
    """What one of the two solvers is at."""

    def __init__(self, number: int, stack: ExitStack, log_max: int) -> None:
        self.number = number
        self._solvers = {
            name: stack.enter_context(SolverProcess(name, log_max=log_max))
            for name in (SOLVER, SECOND_SOLVER)
        }
        self.solver = self._solvers[SOLVER]
        self.problem: Encoding | None = None
        """The problem that it works on, None if it is idle."""
        self.second = False
        """Whether it decides what the first solver has decided."""
        self.until: float | None = None
        """When to give up a great step."""
        self.step = 1 << 20
        """How far below the best path it looks for a path."""
        self.most = 1 << 30
        """It has nothing to do while the best path has this many cubes or more."""

    def begin(
        self, problem: Encoding, solver: str, *, seed: int = 0, log: IO[bytes] | None = None
    ) -> None:
        """Ask one of its solvers, by name."""
        self.end()
        self.solver, self.problem = self._solvers[solver], problem
        self.second, self.until = False, None
        self.solver.ask(problem, seed=seed, log=log)

    def taken(self) -> Encoding:
        """Return the problem that was answered, and be idle."""
        problem, self.problem = self.problem, None
        if problem is None:
            raise SolverError("a SAT solver answered that was not asked")
        return problem

    def end(self) -> None:
        """Give up what it works on."""
        if self.problem is not None:
            self.solver.end()
        self.problem = None
