"""The fewest rounds of all timetables in which vehicles may follow, asked of SAT solvers.

From the greatest number of rounds that is known to be too few the question is asked for one more
and one more, until the answer is a timetable: a shortest one. That fewer are not enough is proved
by the log of the solver, which `files` puts into a file. Where that is too long to be checked, a
solver of another family is asked, and what both say is called agreed, not proved.

In the clauses x(a, v, t) says that vehicle a is at vertex v after t rounds; it exists only where a
can come from its start in t rounds, and from where it can reach its goal in those that remain.

- A vehicle goes from where it is along an edge or stays, forwards and backwards in time. Of two
  vertices with a common neighbour it is at one at most: as it begins at one vertex, it is then at
  one vertex at every time.
- At most one vehicle is at a vertex at a time.
- e(u, v, t) holds if some vehicle goes from u to v in round t + 1. Nobody goes from v to u then.
- Under the rule of CG:SHOP 2021, if e(u, v, t), a vehicle at v after t rounds continues in the same
  direction in round t + 1. This excludes that two swap, too.
- Where many can be at a vertex there is a ladder: one of the vehicles up to some number is there.

A vehicle may stay, so a timetable of fewer rounds satisfies them as well. This module touches
processes, and temporary files for logs.
"""

from __future__ import annotations

import os
import time
from array import array
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations, pairwise
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.following.timetable import Rule
from cubepath.coordinator.theory.satisfiability.encoding import TooLargeError
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
    new_log,
)
from cubepath.protocol.core.sites import Site
from cubepath.protocol.path_files.following import FollowingFile, FollowingHead, FollowingLine
from cubepath.protocol.plans.imported import VehiclePlan

Cell = tuple[int, int]
Schedule = list[list[tuple[int, Cell, Cell]]]
LITERALS_MAX = 30_000_000
"""The greatest number of literals: Python takes some seconds for ten millions."""
_PAIRS_MAX = 5
"""Of this many variables at most one holds by pairs, of more by a ladder of further variables."""
_FAR = 1 << 30
AT, GOES, UP_TO = range(3)
"""Kinds of variables: (vehicle, vertex, time), (source, target, time), (vehicle, vertex, time)."""


@dataclass(frozen=True, eq=False)
class VehicleTask:
    """Vehicles on a graph: where each begins and ends; the vertices are cells (x, y).

    `edges` are those of the workspace, `rule` that by which vehicles may follow.
    """

    starts: tuple[Cell, ...]
    ends: tuple[Cell, ...]
    edges: Sequence[tuple[Site, Site]]
    rule: Rule

    @cached_property
    def beside(self) -> dict[Site, list[Site]]:
        """The neighbours of each vertex, in the order of the edges."""
        found: dict[Site, list[Site]] = {cell: [] for cell in (*self.starts, *self.ends)}
        for one, other in self.edges:
            found.setdefault(one, []).append(other)
            found.setdefault(other, []).append(one)
        return found

    @cached_property
    def places(self) -> dict[Site, int]:
        """The number of each vertex, from 0 on."""
        return {cell: place for place, cell in enumerate(self.beside)}

    def distances(self, cell: Cell) -> dict[Site, int]:
        """Return how many edges lead from a vertex to each that can be reached."""
        found: dict[Site, int] = {cell: 0}
        front: list[Site] = [cell]
        while front:
            reached: list[Site] = []
            for here in front:
                for there in self.beside[here]:
                    if there not in found:
                        found[there] = found[here] + 1
                        reached.append(there)
            front = reached
        return found

    @cached_property
    def windows(self) -> list[tuple[dict[Site, int], dict[Site, int]]]:
        """For each vehicle the distances from its start, and to its goal."""
        return [
            (self.distances(start), self.distances(end))
            for start, end in zip(self.starts, self.ends, strict=True)
        ]

    @cached_property
    def least(self) -> int:
        """The most edges that a vehicle has to go: no timetable has fewer rounds."""
        ways = zip(self.windows, self.ends, strict=True)
        return max((window[0].get(end, _FAR) for window, end in ways), default=0)


@dataclass(eq=False)
class VehicleClauses:
    """Clauses as arrays: clause c is ``literals[ends[c - 1]:ends[c]]``, the first from 0 on."""

    task: VehicleTask
    rounds: int
    at: list[list[dict[Site, int]]] = field(default_factory=list[list[dict[Site, int]]])
    """The variable of a vehicle at a vertex: by vehicle, time and vertex."""
    flat: array[int] = field(default_factory=lambda: array("i"))
    cuts: array[int] = field(default_factory=lambda: array("q"))
    meant: array[int] = field(default_factory=lambda: array("i"))
    """Four numbers for each variable: its kind, two of vehicles and vertices, and a time."""

    def new(self, kind: int, one: int, other: int, time: int) -> int:
        """Return a new variable with this meaning."""
        self.meant.extend((kind, one, other, time))
        return len(self.meant) // 4

    @property
    def meanings(self) -> NDArray[np.int32]:
        """What the variables mean, with shape (variables, 4): kind, index, index, time."""
        return np.array(self.meant, dtype=np.int32).reshape(-1, 4)

    def add(self, *clause: int) -> None:
        """Add a clause; TooLargeError if there are too many."""
        self.flat.extend(clause)
        self.cuts.append(len(self.flat))
        if len(self.flat) > LITERALS_MAX:
            raise TooLargeError(
                f"{self.rounds} rounds take more than {LITERALS_MAX} literals of clauses"
            )

    @property
    def variables(self) -> range:
        """The variables, from 1 on."""
        return range(1, len(self.meant) // 4 + 1)

    @property
    def literals(self) -> NDArray[np.int32]:
        """All literals, with shape (literals,)."""
        return np.array(self.flat, dtype=np.int32)

    @property
    def ends(self) -> NDArray[np.int64]:
        """Where each clause ends, with shape (clauses,)."""
        return np.array(self.cuts, dtype=np.int64)

    def schedule(self, true: NDArray[np.bool_]) -> Schedule:
        """Return vehicle, source and target of the moves of each round.

        `true` has the truth of each variable, with shape (variables,).
        """
        found: Schedule = [[] for _ in range(self.rounds)]
        for vehicle, times in enumerate(self.at):
            here = [next(v for v, name in each.items() if true[name - 1]) for each in times]
            for turn, (source, target) in enumerate(pairwise(here)):
                if source != target:
                    found[turn].append((vehicle, cell_of(source), cell_of(target)))
        return found


def cell_of(site: Site) -> Cell:
    """Return a vertex as the cell that it is."""
    match site:
        case (int(x), int(y)):
            return x, y
        case _:
            raise TypeError(f"{site!r} is no cell (x, y)")


def clauses_of(
    task: VehicleTask, rounds: int, go_on: Callable[[], object] = lambda: None
) -> VehicleClauses:
    """Return clauses that can be satisfied iff `rounds` rounds are enough.

    `go_on` is called now and then, and may raise to give up. TooLargeError if there are more than
    `LITERALS_MAX` literals of them.
    """
    found = VehicleClauses(task, rounds)
    places = task.places
    for vehicle, (forth, back) in enumerate(task.windows):
        go_on()
        cells = [v for v in forth if forth[v] + back.get(v, _FAR) <= rounds]
        found.at.append(
            [
                {
                    v: found.new(AT, vehicle, places[v], t)
                    for v in cells
                    if forth[v] <= t and back[v] <= rounds - t
                }
                for t in range(rounds + 1)
            ]
        )
    for times in found.at:
        go_on()
        _add_ways(found, times)
    for t in range(rounds + 1):
        go_on()
        standing = _standing(found, t)
        for v, names in standing.items():
            _at_most_one(found, names, v, t)
        if t < rounds:
            _add_edges(found, t, standing)
    return found


def _standing(found: VehicleClauses, t: int) -> dict[Site, dict[int, int]]:
    """Return who can be at each vertex at a time: the variables by vehicle."""
    standing: dict[Site, dict[int, int]] = {}
    for vehicle, times in enumerate(found.at):
        for v, name in times[t].items():
            standing.setdefault(v, {})[vehicle] = name
    return standing


def _add_ways(found: VehicleClauses, times: Sequence[dict[Site, int]]) -> None:
    """Add that a vehicle is somewhere, and goes along edges or stays."""
    beside = found.task.beside
    found.add(*times[0].values())  # its start, or none: then nothing can be satisfied
    for t, here in enumerate(times):
        for v, name in here.items():
            near = (v, *beside[v])
            if t + 1 < len(times):
                found.add(-name, *_known(times[t + 1], near))
            if t:
                found.add(-name, *_known(times[t - 1], near))
            others = dict.fromkeys(w for u in near for w in (u, *beside[u]) if w != v)
            for other in _known(here, others):
                if other > name:
                    found.add(-name, -other)


def _known(names: dict[Site, int], cells: Iterable[Site]) -> list[int]:
    return [names[v] for v in cells if v in names]


def _at_most_one(found: VehicleClauses, names: dict[int, int], v: Site, t: int) -> None:
    """Add that at most one vehicle is at a vertex; a ladder is Sinz's sequential counter (2005)."""
    if len(names) <= _PAIRS_MAX:
        for one, other in combinations(names.values(), 2):
            found.add(-one, -other)
        return
    before = 0
    for place, (vehicle, name) in enumerate(names.items()):
        if before:
            found.add(-before, -name)
        if place + 1 < len(names):
            some = found.new(UP_TO, vehicle, found.task.places[v], t)
            found.add(-name, some)
            if before:
                found.add(-before, some)
            before = some


def _add_edges(found: VehicleClauses, t: int, standing: dict[Site, dict[int, int]]) -> None:
    """Add what may happen along edges in round t + 1."""
    task = found.task
    goes: dict[tuple[Site, Site], int] = {}
    for source, names in standing.items():
        for target in task.beside[source]:
            movers = {
                vehicle: (name, there)
                for vehicle, name in names.items()
                if (there := found.at[vehicle][t + 1].get(target)) is not None
            }
            # Only where one may go while another is at the target.
            ahead = standing.get(target, {}).keys()
            if movers and len(movers.keys() | ahead) > 1 and ahead:
                edge = found.new(GOES, task.places[source], task.places[target], t)
                goes[source, target] = edge
                for name, there in movers.values():
                    found.add(-name, -there, edge)
    for (source, target), edge in goes.items():
        if task.rule == "cgshop":
            (x, y), (to_x, to_y) = cell_of(source), cell_of(target)
            beyond = 2 * to_x - x, 2 * to_y - y
            for vehicle, name in standing[target].items():
                on = found.at[vehicle][t + 1].get(beyond)
                found.add(-edge, -name, *(() if on is None else (on,)))
        elif (back := goes.get((target, source))) is not None and back > edge:
            found.add(-edge, -back)


_POLL_S = 0.2
WAY = "way of a vehicle"
"""What refutes fewer rounds than some vehicle has edges to go."""


@dataclass(frozen=True)
class Refuted:
    """Why no timetable has this many `rounds` or fewer, by a log of a solver, or by the ways alone.

    `log` is None where unit propagation of the clauses does it. `clauses` is None where some
    vehicle has further to go.
    """

    task: VehicleTask
    rounds: int
    why: str
    clauses: VehicleClauses | None = None
    log: IO[bytes] | None = None


@dataclass
class FewestRounds:
    """What is known of the fewest rounds under a rule, between the ends of a plan.

    `rounds` are those of the best timetable that is known, and `timetable` is one if it is shorter
    than the plan's own. No timetable has fewer rounds than `lower_bound`, by `refuted`, which is
    None where nothing moves. By the word of two solvers none has fewer than `agreed`, None if they
    were not both asked. `ended` is done, time, interrupt, or why solvers could not continue.
    """

    rounds: int
    lower_bound: int
    refuted: Refuted | None
    agreed: int | None = None
    timetable: FollowingFile | None = None
    seconds: float = 0.0
    ended: str = "done"

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
    began = time.monotonic()
    task = VehicleTask(plan.starts, plan.ends, plan.edges(), rule)
    least = min(task.least, within)
    found = FewestRounds(within, least, Refuted(task, least - 1, WAY) if least else None)
    search = _Search(task, found, seed, tick, log_max)
    with ExitStack() as stack:
        search.run(began + seconds, stack if logs is None else logs)
    if search.best is not None:
        found.timetable = _file(search.best, plan, rule)
    found.seconds = round(time.monotonic() - began, 3)
    return found


@dataclass
class _Search:
    """One search, which notes in `found` what it finds."""

    task: VehicleTask
    found: FewestRounds
    seed: int
    tick: Callable[[int], object] | None
    log_max: int
    best: Schedule | None = None

    def run(self, end: float, logs: ExitStack) -> None:
        """Ask for more and more rounds, until there is a timetable or the time is up."""
        found = self.found
        try:
            with (
                SolverProcess(SOLVER, log_max=self.log_max) as first,
                SolverProcess(SECOND_SOLVER) as second,
            ):
                for rounds in range(found.lower_bound, found.rounds):
                    if not self._ask(rounds, (first, second), end, logs):
                        return
        except (TooLargeError, SolverError) as error:
            found.ended = str(error)
        except TimeoutError:
            found.ended = "time"
        except KeyboardInterrupt:
            found.ended = "interrupt"

    def _ask(
        self, rounds: int, solvers: tuple[SolverProcess, SolverProcess], end: float, logs: ExitStack
    ) -> bool:
        """Return whether this many rounds are too few, by a log or by both solvers."""
        if self.tick is not None:
            self.tick(rounds)

        def go_on() -> None:
            if time.monotonic() > end:
                raise TimeoutError

        clauses = clauses_of(self.task, rounds, go_on)
        first, second = solvers
        answer = _answered(first, clauses, end, self.seed, new_log(logs))
        if answer is not None and answer.satisfiable is False:
            if answer.log is not None:
                self._note(rounds, clauses, answer.log)
                return True
            answer = _answered(second, clauses, end, self.seed, None)
            if answer is not None and answer.satisfiable:
                raise SolverError(f"two SAT solvers contradict each other on {rounds} rounds")
        if answer is None:
            self.found.ended = "time"
            return False
        if answer.satisfiable:
            self.best, self.found.rounds = clauses.schedule(answer.true), rounds
            return False
        self.found.agreed = rounds + 1
        return True

    def _note(self, rounds: int, clauses: VehicleClauses, log: IO[bytes]) -> None:
        """Note that this many rounds are refuted, in a way that can be checked."""
        found = self.found
        if found.refuted is not None and found.refuted.log is not None:
            found.refuted.log.close()
        size = os.fstat(log.fileno()).st_size
        why = SEARCH if size else PROPAGATION
        found.refuted = Refuted(self.task, rounds, why, clauses, log if size else None)
        found.lower_bound = rounds + 1
        if found.agreed is not None and found.agreed <= found.lower_bound:
            found.agreed = None


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
        FollowingLine(vehicle, source, target, round=number)
        for number, moves in enumerate(schedule, 1)
        for vehicle, source, target in moves
    ]
    rounds = max((line.round or 0 for line in lines), default=0)
    head = FollowingHead(rule, vehicles=len(plan.starts), moves=len(lines), rounds=rounds)
    return FollowingFile(head, tuple(lines))
