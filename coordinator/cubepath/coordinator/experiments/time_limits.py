"""The time that a run may take, in a worker.

Time is that of the machine, and decides about nothing but whether there is a result: a run that is
over its limit is a row with that reason.
"""

from __future__ import annotations

import faulthandler
import os
import signal
from pathlib import Path
from types import FrameType

GRACE_S = 5.0
"""A run that does not let itself be interrupted for so long takes its process with it."""
TIMEOUT_S_MAX = 1_000_000
_AGAIN_S = 1.0
"""A run that goes on is interrupted again after so long: a rule may catch whatever is raised."""


class OverTimeError(BaseException):
    """A run is over its limit; no error of code, so that nobody takes it for one."""


class TimeLimit:
    """Seconds of this machine, in the main thread of a worker; None for no limit.

    Whoever is over it meets `OverTimeError`; a run in processes of its own is told to end, as by an
    interrupt. Code that never comes back to Python, as in a compiled loop, meets nothing: there
    the process ends, and whoever handed out the run finds that.
    """

    def __init__(self, seconds: float | None, *, processes: bool) -> None:
        """Take the limit, and whether what is limited is in processes of its own."""
        self.seconds = seconds
        self.over = False
        self._processes = processes
        self._on = False

    def begin(self) -> None:
        """Begin to count."""
        if self.seconds is None:
            return
        self._on = True
        self._before = signal.signal(signal.SIGALRM, self._interrupt)
        # This one asks nobody: it needs neither the interpreter nor its lock.
        with Path(os.devnull).open("wb") as nowhere:
            self._nowhere = os.dup(nowhere.fileno())
        faulthandler.dump_traceback_later(self.seconds + GRACE_S, exit=True, file=self._nowhere)
        signal.setitimer(signal.ITIMER_REAL, self.seconds, _AGAIN_S)

    def end(self) -> None:
        """Count no more; whoever is late is let through."""
        if self._on:
            self._on = False
            signal.setitimer(signal.ITIMER_REAL, 0)
            faulthandler.cancel_dump_traceback_later()
            os.close(self._nowhere)
            signal.signal(signal.SIGALRM, self._before)

    def _interrupt(self, _number: int, _frame: FrameType | None) -> None:
        if not self._on:
            return
        self.over = True
        if self._processes:
            signal.raise_signal(signal.SIGINT)  # which ends them, and is ignored before and after
        else:
            raise OverTimeError


def over_limit(seconds: float) -> str:
    """Return the reason of a run that was over its limit."""
    return f"over its limit of {seconds:g} s"
