"""Windows of a path replaced by shorter ones that a SAT solver finds, in a process beside.

A window is some consecutive cubes of the best path, or all. The solver is asked whether a path of
fewer rounds leads from the state before it to the one after: of three quarters at first, and if
that takes too long of one less. Windows are short at first. Where none of a width can get shorter,
or not within the time for one, they become wider, up to the whole path, which also comes early
once; then each that took too long gets more time. What was answered is asked again only where the
path has changed.

Sources: planning as satisfiability (Kautz and Selman 1992); windows of plans, Siddiqui and Haslum,
*Plan quality optimisation via block decomposition* (2013).

It touches the clock, and the process of a solver.
"""

import time
from collections.abc import Iterable, Iterator
from random import Random
from typing import NamedTuple, Self

from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.theory.satisfiability.encoding import Encoding, TooLargeError, encode
from cubepath.coordinator.theory.satisfiability.met_moves import MetMoves
from cubepath.coordinator.theory.satisfiability.solver_process import (
    SECOND_SOLVER,
    SolverAnswer,
    SolverError,
    SolverProcess,
    solvers_installed,
)
from cubepath.coordinator.theory.search.budget import Budget, SearchStage, SpentError
from cubepath.coordinator.theory.search.own_ends import OwnEnds
from cubepath.coordinator.theory.search.transitions import maskable
from cubepath.protocol.core.actions import Action, State, apply_in_place
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System

CubePath = tuple[tuple[Action, ...], ...]
STAGE = "solver"
"""The name of the stage that tells what was spent here."""
_WIDTH = 8
"""The number of cubes of the windows that are tried first."""
_WIDER = 1.5
_WHOLE_BEFORE = 18
"""The whole path is tried before windows of this many cubes."""
_WHOLE_SHARE = 0.4
"""The share of the time that is left which the solver may take for the whole path."""
_SOLVING_S = 0.5
"""How long the solver may take for a window at first, in seconds."""
_LONGER, _LONGEST_S = 3.0, 3600.0
_BUILDING_S = 2.0
"""How long the moves of a window may take to be found, in seconds."""
_START_S = 0.4
"""How long the process takes to start: until then it would not accept orders."""
_REST_ON_GRAPH = 5.0
"""For vehicles, other steps get this many times the time that building clauses took."""
_STALLED_S = 1.0
"""For vehicles, nothing is asked while other steps find better plans within this time."""
_LITERALS_MAX = 3_000_000
"""Windows with longer clauses are left out."""
_ACTIONS_MAX = 200_000
_TRIED_MAX = 20_000
"""When more moves, or windows that were tried, are known than this, they are forgotten."""

Ends = tuple[int, int]
"""The fingerprints of the states at the ends of a window."""


class _Tried(NamedTuple):
    """What is known of a window: no path has fewer rounds than `least`.

    Nor was one with fewer than `hardly` found by a solver that had this many `seconds`.
    """

    least: int = 0
    hardly: int = 0
    seconds: float = 0.0


class _Question(NamedTuple):
    """Whether the window with these ends, from cube `first` to `last`, can have `rounds` rounds."""

    ends: Ends
    first: int
    last: int
    rounds: int


class SatWindows:
    """A solver that is asked about one window after another, while something else continues.

    A context manager, which ends the solver. `stage` notes the number of questions and the time
    that the solver took.
    """

    def __init__(
        self,
        system: System | None,
        start: State,
        best: CubePath,
        *,
        own_ends: bool,
        budget: Budget,
        stage: SearchStage,
    ) -> None:
        """Take the best path so far; without a system its moves are all that there are.

        With `own_ends` the vehicles have no labels, but each keeps its own end. The solver
        continues while others spend the `budget`.
        """
        budget.tick = self.advance
        self._own: OwnEnds | None = None
        if own_ends and system is not None:
            path = (action for cube in best for action in cube)
            self._own = OwnEnds.of(system, path, start)
            system, start = self._own.system, self._own.start
        self._system, self._start = system, start
        self._on_graph = system is not None and system.graph is not None
        self._listed = () if system is not None else [each for cube in best for each in cube]
        self._best, self._budget, self._stage = best, budget, stage
        self._solver = SolverProcess(SECOND_SOLVER)  # the one that finds paths sooner
        self._ready = 0.0
        self._table: MetMoves | None = None
        self._fingerprints: dict[Site, int] = {}
        self._random = Random(0)  # noqa: S311 - nothing secret
        self._tried: dict[Ends, _Tried] = {}
        self._asked: tuple[_Question, Encoding] | None = None
        self._asked_at = self._until = 0.0
        self._whole = False
        self._width_most = 1 << 30
        self._seconds = _SOLVING_S
        self._known: CubePath | None = None
        self._settled: CubePath | None = None
        """The best path for which there was nothing more to ask."""
        self._cubes: CubePath = ()
        self._marks: list[int] = []
        self._busy = False
        self._over = not maskable(system) or not solvers_installed()

    def __enter__(self) -> Self:
        """Start the solver, which takes a while to be ready."""
        if not solvers_installed():
            self._stage.ended = "limit"
            self._stage.why = "left out without python-sat: pip install 'cubepath[proofs]'"
        if not self._over:
            self._start_solver()
        return self

    def __exit__(self, *_: object) -> None:
        """End the solver."""
        self._end_question()
        self._over = True
        self._solver.end()

    @property
    def settled(self) -> bool:
        """Whether there is nothing more to ask about the best path."""
        return self._over or self._settled is self._best

    def step(self, best: CubePath) -> CubePath | None:
        """Go on from the best path that is known; return a better one if one was found."""
        if _cost(best) < _cost(self._best):
            self._best = best
            if self._on_graph:
                # While replanning gets on, it is quicker.
                self._ready = max(self._ready, time.monotonic() + _STALLED_S)
        self.advance()
        return self._best if _cost(self._best) < _cost(best) else None

    def advance(self, _steps: int = 0) -> None:
        """Take the solver's answer if there is one, and ask it about another window."""
        if self._busy or self._over:
            return
        self._busy = True
        try:
            if self._asked is not None:
                self._await(*self._asked)
            if self._asked is None and time.monotonic() >= self._ready:
                self._ask()
        except SolverError:
            self._end_question()
            self._over = True
        finally:
            self._busy = False

    def _start_solver(self) -> None:
        self._solver.start()
        self._ready = max(self._ready, time.monotonic() + _START_S)

    def _await(self, question: _Question, problem: Encoding) -> None:
        answer = self._solver.answer(0)
        if answer is not None:
            self._end_question()
            self._take(question, problem, answer)
        elif time.monotonic() > self._until:
            self._end_question()
            self._solver.end()
            self._start_solver()
            # The question left is the easiest to satisfy; for the whole path there is no time.
            width = question.last - question.first
            last = self._whole or question.rounds == width - 1
            self._note(question, hardly=width if last else width - 1)

    def _end_question(self) -> None:
        """Note the time that the solver took."""
        if self._asked is not None:
            self._stage.steps += 1
            self._stage.seconds += time.monotonic() - self._asked_at
        self._asked = None

    def _note(self, question: _Question, *, least: int = 0, hardly: int = 0) -> None:
        """Keep what was learned about a window."""
        known = self._tried.get(question.ends, _Tried())
        if known.seconds < self._seconds:
            known = _Tried(known.least)
        if len(self._tried) > _TRIED_MAX:
            self._tried.clear()
        self._tried[question.ends] = _Tried(
            max(least, known.least), max(hardly, known.hardly), self._seconds
        )

    def _take(self, question: _Question, problem: Encoding, answer: SolverAnswer) -> None:
        """Put a shorter window into the path, wherever its ends are now."""
        if not answer.satisfiable:
            self._note(question, least=question.rounds + 1)
            return
        self._look()
        try:
            first = self._marks.index(question.ends[0])
            last = len(self._marks) - 1 - self._marks[::-1].index(question.ends[1])
        except ValueError:
            return
        window = problem.schedule(answer.true)
        if last - first > len(window):
            self._adopt((*self._cubes[:first], *window, *self._cubes[last:]))

    def _adopt(self, cubes: CubePath) -> None:
        path = [action for cube in cubes for action in cube]
        found = normal_cube_path(path if self._own is None else self._own.plain(path))
        if _cost(found) < _cost(self._best):
            self._best = found

    def _look(self) -> None:
        """Mark the states of the best path, if it is another than the last time."""
        if self._known is self._best:
            return
        self._known = self._best
        self._cubes = self._best if self._own is None else self._own.labelled(self._best)
        mark = 0
        self._marks = [mark]
        for cube in self._cubes:
            for action in cube:
                for site in action.ends[0] ^ action.ends[1]:
                    mark ^= self._fingerprint(site)
            self._marks.append(mark)

    def _fingerprint(self, site: Site) -> int:
        found = self._fingerprints.get(site)
        if found is None:
            found = self._fingerprints[site] = self._random.getrandbits(64)
        return found

    def _ask(self) -> None:
        """Ask about the next window."""
        if self._settled is self._best:
            return
        self._look()
        question = self._next()
        if question is None:
            self._settled, self._seconds = self._best, _SOLVING_S
            return
        began = time.monotonic()
        try:
            problem = encode(self._met(question), question.rounds, literals_max=_LITERALS_MAX)
        except (TooLargeError, SpentError):
            self._budget.spend(0)
            self._width_most = max(2, min(self._width_most, question.last - question.first - 1))
            self._note(question, hardly=question.last - question.first)
            return
        finally:
            # Building leaves this process time for other steps, which serve vehicles well.
            now = time.monotonic()
            self._ready = now + (now - began) * (_REST_ON_GRAPH if self._on_graph else 1.0)
        if problem.impossible:
            self._note(question, least=question.rounds + 1)
            return
        self._solver.ask(problem)
        self._asked, self._asked_at = (question, problem), time.monotonic()
        left = self._budget.seconds_left
        self._whole = _WIDTH < question.last - question.first == len(self._cubes)
        share = _WHOLE_SHARE * left if self._whole and left is not None else 0.0
        self._until = self._asked_at + max(self._seconds, share)

    def _next(self) -> _Question | None:
        """Return the next question about the narrowest window that is open, None if none is."""
        cubes = len(self._cubes)
        if cubes < 2:
            return None
        while self._seconds <= _LONGEST_S:
            for width in self._widths(cubes):
                stride = max(1, width // 2)
                for first in (*range(0, cubes - width, stride), cubes - width):
                    found = self._open(first, first + width)
                    if found is not None:
                        return found
                if width == cubes and self._refuted(cubes):
                    return None
            self._seconds *= _LONGER
        return None

    def _widths(self, cubes: int) -> Iterator[int]:
        """Yield how many cubes the windows have, in the order in which they are tried."""
        most = min(cubes, self._width_most)
        width = _WIDTH
        while width < most:
            yield width
            width = int(width * _WIDER)
            if width == _WHOLE_BEFORE and most == cubes:
                yield cubes
        yield most

    def _refuted(self, cubes: int) -> bool:
        """Return whether no path is shorter than the whole."""
        return self._tried.get((self._marks[0], self._marks[cubes]), _Tried()).least >= cubes

    def _open(self, first: int, last: int) -> _Question | None:
        """Return what is to be asked about a window."""
        ends = self._marks[first], self._marks[last]
        known = self._tried.get(ends, _Tried())
        least = known.least if known.seconds < self._seconds else max(known.least, known.hardly)
        width = last - first
        return None if least >= width else _Question(ends, first, last, (least + 3 * width) // 4)

    def _met(self, question: _Question) -> MetMoves:
        """Return the moves of a window, and keep them for others."""
        spend = Budget(_BUILDING_S).spend
        ends = self._state(question.first), self._state(question.last)
        if self._table is None or len(self._table.actions) > _ACTIONS_MAX:
            self._table = MetMoves(self._system, self._listed, *ends, spend=spend)
        found = self._table.between(*ends, spend=spend)
        found.reach(question.rounds)
        return found

    def _state(self, place: int) -> State:
        state = set(self._start)
        _apply(self._cubes[:place], state)
        return frozenset(state)


def _apply(cubes: Iterable[Iterable[Action]], state: set[Site]) -> None:
    for cube in cubes:
        for action in cube:
            apply_in_place(action, state)


def _cost(path: CubePath) -> tuple[int, int]:
    return len(path), sum(map(len, path))
