"""Where the command ``cubepath`` begins, before anything slow is imported."""

import os
import signal
import sys
from collections.abc import Sequence
from types import FrameType

_INTERRUPTED = 130


def entry(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code, also if it was interrupted before it began.

    Its processes import nothing from the current folder, whatever is there.
    """
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        with _Deferred():
            from cubepath.coordinator.commands.main import main  # noqa: PLC0415 - it takes time

        return main(arguments)
    except KeyboardInterrupt:
        print("cubepath: interrupted", file=sys.stderr)
        return _INTERRUPTED


class _Deferred:
    """Raises KeyboardInterrupt at its end if an interrupt came meanwhile.

    In the middle of an import the compiler would make another error of the exception, and compiled
    modules may not survive it.
    """

    def __enter__(self) -> None:
        self._came = False
        self._before = signal.getsignal(signal.SIGINT)
        self._defers = self._before is signal.default_int_handler and _is_main_thread()
        if self._defers:
            signal.signal(signal.SIGINT, self._note)

    def _note(self, _number: int, _frame: FrameType | None) -> None:
        self._came = True

    def __exit__(self, *_: object) -> None:
        if self._defers:
            signal.signal(signal.SIGINT, self._before)
        if self._came:
            raise KeyboardInterrupt


def _is_main_thread() -> bool:
    import threading  # noqa: PLC0415 - it takes time

    return threading.current_thread() is threading.main_thread()
