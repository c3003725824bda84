"""The module processes that a fleet starts itself: a child process each, or one thread.

Room: agents. Their orders go over standard input, never on a command line.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from typing import IO

import msgspec

from cubepath.agents.processes.host import TOLD, host
from cubepath.agents.processes.orders import Orders
from cubepath.agents.processes.pacer import ProcessDied
from cubepath.protocol.core.errors import CubepathError

_STDERR = 2
_END_S_MAX = 5.0


class Children:
    """Module processes by their numbers."""

    def __init__(self) -> None:
        """Start with none."""
        self.by_process: dict[int, subprocess.Popen[bytes]] = {}
        self._complaints: dict[int, IO[bytes]] = {}
        self._thread: threading.Thread | None = None
        self._thread_error: list[BaseException] = []

    def spawn(self, orders: Orders) -> None:
        """Start a process."""
        complaints = self._complaints[orders.process] = tempfile.TemporaryFile()  # noqa: SIM115 - closed in `end`
        child = self.by_process[orders.process] = subprocess.Popen(
            # -P: modules import nothing from the folder in which the run was started.
            [sys.executable, "-P", "-m", "cubepath.agents.processes.host"],
            stdin=subprocess.PIPE,
            stdout=_STDERR,  # what a rule prints is for people
            stderr=complaints,
            # A terminal's interrupt goes to the coordinator, which ends its processes properly.
            process_group=0,
        )
        if child.stdin is None:  # it was requested above
            raise AssertionError("no pipe to the module process")
        with contextlib.suppress(BrokenPipeError):  # it died at once: noticed when waiting
            child.stdin.write(msgspec.json.encode(orders) + b"\n")
            child.stdin.flush()

    def keep_here(self, orders: Orders) -> None:
        """Keep the modules in a thread of this process, on a session of their own."""
        self._thread = threading.Thread(target=self._host, args=(orders,), daemon=True)
        self._thread.start()

    def _host(self, orders: Orders) -> None:
        try:
            host(orders)
        except BaseException as error:  # noqa: BLE001 - handed to the thread that waits
            self._thread_error.append(error)

    def check(self, died: Callable[[int, str], ProcessDied]) -> None:
        """Raise if one has ended; `died` makes the error from its number, and from how it ended."""
        for error in self._thread_error:
            if isinstance(error, CubepathError):
                raise error
            what = f"{type(error).__name__}: {' '.join(str(error).split())}"
            raise died(0, what) from error
        for process, child in self.by_process.items():
            code = child.poll()
            if code is None:
                continue
            complaints = self._complaints[process]
            complaints.seek(0)
            last = complaints.read().decode(errors="replace").strip().rpartition("\n")[2]
            if code == TOLD and last:
                raise ProcessDied(last)
            how = f"killed by signal {-code}" if code < 0 else f"exit code {code}"
            raise died(process, how + (f": {last}" if last else ""))

    def end(self, patience_s: float) -> None:
        """Wait so long for processes that were told to stop, and kill those that do not."""
        children = self.by_process.values()
        deadline = time.monotonic() + patience_s
        try:
            if self._thread is not None:
                self._thread.join(_END_S_MAX)
            for child in children:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    child.wait(max(0.0, deadline - time.monotonic()))
        finally:
            for child in children:
                if child.poll() is None:
                    child.kill()
                    child.wait()
                if child.stdin is not None:
                    with contextlib.suppress(OSError):
                        child.stdin.close()
            for complaints in self._complaints.values():
                complaints.close()
            self.by_process.clear()
            self._complaints.clear()
