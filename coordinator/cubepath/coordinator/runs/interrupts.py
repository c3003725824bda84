"""Interrupts as exceptions, raised between two messages and never in the middle of one."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType

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
