"""Whether a rule is local: played under all that must not matter to it, and watched.

Room: agents. It imports `environments`, `rules`, `local` and the protocol. Rules are loaded
in processes of their own alone. The command line asks it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.agents.locality.check import Checked, check_rule
    from cubepath.agents.locality.findings import Finding
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "check": "Checked check_rule",
            "findings": "Finding",
        },
    )

__all__ = ["Checked", "Finding", "check_rule"]
