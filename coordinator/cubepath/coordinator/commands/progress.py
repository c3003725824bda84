"""Progress of a long command: a bar on a terminal, elsewhere a line now and then."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, Self, TextIO

_FIRST_SECONDS, _LATER_SECONDS = 5.0, 30.0
"""Off a terminal, the seconds until the first line, and between later lines."""


_TICK_SECONDS = 0.5
"""How often the time is shown while nothing is counted, as when code is compiled."""


def progress_bar(total: int | None, what: str, unit: str) -> Any:
    """Return a progress bar on standard error: on a terminal a bar, elsewhere `Lines`.

    The time goes on while nothing is counted; without a `unit` it is all there is. The environment
    variable ``CUBEPATH_PROGRESS=0`` turns both off.
    """
    stream = sys.stderr
    bar: Any
    if os.environ.get("CUBEPATH_PROGRESS") == "0":
        bar = Lines(stream, total, what, unit)
        bar.close()
        return bar
    if stream.isatty():
        from tqdm import tqdm  # noqa: PLC0415 - a command starts faster without it

        shown = None if unit else "{desc}: {elapsed}"
        bar = tqdm(total=total, desc=what, unit=unit, leave=False, file=stream, bar_format=shown)
    else:
        bar = Lines(stream, total, what, unit)
    threading.Thread(target=_tick, args=(bar,), daemon=True).start()
    return bar


def _tick(bar: Any) -> None:
    """Show the time until the bar is closed."""
    while not bar.disable:
        time.sleep(_TICK_SECONDS)
        bar.refresh()


class Lines:
    """Progress as lines, for logs: none in the first seconds, so a short command says nothing.

    It has the methods of `tqdm` that commands use.
    """

    def __init__(
        self,
        stream: TextIO,
        total: int | None,
        what: str,
        unit: str,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin at zero."""
        self.n = 0
        self.total = total
        self.disable = False
        self._lock = threading.Lock()
        self._stream = stream
        self._what = what
        self._unit = unit
        self._state = ""
        self._clock = clock
        self._begun = clock()
        self._due = self._begun + _FIRST_SECONDS

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def update(self, n: int = 1) -> None:
        """Count, and write a line if one is due."""
        self.n += n
        self.refresh()

    def refresh(self) -> None:
        """Write a line if one is due."""
        with self._lock:
            now = self._clock()
            if self.disable or now < self._due:
                return
            self._due = now + _LATER_SECONDS
            of = "" if self.total is None else f" of {self.total}"
            count = f" {self.n}{of}{self._unit}," if self.n or self.total else ""
            state = f" {self._state}," if self._state else ""
            line = f"cubepath: {self._what}:{count}{state} {now - self._begun:.0f} s"
            try:
                print(line, file=self._stream, flush=True)
            except (OSError, ValueError):  # full, without a reader, or closed
                self.disable = True

    def reset(self, total: int | None = None) -> None:
        """Begin again at zero."""
        self.n, self.total = 0, total

    def set_description(self, desc: str, **_: object) -> None:
        """Set the name of the current work."""
        self._what = desc

    def set_postfix_str(self, s: str, **_: object) -> None:
        """Set the current state, which is part of each line."""
        self._state = s

    def clear(self) -> None:
        """Do nothing: lines need no clearing before an answer."""

    def close(self) -> None:
        """Write no more lines."""
        with self._lock:
            self.disable = True
