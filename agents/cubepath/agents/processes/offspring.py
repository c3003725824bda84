"""Child processes by name: started with their orders, watched, and ended.

Their orders go over standard input, never on a command line.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from typing import IO, NamedTuple

import msgspec

from cubepath.protocol.wire.shell import TOLD

_STDERR = 2
_LOOK_S = 0.005


class Ended(NamedTuple):
    """How a process ended: its exit code or minus a signal, and its last line if it has one."""

    name: str
    code: int
    last: str

    @property
    def told(self) -> bool:
        """Whether its last line fully describes the error."""
        return self.code == TOLD and bool(self.last)

    @property
    def how(self) -> str:
        """Return how it ended, for people."""
        how = f"killed by signal {-self.code}" if self.code < 0 else f"exit code {self.code}"
        return how + (f": {self.last}" if self.last else "")


class Offspring:
    """Child processes, each of which runs a module of this project.

    Each leads a process group, and all of it ends with it: a rule may have forked.
    """

    def __init__(self) -> None:
        """Start with none."""
        self.by_name: dict[str, subprocess.Popen[bytes]] = {}
        self._complaints: dict[str, IO[bytes]] = {}

    def spawn(
        self, name: str, module: str, orders: msgspec.Struct, lock: IO[bytes] | None = None
    ) -> None:
        """Start a process, which holds a lock too; one of the same name has ended before."""
        self.forget(name)
        complaints = self._complaints[name] = tempfile.TemporaryFile()  # noqa: SIM115 - closed in `_drop`
        child = self.by_name[name] = subprocess.Popen(
            # -P: processes import nothing from the folder in which the run was started.
            [sys.executable, "-P", "-m", module],
            stdin=subprocess.PIPE,
            stdout=_STDERR,  # what a rule prints is for people
            stderr=complaints,
            # A terminal's interrupt goes to the coordinator, which ends its processes properly.
            process_group=0,
            pass_fds=() if lock is None else (lock.fileno(),),
        )
        if child.stdin is None:  # it was requested above
            raise AssertionError("no pipe to the process")
        with contextlib.suppress(BrokenPipeError):  # it died at once: noticed when waiting
            child.stdin.write(msgspec.json.encode(orders) + b"\n")
            child.stdin.flush()

    def ended(self) -> list[Ended]:
        """Return those that have ended, each time it is asked."""
        return [
            Ended(name, code, self._last_line(name))
            for name, child in self.by_name.items()
            if (code := _code(child)) is not None
        ]

    def lives(self, name: str) -> bool:
        """Return whether there is a process of this name that has not ended."""
        child = self.by_name.get(name)
        return child is not None and _code(child) is None

    def kill(self, name: str) -> None:
        """Kill a process, and forget it."""
        _kill(self.by_name[name])
        self.forget(name)

    def _last_line(self, name: str) -> str:
        complaints = self._complaints[name]
        complaints.seek(0)
        return complaints.read().decode(errors="replace").strip().rpartition("\n")[2]

    def end(self, patience_s: float) -> None:
        """Wait so long for processes that were told to stop, and kill those that do not."""
        deadline = time.monotonic() + patience_s
        try:
            for child in self.by_name.values():
                while _code(child) is None and time.monotonic() < deadline:
                    time.sleep(_LOOK_S)
        finally:
            for name, child in list(self.by_name.items()):
                if _code(child) is None:
                    _kill(child)
                self.forget(name)

    def forget(self, name: str) -> None:
        """Forget a process that has ended."""
        child = self.by_name.pop(name, None)
        if child is not None and child.stdin is not None:
            with contextlib.suppress(OSError):
                child.stdin.close()
        complaints = self._complaints.pop(name, None)
        if complaints is not None:
            complaints.close()


def _code(child: subprocess.Popen[bytes]) -> int | None:
    """Return the exit code of a process, None if it lives; what it has forked is killed then."""
    if child.returncode is None:
        with contextlib.suppress(ChildProcessError):
            if os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
                return None
            _kill_group(child)
    return child.poll()


def _kill(child: subprocess.Popen[bytes]) -> None:
    if child.returncode is None:
        _kill_group(child)
        child.wait()


def _kill_group(child: subprocess.Popen[bytes]) -> None:
    """Kill a process and its group; it was not waited for, so its number is no other's."""
    with contextlib.suppress(
        ProcessLookupError, PermissionError
    ):  # PermissionError: all have ended
        os.killpg(child.pid, signal.SIGKILL)
