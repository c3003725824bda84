"""What is known beyond the class of a path, stage by stage, each within its share of the time.

It uses the clock, to know when to stop, the processes of solvers, and the file of a proof.
"""

import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.shortening.normal_path import Shortened
from cubepath.coordinator.theory.optimality.tasks import PathTask, proof_of
from cubepath.coordinator.theory.satisfiability.encoding import prepare as prepare_clauses
from cubepath.coordinator.theory.satisfiability.met_moves import MetMoves, window_bound
from cubepath.coordinator.theory.satisfiability.proving import WINDOWS, Prover
from cubepath.coordinator.theory.search.anytime import CubePath, Improvement, improve, prepare_all
from cubepath.coordinator.theory.search.budget import Budget, SearchStage, SpentError
from cubepath.coordinator.theory.search.exact import optimum
from cubepath.coordinator.theory.search.lower_bounds import lower_bound
from cubepath.coordinator.theory.search.own_ends import OwnEnds
from cubepath.coordinator.theory.search.sat_windows import STAGE
from cubepath.coordinator.theory.search.transitions import (
    LABELS_MAX,
    Transitions,
    maskable,
    only_class,
)
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.core.system import Bound
from cubepath.protocol.path_files.optimality_proofs import write_proof

Tick = Callable[[str, int], object]
"""Called with the name of a stage and the steps that it took so far."""
Between = Callable[[int, int], object]
"""Called with what is proved, a lower bound, and the number of cubes of the best path."""
_SHARES = {"classes": 0.1, "bounds": 0.2, "windows": 0.2, "optimum": 0.25, "proof": 1.0}
"""Shares of the time that these stages may take; the search gets the rest, a proof its own time."""
_BOUND_STEPS = 20_000_000
"""Without a time limit, the bounds may look at this many sites on the way of modules, and pairs."""
_WINDOW_STEPS = 1_000_000
"""Without a time limit, the windows may look at this many sites and moves."""
_LISTED_MAX = 20_000
"""Clauses, and the exhaustive search, take this many listed moves at most: more are not built."""
_SETS_A_STATE = 40
"""Without a time limit, the exhaustive search may look at this many sets of moves per state."""


class OptimalityStages:
    """What is known beyond the class of a path, stage by stage."""

    def __init__(
        self,
        task: PathTask,
        found: Shortened | None,
        *,
        seconds: float | None,
        max_states: int,
        tick: Tick | None,
    ) -> None:
        self._task = task
        self._seconds = seconds
        self._whole = Budget(seconds)
        self._for_proof: Budget | None = None
        self._max_states = max_states
        self._tick = tick
        self._system, self._start, self._goal = task.system, task.start, task.goal
        self._own: OwnEnds | None = None
        if task.labelled_goals and task.system is not None:
            # Each vehicle must keep its own end: a label says which it is.
            self._own = own = OwnEnds.of(task.system, task.path, task.start)
            self._system, self._start, self._goal = own.system, own.start, own.goal
        self._small = maskable(self._system)
        self._found = found
        self._stopped = False
        self._compiled = False
        self.stages: list[SearchStage] = []
        self.better: CubePath | None = None
        """The best path, if it is not the normal cube path."""
        self.bound = Bound(0, "no move")
        self.only: bool | None = None
        self.shorter = False
        """Whether a shorter path is known to exist that was not asked for."""
        self.written: str | None = None
        """The file with the proof."""
        self.agreed = 0
        """What two solvers agree on and nobody can check: no path has fewer cubes."""

    def share(self, seconds: float, before: float) -> None:
        """Take this many seconds for all stages, a share `before` of them for those before a proof.

        The proof gets what they leave. Where clauses cannot be built, they get all.
        """
        self._for_proof = Budget(seconds)
        self._seconds = seconds if self._without_clauses() else before * seconds
        self._whole = Budget(self._seconds)

    def _extend(self, seconds: float) -> None:
        """Give the stages the time that compiling took."""
        self._whole.extend(seconds)
        if self._for_proof is not None:
            self._for_proof.extend(seconds)

    @cached_property
    def _steps(self) -> Transitions:
        return Transitions(self._system, () if self._system is not None else self._listed())

    @cached_property
    def _normal(self) -> CubePath:
        return normal_cube_path(self._task.path) if self._found is None else self._found.cube_path

    @property
    def best(self) -> CubePath:
        """The best path so far."""
        return self._normal if self.better is None else self.better

    @property
    def cubes(self) -> int:
        """The number of cubes of the best path so far, whose actions may not have been built."""
        if self.better is None and self._found is not None:
            return self._found.cubes
        return len(self.best)

    def _stage(
        self, name: str, job: Callable[[SearchStage, Budget], None], steps: int | None = None
    ) -> None:
        """Do a job in its share of the time, or else in `steps` steps, and note what it spent."""
        tick = self._tick
        left, part = self._whole.seconds_left, _SHARES.get(name)
        share = None if left is None or part is None else min(left, part * (self._seconds or 0.0))
        budget = Budget(
            share,
            steps=steps if share is None else None,
            tick=None if tick is None else partial(tick, name),
        )
        stage = SearchStage(name)
        self.stages.append(stage)
        begun = time.monotonic()
        try:
            if tick is not None:
                tick(name, 0)
            job(stage, budget)
        except KeyboardInterrupt:
            # An interrupt means that the time is up; what was found so far is kept.
            stage.ended = "interrupt"
            self._stopped = True
        finally:
            stage.seconds = time.monotonic() - begun
        if stage.ended == "done" and budget.spent:
            stage.ended = "limit" if share is None else "time"

    def _raise_bound(self, bound: Bound) -> None:
        if bound.cubes > self.bound.cubes:
            self.bound = bound

    def ask_for_classes(self) -> None:
        """Find out whether there is only one class, and so nothing beyond it."""

        def job(stage: SearchStage, budget: Budget) -> None:
            self._steps.budget = budget
            self.only = only_class(self._steps, self._start)
            stage.steps = budget.steps

        if self._system is not None and self.cubes and self._small:
            self._stage("classes", job)
            if self.only is not None:
                self.stages[-1].ended = "done"  # the complex is small, and asks no budget
            # What it took past its share, it took to compile.
            over = self.stages[-1].seconds - _SHARES["classes"] * (self._seconds or 0.0)
            self._extend(max(0.0, over))
        if self.only:
            self.bound = Bound(self.cubes, "the only class")

    def bound_from_below(self) -> None:
        """Bound the cubes of every path between the ends."""

        def job(stage: SearchStage, budget: Budget) -> None:
            found = lower_bound(
                self._system, self._start, self._goal, within=self.cubes, budget=budget
            )
            stage.steps = budget.steps
            if found.cubes > self.cubes:
                raise CheckError(
                    f"the system claims that no path has fewer than {found.cubes} cubes"
                    f" ({found.why}), but one of {self.cubes} is known"
                )
            self._raise_bound(found)

        if not self._stopped:
            self._stage("bounds", job, _BOUND_STEPS)

    def bound_by_windows(self) -> None:
        """Bound the cubes of every path by when each site can have which value."""

        def job(stage: SearchStage, budget: Budget) -> None:
            def raised(rounds: int) -> None:
                stage.steps = len(self._met.actions)
                self._raise_bound(Bound(rounds + 1, WINDOWS))

            with suppress(SpentError):
                self._met.spend = budget.spend
                window_bound(self._met, self.bound.cubes, self.cubes, raised=raised)
                stage.steps = len(self._met.actions)

        # Without a system it would be all moves of the input, and few need to be built otherwise.
        known = self._system is not None and self._small and not self._stopped
        if known and 0 < self.bound.cubes < self.cubes:
            self._compile()
            if not self._stopped:
                self._stage("windows", job, _WINDOW_STEPS)

    def _compile(self) -> None:
        """Compile what clauses need, once for an installation; other stages keep their time."""
        if not self._compiled:
            self._stage("compile", lambda _stage, _budget: prepare_clauses())
            self._extend(self.stages[-1].seconds)
            self._compiled = True

    @property
    def _listed_count(self) -> int:
        """Return how many moves occur, without looking at them one by one."""
        return len(self._task.path if self._found is None else self._found.path.actions)

    @cached_property
    def _met(self) -> MetMoves:
        return MetMoves(self._system, self._listed(), self._start, self._goal)

    def search_all(self, *, take: bool) -> None:
        """Search the states around both ends; with `take`, an optimum becomes the best path."""
        most = self.cubes - 1

        def job(stage: SearchStage, budget: Budget) -> None:
            self._steps.budget = budget
            ends = self._steps.encode(self._start), self._steps.encode(self._goal)
            exact = optimum(self._steps, *ends, max_states=self._max_states, most=most)
            stage.steps = exact.states
            # Stopped neither by the budget nor because all shorter paths are excluded.
            if exact.cubes is None and exact.at_least <= most and not budget.spent:
                stage.ended = "limit"
            self._raise_bound(Bound(exact.at_least, "exhaustive search"))
            if exact.cubes is not None:
                self.bound = Bound(len(exact.cubes), "exhaustive search")
                self.shorter = not take
                if take:
                    actions, cubes = self._steps.actions, exact.cubes
                    self.better = self._plain([[actions[each] for each in cube] for cube in cubes])

        few = self._system is not None or self._listed_count <= _LISTED_MAX
        if self._small and few and not self._stopped and self.bound.cubes <= most:
            self._stage("optimum", job, _SETS_A_STATE * self._max_states)

    def improve(
        self, *, iterations: int | None, seed: int, watch: Callable[[Improvement], object] | None
    ) -> None:
        """Search for a better path in the remaining time."""
        task, timed, by_sat = self._task, iterations is None, SearchStage(STAGE)
        kept: list[CubePath] = []

        def keep(better: Improvement) -> None:
            kept.append(better.cube_path)
            if watch is not None:
                watch(better)

        def job(stage: SearchStage, _budget: Budget) -> None:
            def count(steps: int) -> None:
                stage.steps = steps
                if self._tick is not None:
                    self._tick(stage.name, steps)

            improve(
                task.path,
                task.start,
                task.system,
                seconds=self._whole.seconds_left,
                iterations=iterations,
                seed=seed,
                labelled_goals=task.labelled_goals,
                enough=self.bound.cubes,
                watch=keep,
                tick=count,
                normal=self.best,
                transitions=None if task.labelled_goals else self._steps,
                by_sat=by_sat,
            )
            if len(kept[-1] if kept else self.best) > self.bound.cubes:
                stage.ended = "time" if self._whole.spent else "limit"

        if not self._stopped and self.bound.cubes < self.cubes:
            self._compile_search(timed=timed)
            self._stage("search", job)
            if timed:
                self.stages.append(by_sat)
        if kept:
            self.better = min(kept, key=lambda path: (len(path), sum(map(len, path))))

    def _compile_search(self, *, timed: bool) -> None:
        """Compile, once for an installation; the search gets its time all the same."""
        system = self._task.system
        clauses = timed and not self._compiled
        taken: list[bool] = []

        def job(_stage: SearchStage, _budget: Budget) -> None:
            taken.append(prepare_all(system, with_solver=clauses))

        self._stage("compile", job)
        self._extend(self.stages[-1].seconds)
        if taken == [False]:
            self.stages.pop()

    def prove(
        self,
        seconds: float,
        *,
        seed: int,
        proof: Path | str | None,
        watch: Callable[[Improvement], object] | None,
        between: Between | None,
    ) -> None:
        """Search for the optimum by SAT solvers; write the refutation of less, if asked to.

        The time is `seconds`, or after `share` what the other stages have left of it.
        """
        if self._stopped or (proof is None and self.bound.cubes == self.cubes):
            return

        def job(stage: SearchStage, budget: Budget) -> None:
            stage.why = self._without_clauses()
            if stage.why is not None:
                if self._start != self._goal:
                    stage.ended = "limit"
                return
            with suppress(SpentError):
                self._ask_solvers(
                    stage, budget, seed=seed, proof=proof, watch=watch, between=between
                )
            if stage.ended == "done" and self.bound.cubes < self.cubes:
                stage.ended = "time"

        self._compile()
        if not self._stopped:
            self._whole = Budget(seconds) if self._for_proof is None else self._for_proof
            self._seconds = seconds
            self._stage("proof", job)

    def _without_clauses(self) -> str | None:
        """Return why no clauses can be built, None if they can."""
        if self._start == self._goal:
            return "a path without cubes needs no proof"
        if not self._small:
            labels = 0 if self._system is None else self._system.labels
            return f"clauses for {labels} labels, {LABELS_MAX} at most"
        if self._system is None and self._listed_count > _LISTED_MAX:
            return f"clauses for {self._listed_count:,} moves, {_LISTED_MAX:,} at most"
        return None

    def _ask_solvers(
        self,
        stage: SearchStage,
        budget: Budget,
        *,
        seed: int,
        proof: Path | str | None,
        watch: Callable[[Improvement], object] | None,
        between: Between | None,
    ) -> None:
        """Search until the budget is spent, and take what was found, however that ends."""

        def keep(path: CubePath) -> None:
            self.better = self._plain(path)
            if watch is not None:
                watch(Improvement(self.better, stage.steps, 0))

        def count() -> None:
            stage.steps = prover.problems
            if self._tick is not None:
                self._tick(stage.name, prover.problems)
            if between is not None:
                between(prover.bound, len(prover.best))
            budget.spend(0)

        self._met.spend = budget.spend
        prover = Prover(self._met, self._labelled, self.bound.cubes, seed, keep, count)
        with prover:
            try:
                prover.run(budget.seconds_left or 0.0, refute=proof is not None)
            finally:
                stage.steps = prover.problems
                # What was proved in time is written, however long that takes.
                self._take_proof(prover, proof)
        if prover.stopped_by is not None:
            stage.ended, stage.why = "limit", prover.stopped_by

    def _listed(self) -> Iterable[Action]:
        """Return the moves that occur, where there is no system; no others exist."""
        if self._system is not None or self._found is None:
            return self._task.path
        path = self._found.path
        return (path.actions[number] for number in np.unique(path.numbers).tolist())

    def _plain(self, cubes: Iterable[Iterable[Action]]) -> CubePath:
        """Return the normal cube path of moves in which vehicles may have their own labels."""
        actions = [action for cube in cubes for action in cube]
        return normal_cube_path(actions if self._own is None else self._own.plain(actions))

    @property
    def _labelled(self) -> CubePath:
        """The best path, as moves of the system in which each vehicle keeps its own end."""
        return self.best if self._own is None else self._own.labelled(self.best)

    def _take_proof(self, prover: Prover, proof: Path | str | None) -> None:
        """Take over what was proved, and write it."""
        self.agreed = prover.agreed
        refuted = prover.refutation
        if refuted is None:
            return
        self._raise_bound(Bound(refuted.rounds + 1, refuted.why))
        if proof is None or refuted.rounds + 1 < self.bound.cubes:
            return
        scene = None if self._found is None else self._found.given.scene
        ends = self._start, self._goal
        write_proof(proof, proof_of(refuted, prover.best, scene, self._system, ends))
        self.written = str(proof)
