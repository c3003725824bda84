"""A module process of a run without rounds, on one zenoh session.

Started as ``python -m cubepath.agents.free.process`` with its `FreeOrders`; it ends when it is told
to, or with its parent.
"""

from __future__ import annotations

import sys

from cubepath.agents.free.host_node import FreeHostNode
from cubepath.agents.free.mover import FreeOrders
from cubepath.protocol.wire.shell import Shell, serve


def host(orders: FreeOrders) -> None:
    """Enter, and serve until `Go` says "stop"."""
    node = FreeHostNode(orders)
    with Shell(node, orders.endpoint, credentials=orders.credentials) as shell:
        shell.start()
        while not shell.ended:
            shell.step()


if __name__ == "__main__":
    sys.exit(serve(FreeOrders, lambda orders: orders.endpoint, host))
