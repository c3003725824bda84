"""Where the command ``cubepath`` begins: before anything is imported that takes time.

Room: coordinator.
"""

import sys
from collections.abc import Sequence

_INTERRUPTED = 130


def entry(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code, also if it was interrupted before it began."""
    try:
        from cubepath.coordinator.commands.main import main  # noqa: PLC0415 - it takes time

        return main(arguments)
    except KeyboardInterrupt:
        print("cubepath: interrupted", file=sys.stderr)
        return _INTERRUPTED
