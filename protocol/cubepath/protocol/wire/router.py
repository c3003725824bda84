"""The router of a run, in a process of its own.

In the coordinator's process it would share zenoh's receiving threads with the coordinator's own
session, and under a flood the two would wait for each other. Started as
``python -m cubepath.protocol.wire.router ENDPOINT``; it writes where it listens on standard output,
and ends when its standard input closes.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess
import sys
import tempfile
from types import TracebackType
from typing import Self

from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.wire.sessions import check_descriptors, check_endpoint, open_router

ANY_PORT = "tcp/127.0.0.1:0"
_REFUSED = 4
_START_S_MAX = 30.0
_END_S_MAX = 5.0


class Router:
    """A router process, as a context manager that ends it."""

    def __init__(self, endpoint: str | None = None, *, processes: int = 0) -> None:
        """Start it at an endpoint, or on a free loopback port, and wait until it listens.

        Raises InputError if the endpoint is not ``tcp/HOST:PORT`` or the router cannot listen
        there, and CubepathError if `check_descriptors` finds too few file descriptors for
        `processes`.
        """
        check_descriptors(processes)
        if endpoint is not None:
            check_endpoint(endpoint)
        self._complaints = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the rest
        self.restarts = 0
        """How many times it was started again."""
        try:
            self._start(endpoint or ANY_PORT)
            self.endpoint = self._listening()
        except BaseException:
            self._complaints.close()
            raise

    def _start(self, endpoint: str) -> None:
        self._child = subprocess.Popen(
            [sys.executable, "-P", "-m", "cubepath.protocol.wire.router", endpoint],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._complaints,
            # A terminal's interrupt goes to the coordinator, which ends its processes properly.
            process_group=0,
        )

    def _listening(self) -> str:
        """Wait until the router listens, and return where."""
        if self._child.stdout is None:
            raise AssertionError("no pipe from the router")  # it was requested above
        try:
            told = select.select([self._child.stdout], [], [], _START_S_MAX)[0]
            if not told:
                self._child.kill()  # its line is then empty
            found = self._child.stdout.readline().decode().strip()
        except BaseException:
            self._child.kill()
            self._stop()
            raise
        if found:
            return found
        code = self._child.wait()
        self._stop()
        self._complaints.seek(0)
        last = self._complaints.read().decode(errors="replace").strip().rpartition("\n")[2]
        if code == _REFUSED:
            raise InputError(last)
        raise CubepathError(f"the router did not start: {last or f'exit code {code}'}")

    @property
    def pid(self) -> int:
        """Return the process id."""
        return self._child.pid

    def look_after(self) -> bool:
        """Start it again where it was if it has ended; return whether that was so.

        Sessions find it there by themselves, however long it takes to start. What was on its way is
        lost.
        """
        if self._child.poll() is None:
            return False
        self._stop()
        self._start(self.endpoint)
        self.restarts += 1
        return True

    def close(self) -> None:
        """End the process."""
        self._stop()
        self._complaints.close()

    def _stop(self) -> None:
        child = self._child
        with contextlib.suppress(OSError):
            if child.stdin is not None:
                child.stdin.close()
        try:
            child.wait(_END_S_MAX)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
        if child.stdout is not None:
            child.stdout.close()

    def __enter__(self) -> Self:
        """Return the router, which listens already."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the process."""
        self.close()


def main(endpoint: str) -> int:
    """Route until standard input closes; return the exit code."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        session, found = open_router(endpoint)
    except InputError as error:
        print(error, file=sys.stderr)
        return _REFUSED
    with session:
        print(found, flush=True)
        while os.read(0, 1):
            pass
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
