"""Where the command ``cubepath`` begins, before anything slow is imported."""

import os
import signal
import sys
from collections.abc import Sequence

_INTERRUPTED = 130


def entry(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code, also if it was interrupted before it began.

    Its processes import nothing from the current folder, whatever is there.
    """
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        # In the middle of an import the compiler would make another error of the exception, and
        # compiled modules may not survive it: an interrupt waits for its end.
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            from cubepath.coordinator.commands.main import main  # noqa: PLC0415 - it takes time
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        return main(arguments)
    except KeyboardInterrupt:
        print("cubepath: interrupted", file=sys.stderr)
        return _INTERRUPTED
