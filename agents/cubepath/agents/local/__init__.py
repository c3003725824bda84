"""One module's view and choice: observation, arbitration, and the module as a pure machine.

Room: agents. No process, no session, no clock and no random number: what goes in decides what comes
out. It imports the protocol alone. Rules, module processes and environments are built on it; the
coordinator does not know it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.agents.local.arbitration import settled
    from cubepath.agents.local.module import ModuleCore
    from cubepath.agents.local.observation import (
        SILENT,
        STAY,
        Note,
        Observation,
        View,
        checked_note,
        observation_length,
        observe,
        view_of,
    )
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "arbitration": "settled",
            "module": "ModuleCore",
            "observation": (
                "Note Observation SILENT STAY View checked_note observation_length observe view_of"
            ),
        },
    )

__all__ = [
    "SILENT",
    "STAY",
    "ModuleCore",
    "Note",
    "Observation",
    "View",
    "checked_note",
    "observation_length",
    "observe",
    "settled",
    "view_of",
]
