"""A keeper in a separate process, on one zenoh session, with its log in a file.

It is started as ``python -m cubepath.agents.keepers.process`` with its `KeeperConfig`, and ends
when it is told to or with its parent.
"""

import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from cubepath.agents.keepers.config import KeeperConfig
from cubepath.agents.keepers.journal import FileJournal, Opened
from cubepath.agents.keepers.keeper import Keeper
from cubepath.agents.keepers.node import KeeperNode
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.toml import scene_from_toml
from cubepath.protocol.wire.keys import Tiles
from cubepath.protocol.wire.shell import run_node, serve


@contextmanager
def keeper_node(config: KeeperConfig) -> Generator[KeeperNode]:
    """Make the node of a keeper, which comes back from its log if there is one."""
    scene = scene_from_toml(config.scene, "the configuration")
    tiles = Tiles(scene.system, config.keepers)
    opened = Opened(config.log_run, config.keeper, config.incarnation)
    with FileJournal(Path(config.log), opened, config.commits) as journal:
        try:
            keeper = Keeper(config.keeper, scene, tiles, journal, tell_reads=config.tell_reads)
        except InputError as error:
            raise InputError(f"{config.log}: {error}") from None
        yield KeeperNode(keeper, config.run, config.modules_of, config.incarnation)


def keep(config: KeeperConfig) -> None:
    """Serve until `Go` says "stop"."""
    with keeper_node(config) as node:
        run_node(node, config.endpoint, config.credentials)


if __name__ == "__main__":
    sys.exit(serve(KeeperConfig, lambda config: config.endpoint, keep))
