"""Two runs compared: where they part, and why.

Room: coordinator. It reads recordings with what `verification` sorts them by, asks rules again as
`auditing` does, and compares paths by `verification.equality`. The command line and the assertions
of `testing` take it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.comparison.compared import Compared
    from cubepath.coordinator.comparison.comparing import diff
    from cubepath.coordinator.comparison.moves import first_other
else:
    __getattr__, __dir__ = lazy_face(
        __name__, {"compared": "Compared", "comparing": "diff", "moves": "first_other"}
    )

__all__ = ["Compared", "diff", "first_other"]
