"""A module process: a node with some modules of a run, on one zenoh session.

Started as ``python -m cubepath.agents.processes.host`` with its `Orders`; it ends when it is told
to, or with its parent. Zenoh callbacks only enqueue; the loop does all the work, in the order of
the queue.
"""

from __future__ import annotations

import sys

from cubepath.agents.processes.node import HostNode
from cubepath.agents.processes.orders import Orders
from cubepath.protocol.wire.shell import Shell, serve


def host(orders: Orders) -> None:
    """Join the run and serve until `Go` says "stop"."""
    node = HostNode(orders)
    with Shell(node, orders.endpoint, credentials=orders.credentials) as shell:
        shell.start()
        while not shell.ended:
            shell.step()


if __name__ == "__main__":
    sys.exit(serve(Orders, lambda orders: orders.endpoint, host))
