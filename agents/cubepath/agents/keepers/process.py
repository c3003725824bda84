"""A keeper in a process of its own, on one zenoh session, with its log in a file.

Started as ``python -m cubepath.agents.keepers.process`` with its `KeeperOrders`; it ends when it is
told to, or with its parent.
"""

from __future__ import annotations

import sys
from pathlib import Path

from cubepath.agents.keepers.journal import FileJournal, Opened
from cubepath.agents.keepers.keeper import Keeper
from cubepath.agents.keepers.node import KeeperNode, KeeperOrders
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.toml import scene_from_toml
from cubepath.protocol.wire.shell import Shell, serve
from cubepath.protocol.wire.tiles import Tiles


def keep(orders: KeeperOrders) -> None:
    """Come back from the log if there is one, and serve until `Go` says "stop"."""
    scene = scene_from_toml(orders.scene, "the orders")
    tiles = Tiles(scene.system, orders.keepers)
    opened = Opened(orders.log_run, orders.keeper, orders.birth)
    with FileJournal(Path(orders.log), opened, orders.commits) as journal:
        try:
            keeper = Keeper(orders.keeper, scene, tiles, journal, tell_reads=orders.tell_reads)
        except InputError as error:
            raise InputError(f"{orders.log}: {error}") from None
        node = KeeperNode(keeper, orders.run, orders.modules_of, orders.birth)
        with Shell(node, orders.endpoint, credentials=orders.credentials) as shell:
            shell.start()
            while not shell.ended:
                shell.step()


if __name__ == "__main__":
    sys.exit(serve(KeeperOrders, lambda orders: orders.endpoint, keep))
