"""Getting the compiled world ready: when it pays, and beside the plain one.

Loading compiled code takes about a second, and compiling it a quarter of a minute, once for an
installation. Small work is done before that; while large work waits for the compiler, which runs in
a process of its own, the plain world serves.
"""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
from contextlib import suppress
from typing import Any

import numpy as np

from cubepath.agents.arrays import lattice_tables, rounds
from cubepath.agents.arrays.batch import Batch
from cubepath.protocol.compiled import Compiled, allowance

_AGENT_STEP_US = 25
"""What an agent-step in plain Python costs, in microseconds."""
_NICE = 10
_CODE = "from cubepath.agents.arrays.warming import compile_all; compile_all()"


class _Compiler:
    """The process that compiles; there is one at most."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._ready: bool | None = None

    def ready(self) -> bool:
        """Return whether compiled code can be had at once; if not, have it compiled."""
        if self._ready:
            return True
        if self._process is None:
            if is_compiled():
                self._ready = True
                return True
            self._start()
        # Where nothing can be kept, it has to be compiled here.
        if self._process is not None and self._process.poll() is not None:
            self._ready = True
        return bool(self._ready)

    def _start(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _CODE],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        atexit.register(self._stop, os.getpid())

    def _stop(self, owner: int) -> None:
        if self._process is not None and os.getpid() == owner:
            with suppress(OSError):
                self._process.kill()
                self._process.wait()


_compiler = _Compiler()


def is_due(agents: int) -> bool:
    """Return whether so many agents go on in compiled code; if not, their step is counted."""
    return not allowance.grant(_AGENT_STEP_US * agents) and _compiler.ready()


def _kernels() -> tuple[Compiled[..., Any], ...]:
    return (
        rounds.play_round,
        lattice_tables.number_cells,
        lattice_tables.rehash,
        lattice_tables.work_out,
    )


def is_compiled() -> bool:
    """Return whether everything that worlds are made of is compiled and on disk."""
    return all(each.kept() for each in _kernels())


def compile_all() -> None:
    """Compile everything that worlds are made of, beside more urgent work."""
    os.nice(_NICE)
    compile_world()


def compile_world() -> None:
    """Compile everything that worlds are made of, and keep it on disk."""
    from cubepath.protocol.scenes.specs import scene_from_spec  # noqa: PLC0415 - here alone

    batch = Batch(scene_from_spec("hex:n=2"), note_length=1)
    batch.reset([0])
    batch.observe()
    batch.step(np.zeros((1, 2), np.int64))
