"""Past the homotopy class: an anytime search for a path to the same end with fewer cubes.

The normal cube path is the shortest in its class, so any shorter path lies in another. The search
keeps the best path found so far, and replaces parts of it: windows, for any system (`windows`), or
the routes of a few vehicles, with all others unchanged (`vehicle_lns`) or thrown out where they are
in the way (`conflict_optimizer`). Each names its sources. A step never makes the path worse. A
system may have its own search (`System.paths`); the path that it finds is taken only if it is one
from the start to the end. Beside them a SAT solver looks for shorter windows in a separate process
(`sat_windows`), if time alone bounds the search.

It touches the clock, to know when to stop, and the process of a solver.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from random import Random
from typing import NamedTuple

from cubepath.coordinator.normal_form.definitions import end_state
from cubepath.coordinator.normal_form.heap import Heap
from cubepath.coordinator.progress import StageProgress, each_of, progress_bar
from cubepath.coordinator.theory.satisfiability.encoding import prepare as prepare_clauses
from cubepath.coordinator.theory.satisfiability.solver_process import solvers_installed
from cubepath.coordinator.theory.search.budget import Budget, SearchStage, SpentError
from cubepath.coordinator.theory.search.lower_bounds import paths_of, prepare_for
from cubepath.coordinator.theory.search.sat_windows import STAGE, SatWindows
from cubepath.coordinator.theory.search.transitions import Transitions
from cubepath.coordinator.theory.search.vehicle_lns import Replanner
from cubepath.coordinator.theory.search.windows import WindowSearch
from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.system import System

CubePath = tuple[tuple[Action, ...], ...]
_IDLE = 0.2
"""For vehicles, the share of steps that try a window instead of a neighbourhood."""
_MOVES_A_STEP = 500
"""The number of moves that are built in about the time of a step."""
_SITES_MAX = 4096
"""Systems of vehicles with more sites than this are searched by neighbourhoods only."""
_OWN = 0.8
"""Where a system has its own search, the share of steps that it gets."""
_WORK_MAX = 200_000
"""Then windows are tried only for paths with at most this many moves times sites that are on."""


@dataclass(frozen=True, slots=True)
class Improvement:
    """A normal cube path, and the steps of the search: all, and those that found a better path."""

    cube_path: CubePath
    steps: int
    found: int

    @property
    def cubes(self) -> int:
        """Return the number of cubes."""
        return len(self.cube_path)

    @property
    def moves(self) -> int:
        """Return the number of moves."""
        return sum(map(len, self.cube_path))


def improve(
    path: Iterable[Action],
    start: State,
    system: System | None,
    *,
    seconds: float | None = None,
    iterations: int | None = None,
    seed: int = 0,
    labelled_goals: bool = False,
    enough: int = 0,
    watch: Callable[[Improvement], object] | None = None,
    tick: Callable[[int], object] | None = None,
    progress: bool = False,
    normal: CubePath | None = None,
    transitions: Transitions | None = None,
    by_sat: SearchStage | None = None,
) -> Improvement:
    """Return the best path from `start` to the end of `path` that is found in the given time.

    Better means fewer cubes, then fewer moves; the result is never worse than the normal form of
    the path. Moves are those of `system`; without one, those that occur in the path. `path` must be
    admissible from `start` on, which is not checked here, and `start` includes the filled
    obstacles. With `labelled_goals` each vehicle ends where it does in the path, although the
    system gives the vehicles no labels.

    The search ends after `seconds` or `iterations`, whichever comes first, if necessary in the
    middle of a step, or as soon as the path has at most `enough` cubes. Without `iterations` a SAT
    solver takes part, if python-sat is installed; `by_sat` gets what it spent. Bounded by
    iterations alone, the result depends only on the input and `seed`. `watch` is called with every
    better path as it is found, `tick` after each step with the number of steps. `normal` is the
    normal cube path of the path, and `transitions` those of the system, if they are known already.
    `progress` shows a bar of `tqdm`.

    InputError if neither bound is given, or if `labelled_goals` is given for a system that is not
    on a graph.

    >>> played = play("agv:graph=grid3x3,n=3", "random", seed=2, max_rounds=30)
    >>> scene = played.scene
    >>> better = improve(played.path, scene.start_state, scene.system, iterations=200)
    >>> len(normal_cube_path(played.path)), better.cubes, better.moves
    (8, 3, 6)
    """
    _check_given(system, seconds, iterations, labelled_goals=labelled_goals)
    bar = StageProgress(progress_bar("improve", " steps", shown=progress))
    if progress:
        show = partial(bar.tick, "improve", total=iterations or 0)
        watch, tick = each_of(watch, bar.watch), each_of(tick, show)
    actions = list(path)
    best = _normal(actions, 0, 0) if normal is None else Improvement(normal, 0, 0)
    prepare_all(system, with_solver=iterations is None)
    budget = Budget(seconds)
    if transitions is None:
        transitions = Transitions(system, actions if system is None else ())
    transitions.budget = budget
    random = Random(seed)  # noqa: S311 - nothing secret
    steps = 0
    record = _Record(best, watch)
    try:
        with ExitStack() as stack, suppress(SpentError):
            budget.spend(0)
            solver: SatWindows | None = None
            if iterations is None:
                # How far a solver gets in some time is not the same on every machine.
                solver = SatWindows(
                    system,
                    start,
                    best.cube_path,
                    own_ends=labelled_goals,
                    budget=budget,
                    stage=by_sat or SearchStage(STAGE),
                )
                stack.enter_context(solver)
            search = _Search(
                transitions, start, best, labelled_goals=labelled_goals, solver=solver, seed=seed
            )
            while record.cubes > enough and search.possible:
                if steps == iterations or budget.spent:
                    break
                proposal = search.step(random, record.best.cube_path)
                steps += 1
                if tick is not None:
                    tick(steps)
                record.see(proposal, steps)
    finally:
        # After an interrupt too, the best path is not lost.
        record.build()
        bar.bar.close()
    return Improvement(record.best.cube_path, steps, record.best.found)


class _Record:
    """The best path so far, and a better one that is known but not built yet.

    Building the moves of a large plan takes longer than many steps, and often the next better one
    comes soon; so between two paths that are built there are some steps, the more, the more moves.
    """

    def __init__(self, best: Improvement, watch: Callable[[Improvement], object] | None) -> None:
        self.best = best
        self._watch = watch
        self._pending: tuple[_Proposal, int] | None = None

    @property
    def cubes(self) -> int:
        """The fewest cubes that are known."""
        return self.best.cubes if self._pending is None else self._pending[0].cost[0]

    def see(self, proposal: _Proposal | None, steps: int) -> None:
        """Note a proposal, and build the best one if enough steps have gone by."""
        known = self.best.cubes, self.best.moves
        if self._pending is not None:
            known = min(known, self._pending[0].cost)
        if proposal is not None and proposal.cost < known:
            self._pending = proposal, steps
        if steps >= self.best.steps + self.best.moves // _MOVES_A_STEP:
            self.build()

    def build(self) -> None:
        """Build the better path, if there is one, and report it."""
        if self._pending is None:
            return
        proposal, steps = self._pending
        self._pending = None
        new = _normal(proposal.actions(), steps, self.best.found + 1)
        if (new.cubes, new.moves) < (self.best.cubes, self.best.moves):
            self.best = new
            if self._watch is not None:
                self._watch(new)


def prepare_all(system: System | None, *, with_solver: bool) -> bool:
    """Compile, or load, what the searches of a system take; return whether they take anything."""
    found = system is not None and prepare_for(system)
    if with_solver and solvers_installed():
        prepare_clauses()
        return True
    return found


def _check_given(
    system: System | None, seconds: float | None, iterations: int | None, *, labelled_goals: bool
) -> None:
    if seconds is None and iterations is None:
        raise InputError("an improvement needs seconds or iterations to know when to stop")
    if labelled_goals and (system is None or system.graph is None):
        raise InputError("own ends are those of vehicles on a graph, expected such a system")


def _normal(path: Iterable[Action], steps: int, found: int) -> Improvement:
    heap = Heap()
    heap.extend(path)
    return Improvement(heap.cube_path(), steps, found)


class _Proposal(NamedTuple):
    """A path proposed by a search: the number of its cubes and moves, and how to build it.

    The search may continue meanwhile: what is built is its best path by then.
    """

    cost: tuple[int, int]
    actions: Callable[[], list[Action]]


class _Search:
    """The searches that fit the system, each with its own path; the better one is shared."""

    def __init__(
        self,
        steps: Transitions,
        start: State,
        best: Improvement,
        *,
        labelled_goals: bool,
        solver: SatWindows | None,
        seed: int,
    ) -> None:
        self._solver = solver
        self._start = start
        self._system = system = steps.system
        self._steps = steps
        self._labelled_goals = labelled_goals
        self._windows: WindowSearch | None = None
        self._vehicles: Replanner | None = None
        self._own: Iterator[Sequence[Action] | None] | None = None
        self.possible = bool(best.cube_path)
        if not self.possible:
            return
        self._begin_own(best, seed, labelled_goals=labelled_goals)
        graph = None if system is None else system.graph
        if graph is not None and Replanner.fits(graph, len(start), best.cubes):
            self._vehicles = self._replanner(best.cube_path)
        labels = 1 if system is None else system.labels or 1
        sites = 0 if graph is None else len(graph.vertices) * labels
        self._may_cut = not labelled_goals and sites <= _SITES_MAX
        self._fresh = True
        self._cut(best)
        if self._windows is None and self._vehicles is None:
            # States too many and too long for windows are so for clauses as well.
            self._solver = None
        self._ask()

    def _ask(self) -> None:
        """Note whether there is anything left to try."""
        self.possible = any(each is not None for each in (self._own, self._windows, self._vehicles))

    def _begin_own(self, best: Improvement, seed: int, *, labelled_goals: bool) -> None:
        """Begin the system's own search, which knows nothing of vehicles with own ends."""
        system, start = self._system, self._start
        if system is None or labelled_goals:
            return
        path = [action for cube in best.cube_path for action in cube]
        self._goal = end_state(best.cube_path, start)
        self._own = paths_of(system, start, self._goal, seed=seed, known=path)

    def _cut(self, best: Improvement) -> None:
        """Search the windows of a path from now on, unless its states are too many and too long."""
        if not self._may_cut or (self._own and best.moves * len(self._start) > _WORK_MAX):
            return
        self._windows = WindowSearch(self._steps, self._start, best.cube_path)

    def step(self, random: Random, best: CubePath) -> _Proposal | None:
        """Let one of the searches take a step; return the path if it got better."""
        found = None if self._solver is None else self._solver.step(best)
        if found is not None:
            self._take(found)
            actions = [action for cube in found for action in cube]
            return _Proposal((len(found), len(actions)), lambda: actions)
        windows, vehicles = self._windows, self._vehicles
        if self._own is not None and (
            (windows is None and vehicles is None) or random.random() < _OWN
        ):
            return self._own_step(self._own)
        if windows is not None and (vehicles is None or random.random() < _IDLE):
            # Cutting the path at the beginning counts as the first step.
            fresh, self._fresh = self._fresh, False
            if not windows.step(random) and not fresh:
                return None
            if vehicles is not None and windows.cost[0] < vehicles.rounds:
                self._vehicles = self._replanner(_normal(windows.actions(), 0, 0).cube_path)
            return _Proposal(windows.cost, windows.actions)
        if vehicles is None or not vehicles.step(random):
            return None
        if windows is not None and vehicles.rounds < windows.cost[0]:
            cubes = _normal(vehicles.actions(), 0, 0).cube_path
            self._windows = WindowSearch(self._steps, self._start, cubes)
        return _Proposal((vehicles.rounds, vehicles.cost[2]), vehicles.actions)

    def _take(self, best: CubePath) -> None:
        """Go on from a better path that was found elsewhere."""
        if self._vehicles is not None and len(best) < self._vehicles.rounds:
            self._vehicles = self._replanner(best)
        cost = len(best), sum(map(len, best))
        if self._windows is not None and cost < self._windows.cost:
            self._windows = WindowSearch(self._steps, self._start, best)
            self._fresh = True

    def _own_step(self, own: Iterator[Sequence[Action] | None]) -> _Proposal | None:
        """Let the system's own search take a step; CheckError if its answer is not a path."""
        try:
            found = next(own)
        except StopIteration:
            self._own = None
            self._ask()
            return None
        if found is None:
            return None
        path = list(found)
        self._check(path)
        best = _normal(path, 0, 0)
        cost = best.cubes, best.moves
        if self._windows is None or cost < self._windows.cost:
            self._cut(best)
        return _Proposal(cost, lambda: path)

    def _check(self, path: Sequence[Action]) -> None:
        name = type(self._system).__name__
        try:
            end = end_state(path, self._start)
        except InputError as error:
            raise CheckError(f"a path that {name}.paths has found is not legal: {error}") from None
        if end != self._goal:
            raise CheckError(f"a path that {name}.paths has found does not end at the goal")

    def _replanner(self, cubes: CubePath) -> Replanner | None:
        system = self._system
        if system is None or system.graph is None:
            return None
        return Replanner(
            system, system.graph, self._start, cubes, labelled_goals=self._labelled_goals
        )
