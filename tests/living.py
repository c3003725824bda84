"""Whether a process exists."""

from __future__ import annotations

import contextlib
import os


def is_there(pid: int) -> bool:
    """Return whether a process exists."""
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, 0)
        return True
    return False
