"""Keepers: the sites themselves, as processes that hold, show and change them, and decide nothing.

Room: agents. Runs without rounds have them, since silence means nothing there and an empty site has
nobody to speak for it. It imports the protocol alone: nothing about rules, views and modules.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.agents.keepers.attempts import support_units
    from cubepath.agents.keepers.journal import FileJournal, Journal, MemoryJournal
    from cubepath.agents.keepers.keeper import ABORTED, Keeper
    from cubepath.agents.keepers.node import KeeperNode
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "attempts": "support_units",
            "journal": "FileJournal Journal MemoryJournal",
            "keeper": "ABORTED Keeper",
            "node": "KeeperNode",
        },
    )

__all__ = [
    "ABORTED",
    "FileJournal",
    "Journal",
    "Keeper",
    "KeeperNode",
    "MemoryJournal",
    "support_units",
]
