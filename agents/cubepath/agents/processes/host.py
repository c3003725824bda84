"""A module process: a node with some modules of a run, on one zenoh session.

Room: agents. Started as ``python -m cubepath.agents.processes.host`` with one line of JSON
(`Orders`) on standard input; it ends when it is told to, or when that input closes because its
parent is gone. Zenoh callbacks only enqueue; the loop does all the work, in the order of the queue.
"""

from __future__ import annotations

import os
import signal
import sys
import threading

import msgspec

from cubepath.agents.processes.node import HostNode
from cubepath.agents.processes.orders import Orders
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.wire.shell import Shell
from cubepath.protocol.wire.sockets import discard

TOLD = 4
"""Exit code of a process whose last line on standard error fully describes the error."""


def host(orders: Orders) -> None:
    """Join the run and serve until `Go` says "stop"."""
    node = HostNode(orders)
    with Shell(node, orders.endpoint, credentials=orders.credentials) as shell:
        shell.start()
        while not shell.ended:
            shell.step()


def _end_with_parent(endpoint: str) -> None:
    # Not through sys.stdin: its lock would be held when the interpreter shuts down, and abort it.
    while os.read(0, 1):
        pass
    discard(endpoint)  # the router may have been killed too
    os._exit(3)


def main() -> int:
    """Read the orders and run; on failure print one line on standard error and return `TOLD`."""
    # The coordinator handles interrupts; a terminal sends them to every process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    orders = msgspec.json.decode(sys.stdin.buffer.readline(), type=Orders)
    threading.Thread(target=_end_with_parent, args=(orders.endpoint,), daemon=True).start()
    try:
        host(orders)
    except CubepathError as error:
        print(error, file=sys.stderr)
        return TOLD
    return 0


if __name__ == "__main__":
    sys.exit(main())
