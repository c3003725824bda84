"""Modules of a run without rounds: each senses, chooses and attempts when it is ready.

Room: agents. It opens sessions and starts processes. It imports `rules`, `local`, `keepers` and,
for child processes, `processes`. A run under the free clock uses a `FreeFleet`; the simulator uses
its nodes.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.agents.free.fleet import (
        BIRTHS,
        ON_CRASH,
        Births,
        FreeFleet,
        OnCrash,
        log_of,
        read_births,
    )
    from cubepath.agents.free.host_node import HALT_S, FreeHostNode
    from cubepath.agents.free.orders import FreeOrders, OwnMove
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "fleet": "BIRTHS Births FreeFleet ON_CRASH OnCrash log_of read_births",
            "host_node": "FreeHostNode HALT_S",
            "orders": "FreeOrders OwnMove",
        },
    )

__all__ = [
    "BIRTHS",
    "HALT_S",
    "ON_CRASH",
    "Births",
    "FreeFleet",
    "FreeHostNode",
    "FreeOrders",
    "OnCrash",
    "OwnMove",
    "log_of",
    "read_births",
]
