"""A module process: a node with some modules of a run, on one zenoh session.

It is started as ``python -m cubepath.agents.processes.host`` with its `ProcessConfig`, and ends
with the run or with its parent. Zenoh callbacks only enqueue; the loop does all the work, in the
order of the queue.
"""

import sys

from cubepath.agents.processes.config import ProcessConfig
from cubepath.agents.processes.node import HostNode
from cubepath.protocol.wire.shell import run_node, serve


def host(config: ProcessConfig) -> None:
    """Join the run and serve until `Go` says "stop"; in a process or a thread."""
    run_node(HostNode(config), config.endpoint, config.credentials)


if __name__ == "__main__":
    sys.exit(serve(ProcessConfig, lambda config: config.endpoint, host))
