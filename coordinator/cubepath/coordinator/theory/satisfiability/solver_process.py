"""A SAT solver in a separate process: ask it, wait for it, and end it at any moment.

A solver that is told to stop after some time may not do so, and while it works in this process no
interrupt gets through. So it works in another one.

It uses processes, and files for logs that it is given.
"""

import importlib.util
import io
import json
import os
import select
import subprocess
import sys
from collections.abc import Iterator, Sized
from contextlib import ExitStack, suppress
from tempfile import TemporaryFile
from typing import IO, BinaryIO, NamedTuple, Protocol, Self, cast

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.errors import CubepathError, InputError

SOLVER = "cadical195"
"""The solver: CaDiCaL 1.9.5 (Biere, Fazekas, Fleury and Heisinger 2020)."""
SECOND_SOLVER = "glucose4"
"""A solver of another family: Glucose 4 (Audemard and Simon 2009)."""
LOG_MAX = 100_000_000
"""The greatest size of a log, in bytes, that is kept and can be checked."""
_PIECE = 1 << 20
_BLOCK = 512
"""The unit in which the system counts the blocks of a file."""
_CHILD = "cubepath.coordinator.theory.satisfiability.solver_child"


class SolverProblem(Protocol):
    """Clauses: clause c is ``literals[ends[c - 1]:ends[c]]``, the first from 0 on."""

    @property
    def variables(self) -> Sized:
        """The variables, whose numbers begin with 1."""
        ...

    @property
    def literals(self) -> NDArray[np.int32]:
        """All literals, with shape (literals,)."""
        ...

    @property
    def ends(self) -> NDArray[np.int64]:
        """Where each clause ends, with shape (clauses,)."""
        ...


class SolverError(CubepathError):
    """The process of a solver ended by itself, or cannot write its log."""


class SolverAnswer(NamedTuple):
    """What a solver says: whether there is a model.

    `true` holds the truth of each variable in the model, with shape (variables,). `log` is the file
    that was given for the refutation, if that is not too long; it is read from its beginning on.
    """

    satisfiable: bool
    true: NDArray[np.bool_]
    log: IO[bytes] | None = None


def solvers_installed() -> bool:
    """Return whether the library with the solvers is there."""
    return importlib.util.find_spec("pysat") is not None


def check_installed(what: str) -> None:
    """Raise InputError, which says how to get it, if the library with the solvers is missing."""
    if not solvers_installed():
        raise InputError(f"{what} takes the library python-sat: pip install 'cubepath[proofs]'")


def new_log(logs: ExitStack) -> IO[bytes]:
    """Return a file without a name for a log, which is closed with `logs`.

    SolverError if there is no room for one.
    """
    try:
        return logs.enter_context(TemporaryFile())
    except OSError as error:
        raise SolverError(f"no file for the log of a SAT solver: {error.strerror}") from None


def pieces_of(log: IO[bytes] | None) -> Iterator[bytes]:
    """Yield the content of a log, piece by piece; nothing where there is none."""
    if log is not None:
        log.seek(0)
        while piece := log.read(_PIECE):
            yield piece


class _Child(NamedTuple):
    """The process, its input, and its answers: unbuffered, so that it can be awaited."""

    process: subprocess.Popen[bytes]
    requests: BinaryIO
    answers: IO[bytes]


class SolverProcess:
    """A process that answers one problem after another; a context manager that ends it.

    >>> from cubepath.coordinator.theory.satisfiability.encoding import encode
    >>> from cubepath.coordinator.theory.satisfiability.met_moves import MetMoves
    >>> scene = scene_from_spec("agv:graph=grid3x3,n=2")
    >>> met = MetMoves(scene.system, (), scene.start_state, scene.goal)
    >>> with SolverProcess() as solver:
    ...     answers = [solver.solve(encode(met, rounds)) for rounds in (2, 3)]
    >>> [answer.satisfiable for answer in answers]
    [False, True]
    """

    def __init__(self, solver: str = SOLVER, *, log_max: int = LOG_MAX) -> None:
        """Prepare; the process is started with the first problem.

        A log of more than `log_max` bytes is given up, and the answer comes without it.
        """
        self._solver = solver
        self._log_max = log_max
        self._child: _Child | None = None
        self._asked: SolverProblem | None = None
        self._log: IO[bytes] | None = None
        self._log_file: int | None = None
        self._log_too_long = False

    def __enter__(self) -> Self:
        """Return the solver."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process."""
        self.end()

    def solve(self, problem: SolverProblem) -> SolverAnswer:
        """Ask for the answer to one problem, and wait for it."""
        self.ask(problem)
        while (found := self.answer(None)) is None:
            pass
        return found

    def ask(
        self, problem: SolverProblem, *, seed: int | None = None, log: IO[bytes] | None = None
    ) -> None:
        """Begin to solve a problem; what was begun before is given up.

        `log` is an empty file for the refutation. SolverError if the process cannot take it.
        """
        if self._asked is not None:
            self.end()
        self._asked, self._log, self._log_file = problem, log, None
        self._log_too_long = False
        head = {
            "solver": self._solver,
            "seed": seed if self._solver == SOLVER else None,
            # Files without a name are left nowhere, however both processes end.
            "log": None if log is None else f"/proc/{os.getpid()}/fd/{log.fileno()}",
            "log_max": self._log_max,
            "variables": len(problem.variables),
            "literals": len(problem.literals),
            "clauses": len(problem.ends),
        }
        requests = self._started().requests
        try:
            requests.write(json.dumps(head).encode() + b"\n")
            requests.write(problem.literals.data)
            requests.write(problem.ends.data)
            requests.flush()
        except OSError as error:
            raise self._ended() from error

    def answer(self, seconds: float | None) -> SolverAnswer | None:
        """Return the answer, None if there is none within this many seconds (None: however long).

        After None the solver works on: ask again, or `end` it. SolverError if the process ended, or
        nothing was asked.
        """
        child, problem = self._child, self._asked
        if child is None or problem is None:
            raise SolverError("no SAT solver was asked")
        while select.select([child.answers], [], [], seconds)[0]:
            line = child.answers.readline()
            if not line:
                raise self._ended()
            reply = json.loads(line)
            if "log" in reply:
                self._log_file = reply["log"]
                continue
            if "error" in reply:
                self.end()
                raise SolverError(f"the log of the SAT solver cannot be written: {reply['error']}")
            self._asked = None
            true = np.zeros(len(problem.variables), dtype=np.bool_)
            if reply["satisfiable"]:
                bits = np.frombuffer(self._read(child, -(-len(true) // 8)), dtype=np.uint8)
                true = np.unpackbits(bits, count=len(true)).astype(np.bool_)
            log = self._log if not reply["satisfiable"] else None
            if log is not None and (self._log_too_long or not reply["kept"]):
                log.truncate(0)
                log = None
            return SolverAnswer(reply["satisfiable"], true, log)
        self._watch_log(child.process)
        return None

    def start(self) -> None:
        """Start the process, if there is none, so that the first problem need not wait for it."""
        self._started()

    def fileno(self) -> int:
        """Return what `select` waits for; SolverError if nothing was asked."""
        if self._child is None:
            raise SolverError("no SAT solver was asked")
        return self._child.answers.fileno()

    def end(self) -> None:
        """End the process, whatever it is doing."""
        self._asked = None
        if (child := self._child) is None:
            return
        child.process.kill()
        for stream in (child.requests, child.answers):
            with suppress(OSError):
                stream.close()
        child.process.wait()
        self._child = None  # an interrupt may have come before: then it is ended once more

    def _read(self, child: _Child, size: int) -> bytes:
        found = b""
        while len(found) < size:
            more = child.answers.read(size - len(found))
            if not more:
                raise self._ended()
            found += more
        return found

    def _watch_log(self, process: subprocess.Popen[bytes]) -> None:
        """Give up a log that has grown too long, and free its place on the disk."""
        if self._log_file is None:
            return
        with suppress(OSError):
            path = f"/proc/{process.pid}/fd/{self._log_file}"
            status = os.stat(path)  # noqa: PTH116 - a link of the system's, which leads nowhere
            self._log_too_long |= status.st_size > self._log_max
            if self._log_too_long and status.st_blocks * _BLOCK > self._log_max:
                # The solver writes on where it was: what lies before takes no place any more.
                os.truncate(path, 0)

    def _started(self) -> _Child:
        if self._child is None:
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", _CHILD, str(os.getpid())],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                bufsize=0,
                process_group=0,  # an interrupt of the terminal is for this process alone
            )
            requests = cast("io.RawIOBase", process.stdin)
            # Raw writes may write a part; a buffer writes all.
            self._child = _Child(
                process, io.BufferedWriter(requests), cast("IO[bytes]", process.stdout)
            )
        return self._child

    def _ended(self) -> SolverError:
        code = None if self._child is None else self._child.process.wait()
        self.end()
        how = f"was ended by signal {-code}" if code is not None and code < 0 else "ended"
        return SolverError(f"the process of the SAT solver {how} before it had an answer")
