"""A server that forks a fresh process for each task, within a few milliseconds.

The server has imported what plays need, and nothing of any rule. It runs as ``python -m
cubepath.agents.locality.fork_server FD``, with its own hash seed. A client sends it one end of a
pair of sockets; the forked process receives its task there and answers there.
"""

import os
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from typing import Self

from cubepath.agents.locality.playing import played
from cubepath.agents.locality.plays import PlayResult, PlayTask
from cubepath.protocol.core.errors import InputError

PATIENCE_S = 60.0
"""A play that takes longer has no answer."""


class ForkServer:
    """The client's side of a server with this hash seed: a context manager."""

    def __init__(self, hash_seed: int) -> None:
        """Start nothing yet."""
        self._hash_seed = hash_seed

    def __enter__(self) -> Self:
        self._ours, theirs = socket.socketpair()
        with theirs:
            # numpy's threads would not survive a fork, and what is forked is small.
            own = {"PYTHONHASHSEED": str(self._hash_seed), "OPENBLAS_NUM_THREADS": "1"}
            self._server = subprocess.Popen(
                [sys.executable, "-P", "-m", __name__, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,  # a rule may print
                stderr=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                env={**os.environ, **own},
                process_group=0,
            )
        return self

    def __exit__(self, *_: object) -> None:
        self._ours.close()
        with suppress(ProcessLookupError):
            os.killpg(self._server.pid, signal.SIGKILL)  # with all that it has forked
        self._server.wait()

    def play(self, task: PlayTask, patience_s: float = PATIENCE_S) -> PlayResult:
        """Return the result of a task in a separate process; threads may call it."""
        ours, theirs = Pipe()
        with ours:
            with theirs:
                socket.send_fds(self._ours, [b"1"], [theirs.fileno()])
            try:
                ours.send(task)
                if not ours.poll(patience_s):
                    return PlayResult(broken=f"gave no answer for {patience_s:.0f} s", late=True)
                found = ours.recv()
            except (EOFError, OSError):
                return PlayResult(broken="ended its process")
        if not isinstance(found, PlayResult):
            raise TypeError(f"expected an answer, found {found!r}")
        return found


def _child(pipe: Connection) -> None:
    """Play the one task of this process."""
    task: PlayTask = pipe.recv()
    try:
        answer = played(task)
    except InputError as error:
        answer = PlayResult(unfit=str(error))
    except Exception as error:  # noqa: BLE001 - a rule may have changed anything
        answer = PlayResult(broken=f"{type(error).__name__}: {error}")
    pipe.send(answer)


def main() -> None:
    """Fork a process for each socket that comes; end when the client is gone."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # the system forgets children that have ended
    with socket.socket(fileno=int(sys.argv[1])) as client:
        while True:
            _, handles, _, _ = socket.recv_fds(client, 1, 1)
            if not handles:
                return
            with Connection(handles[0]) as pipe:
                if os.fork() == 0:
                    client.close()
                    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                    try:
                        _child(pipe)
                    finally:
                        os._exit(0)


if __name__ == "__main__":
    main()
