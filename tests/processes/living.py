"""Whether a process exists."""

import contextlib
import os
from pathlib import Path


def is_there(pid: int) -> bool:
    """Return whether a process exists, and is not one that only waits to be waited for."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, 0)
        return True
    return False
