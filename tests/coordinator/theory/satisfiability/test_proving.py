"""The optimum from a path down and a bound up: against exhaustive search, and when stopped."""

import os
import tempfile

import pytest

from cubepath.coordinator.normal_form.definitions import end_state, is_normal
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.coordinator.theory.optimality.tasks import proof_of, task_of
from cubepath.coordinator.theory.satisfiability import encoding
from cubepath.coordinator.theory.satisfiability.met_moves import MetMoves
from cubepath.coordinator.theory.satisfiability.proving import (
    PROPAGATION,
    SEARCH,
    WINDOWS,
    CubePath,
    Prover,
)
from cubepath.coordinator.theory.satisfiability.solver_process import SolverProcess
from cubepath.coordinator.theory.search.budget import SpentError
from cubepath.coordinator.theory.search.exact import optimum
from cubepath.coordinator.theory.search.transitions import Transitions
from processes.command_line import GOLDEN
from samples.strategies import random_walk, scene

SPECS = (
    "hex:n=4",
    "sliding:p=2,q=1,n=3",
    "agv:graph=grid3x3,n=3",
    "agv-labelled:graph=grid3x2,n=3",
    "arm:n=5",
    "polygon:n=8",
    "words",
)


def given(spec: str, moves: int, seed: int) -> tuple[MetMoves, CubePath]:
    """Return the moves between the ends of a random walk, and its normal cube path."""
    where, walk = scene(spec), random_walk(spec, moves, seed)
    start = frozenset(where.start_state)
    goal = end_state([[action] for action in walk], start)
    return MetMoves(where.system, (), start, goal), normal_cube_path(walk)


def least(spec: str, moves: int, seed: int) -> int:
    """Return the optimum of the same, by exhaustive search."""
    where, walk = scene(spec), random_walk(spec, moves, seed)
    steps = Transitions(where.system)
    goal = steps.encode(end_state([[action] for action in walk], where.start_state))
    found = optimum(steps, steps.encode(where.start_state), goal)
    assert found.cubes is not None
    return len(found.cubes)


def proved(prover: Prover, *, refute: bool = False, seconds: float = 60.0) -> Prover:
    """Let it search for the optimum; what it found must be a path of the same ends."""
    met = prover.met
    start, goal = (frozenset(met.sites[number] for number in end) for end in met.ends)
    with prover:
        prover.run(seconds, refute=refute)
    assert is_normal(prover.best)
    assert end_state(prover.best, start) == goal
    return prover


@pytest.mark.few(4)
@pytest.mark.parametrize("spec", SPECS)
def test_the_optimum_is_that_of_exhaustive_search(spec: str) -> None:
    """With any seed; and what was refuted is one round less."""
    for number, (moves, seed) in enumerate(((3, 0), (12, 5), (30, 0))):
        met, path = given(spec, moves, number)
        expected = least(spec, moves, number)
        found = proved(Prover(met, path, 0, seed))
        assert (found.bound, len(found.best)) == (expected, expected)
        if expected:
            assert found.refutation is not None
            assert found.refutation.rounds == expected - 1
            assert found.refutation.why in {WINDOWS, PROPAGATION, SEARCH}
        assert (found.agreed, found.stopped_by) == (0, None)


def test_a_refutation_by_search_has_a_log() -> None:
    """And it can be read as long as the prover is there."""
    met, path = given("hex:n=5", 60, 4)
    with Prover(met, path, 0) as prover:
        prover.run(60)
        assert prover.bound == len(prover.best)
        refuted = prover.refutation
        assert refuted is not None
        assert refuted.why == SEARCH
        assert refuted.log is not None
        assert os.fstat(refuted.log.fileno()).st_size > 0
    assert refuted.log.closed


def test_what_windows_refute_is_written_without_another_look_at_the_moves() -> None:
    """When the time is up a proof by windows is complete: it has no clauses to be built."""
    met, path = given("agv:graph=grid3x3,n=2", 30, 1)
    with Prover(met, path, 0) as prover:
        prover.run(60)
    refuted = prover.refutation
    assert refuted is not None
    assert refuted.why == WINDOWS

    def spent(_steps: int) -> None:
        raise SpentError

    met.spend = spent
    start, goal = (frozenset(met.sites[number] for number in end) for end in met.ends)
    where = scene("agv:graph=grid3x3,n=2")
    told = proof_of(refuted, prover.best, where, where.system, (start, goal))
    assert (len(told.variables), len(told.sites), list(told.log)) == (0, 0, [])
    assert len(told.moves) == len({action for cube in prover.best for action in cube})


def test_what_is_known_to_be_optimal_is_refuted_once_more_if_asked_for() -> None:
    """A proof needs clauses; without that nothing is done."""
    met, path = given("agv-labelled:graph=grid3x2,n=3", 30, 1)
    best = proved(Prover(met, path, 0)).best
    silent = proved(Prover(met, best, len(best)))
    assert silent.refutation is None
    assert silent.problems == 0
    told = proved(Prover(met, best, len(best)), refute=True)
    assert told.bound == len(best)
    assert told.refutation is not None
    assert told.refutation.rounds == len(best) - 1


@pytest.mark.thorough
def test_a_bound_that_was_known_is_refuted_where_a_path_meets_it() -> None:
    """The bound comes from elsewhere, the path from here: clauses prove that none is shorter."""
    met, path = given("hex:n=5", 60, 4)
    best = len(proved(Prover(met, path, 0)).best)
    assert best < len(path)
    told = proved(Prover(met, path, best), refute=True)
    assert len(told.best) == told.bound == best
    assert told.refutation is not None
    assert told.refutation.rounds == best - 1


@pytest.mark.thorough
def test_two_solvers_agree_where_the_log_is_too_long() -> None:
    """That is no proof: the bound stays at what is refuted by a log that can be checked."""
    task = task_of(shorten(GOLDEN / "hex-5.mcap"))
    met = MetMoves(task.system, (), task.start, task.goal)
    path = normal_cube_path(task.path)
    sure = proved(Prover(met, path, 0))
    found = proved(Prover(met, path, 0, log_max=1000))
    assert len(found.best) == len(sure.best) == sure.bound
    assert found.agreed == len(sure.best)
    assert found.bound < sure.bound


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_what_ends_it_leaves_what_is_known(error: type[BaseException]) -> None:
    """An interrupt, or a budget that is spent, in the midst of it; and nothing runs any more."""
    met, path = given("hex:n=5", 60, 4)
    ticks = 0

    def tick() -> None:
        nonlocal ticks
        ticks += 1
        if ticks == 4:
            raise error

    prover = Prover(met, path, 0, tick=tick)
    with pytest.raises(error), prover:
        prover.run(60)
    assert 0 < prover.bound <= len(prover.best) <= len(path)


@pytest.mark.parametrize("seconds", [0.0, 0.01, 0.5])
def test_it_stops_in_time(seconds: float) -> None:
    """With the bound that it has, whatever the solvers are at."""
    met, path = given("hex:n=12", 1000, 1)  # to decide everything takes minutes
    found = proved(Prover(met, path, 0), seconds=seconds)
    assert found.bound < len(found.best)


def test_every_better_path_is_told() -> None:
    """Each is shorter than the one before."""
    told: list[int] = []
    met, path = given("hex:n=5", 60, 4)
    found = proved(Prover(met, path, 0, watch=lambda better: told.append(len(better))))
    assert told
    assert [len(path), *told] == sorted({len(path), *told}, reverse=True)
    assert told[-1] == len(found.best)


def test_too_many_clauses_end_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the windows prove is known; the reason is told."""
    monkeypatch.setattr(encoding, "LITERALS_MAX", 100)
    met, path = given("hex:n=5", 60, 4)
    found = proved(Prover(met, path, 0))
    assert found.best == path
    assert 0 < found.bound < len(path)
    assert found.stopped_by is not None
    assert found.stopped_by.startswith(f"clauses for {found.bound} rounds have ")


def test_no_place_for_logs_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """In one line, which names no file of its own."""
    monkeypatch.setattr(tempfile, "tempdir", "/nowhere")
    met, path = given("hex:n=5", 60, 4)
    found = proved(Prover(met, path, 0))
    assert found.stopped_by == "no file for the log of a SAT solver: No such file or directory"


def test_a_solver_that_is_killed_ends_it() -> None:
    """As running out of memory does."""
    met, path = given("hex:n=5", 60, 4)
    asked: list[SolverProcess] = []
    whole = SolverProcess.ask

    def ask(self: SolverProcess, *arguments: object, **keywords: object) -> None:
        whole(self, *arguments, **keywords)  # type: ignore[arg-type]
        asked.append(self)
        assert self._child is not None
        self._child.process.kill()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SolverProcess, "ask", ask)
        found = proved(Prover(met, path, 0))
    assert asked
    assert found.stopped_by is not None
    assert found.stopped_by.startswith("the process of the SAT solver was ended by signal 9")
