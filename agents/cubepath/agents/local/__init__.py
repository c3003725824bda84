"""One module's view and choice: observation, arbitration, and the module as a pure machine.

Room: agents. No process, no session, no clock and no random number: the output depends only on the
input. It imports only the protocol. Rules, module processes and environments are built on it; the
coordinator does not use it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.agents.local.arbitration import (
        contest,
        outcome,
        priority,
        seed_in,
        site_after,
        verdict,
        waiting_for,
    )
    from cubepath.agents.local.module import ModuleCore, ProtocolError
    from cubepath.agents.local.notes import LastNote, nothing_said
    from cubepath.agents.local.observation import (
        SILENT,
        STAY,
        Array,
        Mask,
        Note,
        Observation,
        View,
        checked_note,
        chosen_move,
        goal_sets,
        is_legal,
        observation_length,
        observe,
        view_of,
    )
    from cubepath.agents.local.relative import (
        RelativeObserver,
        Showing,
        checked_showing,
        relative_layout,
        relative_observer,
    )
    from cubepath.agents.local.relative_rows import RelativeRows
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "arbitration": "contest outcome priority seed_in site_after verdict waiting_for",
            "module": "ModuleCore ProtocolError",
            "notes": "LastNote nothing_said",
            "observation": (
                "Array Mask Note Observation SILENT STAY View checked_note chosen_move goal_sets "
                "is_legal observation_length observe view_of"
            ),
            "relative": (
                "RelativeObserver Showing checked_showing relative_layout relative_observer"
            ),
            "relative_rows": "RelativeRows",
        },
    )

__all__ = [
    "SILENT",
    "STAY",
    "Array",
    "LastNote",
    "Mask",
    "ModuleCore",
    "Note",
    "Observation",
    "ProtocolError",
    "RelativeObserver",
    "RelativeRows",
    "Showing",
    "View",
    "checked_note",
    "checked_showing",
    "chosen_move",
    "contest",
    "goal_sets",
    "is_legal",
    "nothing_said",
    "observation_length",
    "observe",
    "outcome",
    "priority",
    "relative_layout",
    "relative_observer",
    "seed_in",
    "site_after",
    "verdict",
    "view_of",
    "waiting_for",
]
