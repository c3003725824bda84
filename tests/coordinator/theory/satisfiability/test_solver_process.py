"""Solvers in processes of their own: what they answer, and that nothing is left of them."""

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from tempfile import TemporaryFile

import pytest

from cubepath.coordinator.theory.satisfiability.encoding import Encoding, encode
from cubepath.coordinator.theory.satisfiability.met_moves import MetMoves
from cubepath.coordinator.theory.satisfiability.solver_process import (
    SECOND_SOLVER,
    SOLVER,
    SolverError,
    SolverProcess,
)
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles.solved import check_schedule, pairs_of
from processes.living import is_there


def problem(spec: str, rounds: int) -> Encoding:
    """Return the clauses of a path from the start of a scene to its goal."""
    where = scene_from_spec(spec)
    return encode(MetMoves(where.system, (), where.start_state, where.goal or frozenset()), rounds)


@cache
def hard() -> Encoding:
    """Return clauses at which solvers work for many seconds, writing on and on."""
    return problem("hex:n=8", 24)


def pid_of(solver: SolverProcess) -> int:
    """Return the number of the solver's process."""
    assert solver._child is not None
    return solver._child.process.pid


def eventually(holds: Callable[[], bool]) -> bool:
    """Return whether something holds within some seconds."""
    end = time.monotonic() + 30
    while not holds():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


@pytest.fixture(params=[SOLVER, SECOND_SOLVER])
def solver(request: pytest.FixtureRequest) -> Iterator[SolverProcess]:
    with SolverProcess(request.param) as process:
        yield process


def test_one_process_answers_many_problems(solver: SolverProcess) -> None:
    """As the exhaustive search does; a model is a legal path."""
    pids = set()
    for pair in pairs_of(scene_from_spec("agv-labelled:graph=grid3x3,n=3"), 6, seed=9):
        best = pair.optimum()
        assert best is not None
        met = pair.met()
        found = encode(met, best)
        answer = solver.solve(found)
        assert answer.satisfiable
        assert answer.log is None
        check_schedule(pair, found, answer.true)
        if best:
            assert solver.solve(encode(met, best - 1)).satisfiable is False
        pids.add(pid_of(solver))
    assert len(pids) == 1


def test_what_windows_refute_is_refuted_by_it_too(solver: SolverProcess) -> None:
    """By an empty clause."""
    refuted = problem("hex:n=4", 1)
    assert refuted.impossible
    assert solver.solve(refuted).satisfiable is False
    assert solver.solve(problem("hex:n=4", 9)).satisfiable


def test_who_does_not_want_to_wait_asks_again_or_ends_it(solver: SolverProcess) -> None:
    """None while it works on; the next question is answered all the same."""
    solver.ask(hard())
    assert solver.answer(0.1) is None
    assert solver.answer(0) is None
    first = pid_of(solver)
    assert solver.solve(problem("hex:n=4", 9)).satisfiable
    assert eventually(lambda: not is_there(first))


def test_a_refutation_comes_with_its_log() -> None:
    """In the file that was given for it; none where propagation alone refutes."""
    with SolverProcess() as solver, TemporaryFile() as file:
        solver.ask(problem("hex:n=5", 12), log=file)
        answer = solver.answer(60)
        assert answer is not None
        assert answer.satisfiable is False
        assert answer.log is file
        log = file.read()
        assert log
        with TemporaryFile() as other:
            solver.ask(problem("hex:n=5", 12), log=other)
            again = solver.answer(60)
            assert again is not None
            assert other.read() == log


def test_a_log_that_is_too_long_is_given_up() -> None:
    """The answer stays, and no place is taken."""
    with SolverProcess(log_max=1000) as solver, TemporaryFile() as file:
        solver.ask(problem("hex:n=5", 12), log=file)
        answer = solver.answer(60)
        assert answer is not None
        assert answer.satisfiable is False
        assert answer.log is None
        assert file.read() == b""


@pytest.mark.thorough
def test_a_log_that_grows_takes_no_place_any_more() -> None:
    """While the solver goes on, what it has written is dropped, again and again."""
    most = 1 << 20
    with SolverProcess(log_max=most) as solver, TemporaryFile() as file:
        solver.ask(hard(), log=file)

        def size() -> tuple[int, int]:
            assert solver.answer(0.1) is None
            where = f"/proc/{pid_of(solver)}/fd/{solver._log_file}"
            status = os.stat(where)  # noqa: PTH116 - a link that leads nowhere
            return status.st_size, status.st_blocks * 512

        assert eventually(lambda: solver.answer(0) is None and solver._log_file is not None)
        assert eventually(lambda: size()[0] > 2 * most)
        solver.answer(0)
        assert size()[1] <= 2 * most


def test_a_log_that_cannot_be_written_is_told() -> None:
    """In one line, and the process is gone."""
    with SolverProcess() as solver, TemporaryFile() as file:
        solver.solve(problem("hex:n=4", 9))
        first = pid_of(solver)
        _, hardest = resource.prlimit(first, resource.RLIMIT_FSIZE)
        resource.prlimit(first, resource.RLIMIT_FSIZE, (1 << 12, hardest))
        solver.ask(problem("hex:n=5", 12), log=file)
        with pytest.raises(SolverError, match=r"^the log of the SAT solver cannot be written: "):
            while solver.answer(1) is None:
                pass
        assert not is_there(first)


def test_a_process_that_is_killed_is_told(solver: SolverProcess) -> None:
    """With its signal; the next question has a new one."""
    solver.ask(hard())
    os.kill(pid_of(solver), signal.SIGKILL)
    with pytest.raises(SolverError, match=r"^the process of the SAT solver was ended by signal 9 "):
        while solver.answer(1) is None:
            pass
    assert solver.solve(problem("hex:n=4", 9)).satisfiable


def test_a_process_that_is_killed_before_it_is_asked(solver: SolverProcess) -> None:
    """It is told when it cannot take the problem, or has no answer."""
    solver.solve(problem("hex:n=4", 9))
    os.kill(pid_of(solver), signal.SIGKILL)
    with pytest.raises(SolverError, match=r"was ended by signal 9 before it had an answer$"):
        solver.solve(hard())


def ignores_interrupts(pid: int) -> bool:
    """Return whether a process has begun to ignore SIGINT."""
    status = Path(f"/proc/{pid}/status").read_text()
    return bool(int(status.partition("SigIgn:")[2].split()[0], 16) >> (signal.SIGINT - 1) & 1)


def test_nothing_was_asked(solver: SolverProcess) -> None:
    """Then there is nothing to wait for."""
    for ask in (lambda: solver.answer(0), solver.fileno):
        with pytest.raises(SolverError, match=r"^no SAT solver was asked$"):
            ask()
    solver.end()


def test_an_interrupt_of_the_terminal_is_for_its_parent_alone(solver: SolverProcess) -> None:
    """It works on, whoever sends it."""
    solver.ask(hard())
    while not ignores_interrupts(pid_of(solver)):
        assert solver.answer(0.02) is None
    os.kill(pid_of(solver), signal.SIGINT)
    assert os.getpgid(pid_of(solver)) != os.getpgid(0)
    assert solver.answer(0.3) is None
    assert is_there(pid_of(solver))


PARENT = """
import sys
from coordinator.theory.satisfiability.test_solver_process import hard, pid_of
from cubepath.coordinator.theory.satisfiability.proving import Prover
from cubepath.coordinator.theory.satisfiability.solver_process import SolverProcess
from tempfile import TemporaryFile
with SolverProcess() as solver, TemporaryFile() as file:
    solver.ask(hard(), log=file)
    while solver._log_file is None:
        solver.answer(0.1)
    print(pid_of(solver), flush=True)
    while True:
        solver.answer(1)
"""


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("by", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_it_ends_with_its_parent(by: signal.Signals, tmp_path: Path) -> None:
    """However that ends; and no file is left."""
    root = Path(__file__).parents[3]
    where = os.environ | {"TMPDIR": str(tmp_path), "PYTHONPATH": str(root)}
    with subprocess.Popen(
        [sys.executable, "-c", PARENT], stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=where
    ) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        assert is_there(pid)
        parent.send_signal(by)
    assert eventually(lambda: not is_there(pid))
    assert list(tmp_path.iterdir()) == []
