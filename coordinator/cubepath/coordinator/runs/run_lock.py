"""The lock of a run: one thread at a time acts on it; a listener of a round cannot step the run.

Interrupts become exceptions that are raised between two messages, never in the middle of one.
"""

import signal
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType

from cubepath.protocol.core.errors import CheckError

_INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(Exception):  # noqa: N818 - it is not an error, but what the user asked for
    """The user asked the run to stop."""


@contextmanager
def interrupts() -> Generator[Callable[[], None]]:
    """Turn SIGINT, SIGTERM and SIGHUP into `Interrupted`, raised by the function that is yielded.

    A second signal raises KeyboardInterrupt at once. Outside the main thread no signal is handled.
    """
    asked = threading.Event()

    def ask(_number: int, _frame: FrameType | None) -> None:
        if asked.is_set():
            raise KeyboardInterrupt
        asked.set()

    def check() -> None:
        if asked.is_set():
            raise Interrupted

    if threading.current_thread() is not threading.main_thread():
        yield check
        return
    before = {number: signal.signal(number, ask) for number in _INTERRUPTS}
    try:
        yield check
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


_CLOSE_S_MAX = 60.0


class RunLock:
    """Lets one thread at a time continue a run, and no listener of a round."""

    def __init__(self) -> None:
        self.stopping = False
        """Whether somebody has asked for the end of the run."""
        self._lock = threading.RLock()
        self._acting = False

    @contextmanager
    def hold(self) -> Generator[None]:
        """Keep others from going on; CheckError if another thread does so, or a round is played."""
        if not self._lock.acquire(blocking=False):
            raise CheckError("another thread is using this run: expected one at a time")
        try:
            if self._acting:
                raise CheckError(
                    "a round is under way: a callback may look at the run and stop it, but"
                    " not continue it"
                )
            yield
        finally:
            self._lock.release()

    @contextmanager
    def act(self) -> Generator[None]:
        """Do something that nobody may break into."""
        self._acting = True
        try:
            yield
        finally:
            self._acting = False

    @contextmanager
    def to_stop(self) -> Generator[bool]:
        """Say whether the run can be ended now; if not, the thread that steps it ends it soon."""
        self.stopping = True
        held = self._lock.acquire(blocking=False)
        try:
            yield held and not self._acting
        finally:
            if held:
                self._lock.release()

    @contextmanager
    def to_close(self) -> Generator[bool]:
        """Say whether everything can be ended now: not from a listener of a round.

        Another thread that continues with the run has some time to end it.
        """
        self.stopping = True
        held = self._lock.acquire(timeout=_CLOSE_S_MAX)
        try:
            yield not (held and self._acting)
        finally:
            if held:
                self._lock.release()

    def check(self) -> None:
        """Raise Interrupted if somebody has asked for the end of the run."""
        if self.stopping:
            raise Interrupted
