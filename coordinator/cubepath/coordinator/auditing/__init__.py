"""Rules played again: whether the modules of a recording chose as their rules and the seed say.

Room: coordinator. `verification` derives what each module observed, and imports nothing of the
agents; here the installed rules are asked, as modules ask theirs. It imports `verification` and, of
the agents, `rules`. The command line verifies recordings with it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.auditing.recording import audit, unused_rules
else:
    __getattr__, __dir__ = lazy_face(__name__, {"recording": "audit unused_rules"})

__all__ = ["audit", "unused_rules"]
