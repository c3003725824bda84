"""Keepers: the sites themselves, as processes that hold, show and change them, and decide nothing.

Room: agents. Runs without rounds have them, since silence means nothing there and an empty site has
nobody to speak for it. It imports the protocol alone: nothing about rules, views and modules.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.agents.keepers.attempts import chain_of, planned, support_units
    from cubepath.agents.keepers.journal import (
        Acknowledged,
        Born,
        Committed,
        Decided,
        FileJournal,
        Journal,
        MemoryJournal,
        Opened,
        Prepared,
        Record,
        read_log,
    )
    from cubepath.agents.keepers.keeper import Keeper
    from cubepath.agents.keepers.node import TICK_S, KeeperNode
    from cubepath.agents.keepers.orders import KeeperOrders
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "attempts": "chain_of planned support_units",
            "journal": "Acknowledged Born Committed Decided FileJournal Journal MemoryJournal"
            " Opened Prepared Record read_log",
            "keeper": "Keeper",
            "node": "KeeperNode TICK_S",
            "orders": "KeeperOrders",
        },
    )

__all__ = [
    "TICK_S",
    "Acknowledged",
    "Born",
    "Committed",
    "Decided",
    "FileJournal",
    "Journal",
    "Keeper",
    "KeeperNode",
    "KeeperOrders",
    "MemoryJournal",
    "Opened",
    "Prepared",
    "Record",
    "chain_of",
    "planned",
    "read_log",
    "support_units",
]
