"""The process in which a SAT solver works, so that it can be ended at any moment.

It reads problems from standard input and answers on standard output, one after another, until its
input ends. A solver that does not finish blocks nobody, and is ended from outside. The process ends
with its parent, however that ends.

It uses standard input and output, and the file that it is told to write.
"""

import ctypes
import json
import os
import shutil
import signal
import sys
from typing import Any, BinaryIO

import numpy as np

_SET_PARENT_DEATH_SIGNAL = 1
_CLAUSES = 100_000
"""Clauses that are lists of Python at one time, which takes ten times the memory of arrays."""


def main() -> None:
    """Answer problems until there are no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    ctypes.CDLL(None).prctl(_SET_PARENT_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != int(sys.argv[1]):
        return  # the parent ended before it could be watched
    requests, answers = sys.stdin.buffer, sys.stdout.buffer
    while line := requests.readline():
        _answer(json.loads(line), requests, answers)


def _answer(asked: dict[str, Any], requests: BinaryIO, answers: BinaryIO) -> None:
    literals = _read(requests, asked["literals"], np.int32)
    ends = _read(requests, asked["clauses"], np.int64)
    from pysat.solvers import Solver  # noqa: PLC0415 - whoever asks need not wait for it

    log = asked["log"]
    with Solver(name=asked["solver"], with_proof=log is not None) as solver:
        if asked["seed"] is not None:
            solver.configure({"seed": asked["seed"]})
        begin = 0
        for first in range(0, len(ends), _CLAUSES):
            some = ends[first : first + _CLAUSES]
            values: list[int] = literals[begin : some[-1]].tolist()
            here = 0
            for end in (some - begin).tolist():
                solver.add_clause(values[here:end])
                here = end
            begin = int(some[-1])
        if log is not None:
            # The log goes to a file without a name; who waits can ask the system for its size.
            within: Any = solver.solver
            _say(answers, {"log": within.prfile.fileno()})
        if not solver.solve():
            kept = False
            if log is not None:
                try:
                    kept = _copy(solver.solver, log, asked["log_max"])
                except OSError as error:
                    _say(answers, {"error": error.strerror or str(error)})
                    return
            _say(answers, {"satisfiable": False, "kept": kept})
            return
        model = np.array(solver.get_model(), dtype=np.int64)
        true = np.zeros(asked["variables"] + 1, dtype=np.bool_)
        true[model[(model > 0) & (model <= asked["variables"])]] = True
        _say(answers, {"satisfiable": True})
        answers.write(np.packbits(true[1:]).tobytes())
        answers.flush()


def _copy(solver: Any, log: str, most: int) -> bool:
    """Copy the log to where it is to be kept, unless it is too long; return whether it was."""
    import pysolvers  # noqa: PLC0415 - of the same library, which parses the log on its own way

    pysolvers.flushpr(solver.prfp)
    written = solver.prfile.fileno()
    size = os.fstat(written).st_size
    if size > most:
        return False
    # The solver does not say where there was no more room; but then there is none for a byte.
    os.pwrite(written, b"0", size)
    os.truncate(written, size)
    solver.prfile.seek(0)
    with open(log, "wb") as file:  # noqa: PTH123 - a path of text, and nothing else is done with it
        shutil.copyfileobj(solver.prfile, file, 1 << 20)
    return True


def _read(requests: BinaryIO, count: int, kind: type) -> Any:
    size = count * np.dtype(kind).itemsize
    found = requests.read(size)
    if len(found) < size:
        sys.exit(1)
    return np.frombuffer(found, dtype=kind)


def _say(answers: BinaryIO, what: dict[str, Any]) -> None:
    answers.write(json.dumps(what).encode() + b"\n")
    answers.flush()


if __name__ == "__main__":
    main()
