"""Progress of a long command: a bar on a terminal, elsewhere a line now and then."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any, Self, TextIO

_FIRST_SECONDS, _LATER_SECONDS = 5.0, 30.0
"""Off a terminal, the seconds until the first line, and between later lines."""


def progress_bar(total: int | None, what: str, unit: str) -> Any:
    """Return a progress bar on standard error: on a terminal a bar, elsewhere `Lines`."""
    stream = sys.stderr
    if not stream.isatty():
        return Lines(stream, total, what, unit)
    from tqdm import tqdm  # noqa: PLC0415 - a command starts faster without it

    return tqdm(total=total, desc=what, unit=unit, leave=False, file=stream)


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
        now = self._clock()
        if now < self._due:
            return
        self._due = now + _LATER_SECONDS
        of = "" if self.total is None else f" of {self.total}"
        state = f", {self._state}" if self._state else ""
        line = f"cubepath: {self._what}: {self.n}{of}{self._unit}{state}, {now - self._begun:.0f} s"
        try:
            print(line, file=self._stream, flush=True)
        except OSError:
            self._due = float("inf")  # nobody reads it

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
        self._due = float("inf")
