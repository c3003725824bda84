"""What every process of a run does that was started by another one: it ends with its parent.

Orders come in one line of JSON on standard input, never on a command line. When that input closes,
the parent is gone, and so is the process.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from typing import TypeVar

import msgspec

from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.wire.sockets import discard

TOLD = 4
"""Exit code of a process whose last line on standard error fully describes the error."""
_ORPHAN = 3

Orders = TypeVar("Orders", bound=msgspec.Struct)


def _end_with_parent(endpoint: str) -> None:
    # Not through sys.stdin: its lock would be held when the interpreter shuts down, and abort it.
    while os.read(0, 1):
        pass
    discard(endpoint)  # the router may have been killed too
    if os.getpgrp() == os.getpid():  # with what a rule has forked
        os.killpg(0, signal.SIGKILL)
    os._exit(_ORPHAN)


def serve(
    kind: type[Orders], endpoint_of: Callable[[Orders], str], work: Callable[[Orders], None]
) -> int:
    """Read the orders and work; on failure print one line on standard error and return `TOLD`."""
    # The coordinator handles interrupts; a terminal sends them to every process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    orders = msgspec.json.decode(sys.stdin.buffer.readline(), type=kind)
    threading.Thread(target=_end_with_parent, args=(endpoint_of(orders),), daemon=True).start()
    try:
        work(orders)
    except CubepathError as error:
        print(error, file=sys.stderr)
        return TOLD
    return 0
