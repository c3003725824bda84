"""Module processes and the fleet that starts, paces and ends them.

Room: agents. It opens sessions and starts processes. It imports `rules`, `local` and the protocol.
A run and the environment over zenoh each use a `Fleet`.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.agents.processes.fleet import Fleet
    from cubepath.agents.processes.orders import OUTSIDE
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "fleet": "Fleet",
            "orders": "OUTSIDE",
        },
    )

__all__ = ["OUTSIDE", "Fleet"]
