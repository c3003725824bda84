"""Child processes by name: started with their configuration, watched, and ended.

The configuration travels over standard input, never on a command line.
"""

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from importlib import import_module
from typing import IO, NamedTuple

import msgspec

from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.wire.shell import TOLD

_STDERR = 2
_LOOK_S = 0.005
_JOIN_S = 5.0


class EndedProcess(NamedTuple):
    """A process that has ended."""

    name: str
    how: str
    """How it ended, for people."""
    error: str | None
    """Its last line, if that fully describes the error."""


class ChildProcesses:
    """Child processes by name, each of which runs a module of this project.

    Each leads a process group, and all of it ends with it: a rule may have forked. What would be a
    process can be a thread of this one instead.
    """

    def __init__(self) -> None:
        """Start with none."""
        self.by_name: dict[str, subprocess.Popen[bytes]] = {}
        self._complaints: dict[str, IO[bytes]] = {}
        self._threads: list[threading.Thread] = []
        self._errors: list[tuple[str, BaseException]] = []
        """What was raised in threads, with their names."""

    def spawn(
        self, name: str, module: str, config: msgspec.Struct, lock: IO[bytes] | None = None
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
        # A pipe holds less than a large scene: other processes start while this one reads.
        given = child.stdin, msgspec.json.encode(config) + b"\n"
        threading.Thread(target=_write, args=given, daemon=True).start()

    def serve_here(self, name: str, module: str, config: msgspec.Struct) -> None:
        """Do the work of a process in a thread: the function `host` of its module."""

        def serve() -> None:
            try:
                import_module(module).host(config)
            except BaseException as error:  # noqa: BLE001 - handed to the thread that waits
                self._errors.append((name, error))

        thread = threading.Thread(target=serve, daemon=True)
        self._threads.append(thread)
        thread.start()

    def ended(self) -> list[EndedProcess]:
        """Return those that have ended, each time it is asked.

        An error of a thread that is for the user is raised.
        """
        found = []
        for name, error in self._errors:
            if isinstance(error, CubepathError):
                raise error
            how = f"{type(error).__name__}: {' '.join(str(error).split())}"
            found.append(EndedProcess(name, how, None))
        for name, child in self.by_name.items():
            code = _code(child)
            if code is not None:
                last = self._last_line(name)
                how = f"killed by signal {-code}" if code < 0 else f"exit code {code}"
                how += f": {last}" if last else ""
                found.append(EndedProcess(name, how, last if code == TOLD and last else None))
        return found

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
        """Wait this long for processes that were told to stop, and kill those that do not."""
        deadline = time.monotonic() + patience_s
        try:
            for thread in self._threads:
                thread.join(_JOIN_S)
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


def _write(pipe: IO[bytes], line: bytes) -> None:
    with contextlib.suppress(OSError, ValueError):  # it died at once: noticed when waiting
        pipe.write(line)
        pipe.flush()


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
