"""Recordings for other tools: tables, and files for viewers in three dimensions.

Room: coordinator. It imports `shortening` for files of moves, `runs` for where modules are, and
`rendering` of the agents for where they are drawn. `commands` and users take it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.exports.exporting import Exported, export
else:
    __getattr__, __dir__ = lazy_face(__name__, {"exporting": "Exported export"})

__all__ = ["Exported", "export"]
