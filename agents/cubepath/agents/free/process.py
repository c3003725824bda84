"""A module process of a run without rounds, on one zenoh session.

It is started as ``python -m cubepath.agents.free.process`` with its `FreeProcessConfig`, and ends
with the run or with its parent.
"""

import sys

from cubepath.agents.free.config import FreeProcessConfig
from cubepath.agents.free.host_node import FreeHostNode
from cubepath.protocol.wire.shell import run_node, serve


def host(config: FreeProcessConfig) -> None:
    """Enter, and serve until `Go` says "stop"."""
    run_node(FreeHostNode(config), config.endpoint, config.credentials)


if __name__ == "__main__":
    sys.exit(serve(FreeProcessConfig, lambda config: config.endpoint, host))
