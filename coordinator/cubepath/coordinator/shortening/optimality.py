"""How far a shortened path is from the best there is: improvement, lower bound, optimum.

There are three gaps. *Shortening*: from the moves to the normal cube path, the shortest of its
homotopy class; closed by `cubepath.coordinator.normal_form.heap`. *Class*: from there to the best
path found in any class. *Proof*: from there to the greatest lower bound that was proved.

Room: coordinator; touches only the clock, to know when to stop.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from cubepath.coordinator.normal_form.admissibility import end_of
from cubepath.coordinator.normal_form.definitions import end_state, is_normal
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.satisfiability.encoding import prepare as prepare_clauses
from cubepath.coordinator.satisfiability.met_moves import MetMoves
from cubepath.coordinator.satisfiability.proving import WINDOWS, Prover
from cubepath.coordinator.satisfiability.solver_process import check_installed
from cubepath.coordinator.satisfiability.window_bounds import window_bound
from cubepath.coordinator.search.anytime import CubePath, Improved, improve
from cubepath.coordinator.search.budget import Budget, SpentError, Stage
from cubepath.coordinator.search.exact import MAX_STATES, Optimum, optimum, too_wide
from cubepath.coordinator.search.lower_bounds import lower_bound
from cubepath.coordinator.search.said import prepare_for, prepares
from cubepath.coordinator.search.simply_connected import only_class
from cubepath.coordinator.search.transitions import LABELS_MAX, Transitions, maskable
from cubepath.coordinator.shortening.normal_path import Shortened
from cubepath.coordinator.shortening.optimality_proof import proof_of
from cubepath.coordinator.shortening.path_input import PathInput
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.names import GeneratorPlacement
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Bound, System
from cubepath.protocol.path_files.moves import CubeName
from cubepath.protocol.path_files.optimality_proofs import write_proof

State = frozenset[Site]
NamedPath = tuple[tuple[CubeName, ...], ...]


@dataclass(frozen=True)
class Task:
    """The task that a path solves: its start and end, and the system whose moves it may use.

    Without a system the moves are those of `path`. With `labelled_goals` the vehicles of a graph
    have no labels, but each must end where the path takes it. `end` is the state at the end, if it
    is known already.
    """

    path: Sequence[Action]
    start: State
    system: System | None
    labelled_goals: bool = False
    end: State | None = None

    @cached_property
    def goal(self) -> State:
        """The state at the end."""
        return end_state(self.path, self.start) if self.end is None else self.end


@dataclass(frozen=True)
class Beyond:
    """What is known beyond the class of a path; the keys that ``shorten --json`` adds.

    `improved` is the number of cubes after the search, None if no search was asked for.
    `lower_bound` holds for every path of these moves between the same ends, by the argument `why`.
    `optimal` says whether the reported path (the improved one, or else the normal cube path) has as
    few cubes as any; None if that is not known. `only_class` says whether there is only one class,
    None if that is not known. `agreed` is greater than `lower_bound` where two solvers found no
    path with fewer cubes, but their logs are too long to be checked; otherwise None. `proof` is the
    file with the proof, None if none was written. `spent` says what each stage took. `cube_path` is
    the reported path, and `named` the names of its moves.
    """

    improved: int | None
    lower_bound: int
    optimal: bool | None
    only_class: bool | None
    why: str
    spent: tuple[Stage, ...]
    agreed: int | None
    proof: str | None
    _cube_path: Callable[[], CubePath] = field(repr=False, compare=False)
    _named: Callable[[], NamedPath] = field(repr=False, compare=False)

    @cached_property
    def cube_path(self) -> CubePath:
        """The cubes of the reported path, as actions."""
        return self._cube_path()

    @cached_property
    def named(self) -> NamedPath:
        """The names of these actions, none if the path was not given with names."""
        return self._named()

    def document(self) -> dict[str, Any]:
        """Return the keys of ``--json``."""
        keys = ("improved", "lower_bound", "optimal", "only_class")
        found = {key: getattr(self, key) for key in keys}
        found |= {"proved_by": self.why, "agreed": self.agreed, "proof": self.proof}
        return found | {"spent": [stage.document() for stage in self.spent]}


def task_of(found: Shortened) -> Task:
    """Return the task of a path that was shortened.

    Where a plan's vehicles have goals of their own, each must end where the path takes it.
    InputError for moves of which only support and trace are known, and for moves that the system
    does not have: the possible moves are then unknown.

    >>> task = task_of(shorten(play("hex:n=4")))
    >>> in_order(task.start), in_order(task.goal)
    (((0, 0), (1, 0), (2, 0), (3, 0)), ((3, 0), (3, 1), (3, 2), (3, 3)))
    """
    given = found.given
    scene = given.scene
    if scene is None:
        return _of_moves_alone(given)
    actions = tuple(action for cube in found.cube_path for action in cube)
    if given.form in {"moves", "binary moves"}:
        for action in dict.fromkeys(actions):
            if _placed(scene.system, action) is None:
                raise InputError(
                    f"{given.source}: {action!r} is no move of {scene.spec}: expected moves of the"
                    " system, or no --system, to look beyond the class"
                )
    return Task(actions, scene.start_state, scene.system, labelled_goals=given.labelled_goals)


def _of_moves_alone(given: PathInput) -> Task:
    """Return the task of self-contained moves: no moves exist but those that occur."""
    if given.start is None:
        name = given.numbered.name(int(np.flatnonzero(given.numbered.ends < 0)[0]))
        raise InputError(
            f'{given.source}: move {name!r} has no "before" and "after": expected both, or'
            " --system SYSTEM, to look beyond the class"
        )
    return Task(given.actions, given.start, None, end=end_of(given.numbered, given.start))


def beyond(
    task: Task,
    found: Shortened | None = None,
    *,
    seconds: float | None = None,
    iterations: int | None = None,
    seed: int = 0,
    max_states: int = MAX_STATES,
    prove: float | None = None,
    proof: Path | str | None = None,
    watch: Callable[[Improved], object] | None = None,
    tick: Tick | None = None,
    between: Between | None = None,
) -> Beyond:
    """Look beyond the class of a path: improve it if time is given, and bound what is possible.

    `seconds` is the time for all stages together. Without it each stage is bounded by the number of
    its steps, and the result depends only on the input and `seed`; `iterations` is the number of
    steps of the search for a better path. `prove` is the time for a search by SAT solvers, from the
    best path down and from the bound up, which comes last; without `seconds` and `iterations` it is
    the time for all stages. `proof` says where to write what it has proved; then the clauses prove
    the bound also where it is known otherwise. The exhaustive search keeps at most about
    `max_states` states; if it completes, it decides `optimal`. An improved path is checked by
    independent code, from the start state on, before it is returned: CheckError if it is not a
    legal normal cube path to the same end. `found` is the shortened path, if it is known already,
    and gives the moves their names; without it they have none. An interrupt (KeyboardInterrupt)
    ends the search with what is known so far, as running out of time does. `tick` is called now and
    then with the current stage and the steps that it took, `watch` with every better path, and
    `between`, while a proof is searched for, with the lower bound and the best number of cubes.
    InputError as for `improve`, and if a proof is asked for without the library that it takes.

    >>> found = shorten(play("agv:graph=grid3x3,n=3", "random", seed=2, max_rounds=30))
    >>> better = beyond(task_of(found), found, iterations=200)
    >>> found.cubes, better.improved, better.lower_bound, better.optimal
    (9, 2, 2, True)
    """
    asked = seconds is not None or iterations is not None or prove is not None
    if prove is not None:
        check_installed("a proof")
        if seconds is None and iterations is None:
            seconds = _BEFORE_PROOF * prove
            prove -= seconds
    look = _Look(task, found, seconds=seconds, max_states=max_states, tick=tick)
    look.ask_for_classes()
    look.bound_from_below()
    look.bound_by_windows()
    look.search_all(take=asked)
    if asked:
        look.improve(iterations=iterations, seed=seed, watch=watch)
    if prove is not None:
        look.prove(prove, seed=seed, proof=proof, watch=watch, between=between)
    if look.better is not None:
        _check(task, look.better)
    return Beyond(
        improved=look.cubes if asked else None,
        lower_bound=look.bound.cubes,
        optimal=True if look.cubes == look.bound.cubes else False if look.shorter else None,
        only_class=look.only,
        why=look.bound.why,
        spent=tuple(look.stages),
        agreed=look.agreed if look.agreed > look.bound.cubes else None,
        proof=look.written,
        _cube_path=lambda: look.best,
        _named=lambda: () if found is None else _named(task, found, look.better),
    )


Tick = Callable[[str, int], object]
"""Called with the name of a stage and the steps that it took so far."""
Between = Callable[[int, int], object]
"""Called with what is proved, a lower bound, and the number of cubes of the best path."""
_SHARES = {"classes": 0.1, "bounds": 0.2, "windows": 0.2, "optimum": 0.25, "proof": 1.0}
"""Shares of the time that these stages may take; the search gets the rest, a proof its own time."""
_BEFORE_PROOF = 0.15
"""Share of the time for a proof that all other stages may take together."""
_BOUND_STEPS = 20_000_000
"""Without a time limit, the bounds may look at so many sites on the way of modules, and pairs."""
_WINDOW_STEPS = 1_000_000
"""Without a time limit, the windows may look at so many sites and moves."""
_LISTED_MAX = 20_000
"""Clauses are made of so many listed moves at most: where they are more, they are not built."""
_SETS_A_STATE = 40
"""Without a time limit, the exhaustive search may look at so many sets of moves per state."""


class _Look:
    """What is known beyond the class of a path, stage by stage."""

    def __init__(
        self,
        task: Task,
        found: Shortened | None,
        *,
        seconds: float | None,
        max_states: int,
        tick: Tick | None,
    ) -> None:
        self._task = task
        self._seconds = seconds
        self._whole = Budget(seconds)
        self._max_states = max_states
        self._tick = tick
        self._system, self._start, self._goal = _as_labelled(task)
        self._small = maskable(self._system)
        self._found = found
        self._stopped = False
        self._compiled = False
        self.stages: list[Stage] = []
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

    @cached_property
    def _steps(self) -> Transitions:
        if self._system is not None:
            return Transitions(self._system)
        return Transitions(None, self._task.path if self._found is None else self._found.path)

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
        self, name: str, job: Callable[[Stage, Budget], None], steps: int | None = None
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
        stage = Stage(name)
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

        def job(stage: Stage, budget: Budget) -> None:
            self._steps.budget = budget
            self.only = only_class(self._steps, self._start)
            stage.steps = budget.steps

        if self._system is not None and self.cubes and self._small:
            self._stage("classes", job)
        if self.only:
            self.bound = Bound(self.cubes, "the only class")

    def bound_from_below(self) -> None:
        """Bound the cubes of every path between the ends."""

        def job(stage: Stage, budget: Budget) -> None:
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

        def job(stage: Stage, budget: Budget) -> None:
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
            self._whole.extend(self.stages[-1].seconds)
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

        def job(stage: Stage, budget: Budget) -> None:
            if self._is_wide():
                exact = Optimum(1, None, 2)
            else:
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
                    self.better = _of_optimum(self._task, self._steps, exact)

        if self._small and not self._stopped and self.bound.cubes <= most:
            self._stage("optimum", job, _SETS_A_STATE * self._max_states)

    def _is_wide(self) -> bool:
        """Return whether the exhaustive search would not begin, as far as that is told by arrays.

        Then the moves that occur, which may be many, need not be listed.
        """
        found = self._found
        if self._system is not None or found is None or self._start == self._goal:
            return False
        first = found.path.numbers[found.left.moves[: int(found.left.starts[1])]]
        return too_wide(first, found.path.supports, self._max_states)

    def improve(
        self,
        *,
        iterations: int | None,
        seed: int,
        watch: Callable[[Improved], object] | None,
    ) -> None:
        """Search for a better path in the remaining time."""
        task = self._task
        kept: list[CubePath] = []

        def keep(better: Improved) -> None:
            kept.append(better.cube_path)
            if watch is not None:
                watch(better)

        def job(stage: Stage, _budget: Budget) -> None:
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
            )
            if len(kept[-1] if kept else self.best) > self.bound.cubes:
                stage.ended = "time" if self._whole.spent else "limit"

        if not self._stopped and self.bound.cubes < self.cubes:
            system = task.system
            if system is not None and prepares(system):
                # Once for an installation; the search gets its time all the same.
                self._stage("compile", lambda _stage, _budget: prepare_for(system))
                self._whole.extend(self.stages[-1].seconds)
            self._stage("search", job)
        if kept:
            self.better = min(kept, key=lambda path: (len(path), sum(map(len, path))))

    def prove(
        self,
        seconds: float,
        *,
        seed: int,
        proof: Path | str | None,
        watch: Callable[[Improved], object] | None,
        between: Between | None,
    ) -> None:
        """Search for the optimum by SAT solvers; write the refutation of less, if asked to."""
        if self._stopped or (proof is None and self.bound.cubes == self.cubes):
            return

        def job(stage: Stage, budget: Budget) -> None:
            if not self._has_clauses(stage):
                return
            with suppress(SpentError):
                self._ask_solvers(
                    stage, budget, seed=seed, proof=proof, watch=watch, between=between
                )
            if stage.ended == "done" and self.bound.cubes < self.cubes:
                stage.ended = "time"

        self._compile()
        if not self._stopped:
            self._whole, self._seconds = Budget(seconds), seconds
            self._stage("proof", job)

    def _has_clauses(self, stage: Stage) -> bool:
        """Return whether clauses can be built; note why not."""
        if self._start == self._goal:
            stage.why = "a path without cubes needs no proof"
        elif not self._small:
            labels = 0 if self._system is None else self._system.labels
            stage.ended = "limit"
            stage.why = f"clauses for {labels} labels, {LABELS_MAX} at most"
        elif self._system is None and self._listed_count > _LISTED_MAX:
            stage.ended = "limit"
            stage.why = f"clauses for {self._listed_count:,} moves, {_LISTED_MAX:,} at most"
        return stage.why is None

    def _ask_solvers(
        self,
        stage: Stage,
        budget: Budget,
        *,
        seed: int,
        proof: Path | str | None,
        watch: Callable[[Improved], object] | None,
        between: Between | None,
    ) -> None:
        """Search until the budget is spent, and take what was found, however that ends."""

        def keep(path: CubePath) -> None:
            self.better = _without_labels(self._task, self._system, path)
            if watch is not None:
                watch(Improved(self.better, stage.steps, 0))

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
                self._take_proof(prover, proof)
        if prover.stopped_by is not None:
            stage.ended, stage.why = "limit", prover.stopped_by

    def _listed(self) -> Iterable[Action]:
        """Return the moves that occur, where there is no system; no others exist."""
        if self._system is not None or self._found is None:
            return self._task.path
        path = self._found.path
        return (path.actions[number] for number in np.unique(path.numbers).tolist())

    @cached_property
    def _labelled(self) -> CubePath:
        """The best path, as moves of the system in which each vehicle keeps its own end."""
        task, system = self._task, self._system
        if not task.labelled_goals or system is None:
            return self.best
        at = {site: label for label, site in enumerate(ends_of(task.path, task.start))}
        found: list[tuple[Action, ...]] = []
        for cube in self.best:
            moves: list[Action] = []
            for action in cube:
                one, other = in_order(action.trace)
                here, there = (one, other) if one in at else (other, one)
                label = at[there] = at.pop(here)
                moves.append(system.action("edge", (one, other, label)))
            found.append(tuple(moves))
        return tuple(found)

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


def _as_labelled(task: Task) -> tuple[System | None, State, State]:
    """Return system, start and goal, with labels if each vehicle must keep its own end."""
    if not task.labelled_goals or task.system is None:
        return task.system, task.start, task.goal
    ends = ends_of(task.path, task.start)
    system = task.system.with_labels(len(ends))
    start = frozenset((site, label) for label, site in enumerate(ends))
    return system, start, frozenset((site, label) for label, site in enumerate(ends.values()))


def ends_of(path: Iterable[Action], start: State) -> dict[Site, Site]:
    """Return where the path takes each vehicle, by its start, in canonical order.

    Each move must be along an edge and admissible, which is not checked.
    """
    origin = {site: site for site in start}
    for action in path:
        one, other = action.trace
        here, there = (one, other) if one in origin else (other, one)
        origin[there] = origin.pop(here)
    found = {begin: end for end, begin in origin.items()}
    return {begin: found[begin] for begin in in_order(found)}


def _of_optimum(task: Task, steps: Transitions, exact: Optimum) -> CubePath:
    """Return the normal cube path of the path that the exhaustive search found."""
    cubes = [[steps.actions[number] for number in cube] for cube in exact.cubes or ()]
    return _without_labels(task, steps.system, cubes)


def _without_labels(
    task: Task, labelled: System | None, cubes: Iterable[Iterable[Action]]
) -> CubePath:
    """Return the normal cube path of moves in which each vehicle may have a label of its own."""
    actions = [action for cube in cubes for action in cube]
    if task.labelled_goals and task.system is not None and labelled is not None:
        edge, place_of = task.system.action, labelled.place_of
        actions = [
            edge("edge", tuple(place_of(site) for site in in_order(action.trace)))
            for action in actions
        ]
    return normal_cube_path(actions)


def _check(task: Task, cubes: CubePath) -> None:
    try:
        end = end_state(cubes, task.start)
    except InputError as error:
        raise CheckError(f"the improved path is not legal: {error}") from None
    if end != task.goal or not is_normal(cubes):
        raise CheckError("the improved path is no normal cube path to the same end")
    if task.labelled_goals:
        moves = (action for cube in cubes for action in cube)
        if ends_of(moves, task.start) != ends_of(task.path, task.start):
            raise CheckError("the improved path takes a vehicle to another's end")


def _named(task: Task, found: Shortened, cubes: CubePath | None) -> NamedPath:
    """Return the names of the moves of a better path, or without one of the normal cube path."""
    if cubes is None:
        return found.named
    known: dict[Action, CubeName] = {
        action: name
        for path, names in zip(found.cube_path, found.named, strict=True)
        for action, name in zip(path, names, strict=True)
    }

    def name(action: Action) -> CubeName:
        if action not in known:
            placed = None if task.system is None else _placed(task.system, action)
            known[action] = _in_input(found.given, action) if placed is None else placed
        return known[action]

    return tuple(tuple(map(name, cube)) for cube in cubes)


def _in_input(given: PathInput, action: Action) -> CubeName:
    """Return the name of the first move of the input that does this, all of which may cancel."""
    numbered = given.numbered
    first = np.flatnonzero(numbered.numbers == numbered.actions.index(action))[:1]
    return numbered.cube_names(first)[0]


def _placed(system: System, action: Action) -> GeneratorPlacement | None:
    """Return the system's name of an action, None if the system does not have the action."""
    moves = system.moves_of(action)
    return GeneratorPlacement(moves[0].generator, moves[0].at) if moves else None
