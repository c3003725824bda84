"""Module processes and the fleet that starts, paces and ends them.

Room: agents. It opens sessions and starts processes. It imports `rules`, `local` and the protocol.
A run and the environment over zenoh each use a `Fleet`.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.agents.processes.dealing import dealt
    from cubepath.agents.processes.fleet import Fleet
    from cubepath.agents.processes.joining import Joining, join
    from cubepath.agents.processes.judge import Judge, RefusedError, refuse
    from cubepath.agents.processes.network import Network, Way, straight
    from cubepath.agents.processes.node import HostNode
    from cubepath.agents.processes.offspring import Ended, Offspring
    from cubepath.agents.processes.orders import OUTSIDE, Orders
    from cubepath.agents.processes.pacer import PATIENCE_S, PATIENCE_S_MAX, Pacer, ProcessDied
    from cubepath.agents.processes.phases import KINDS_IN
    from cubepath.agents.processes.refusals import Refusals
    from cubepath.agents.processes.settling import Settling
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "dealing": "dealt",
            "fleet": "Fleet",
            "joining": "Joining join",
            "judge": "Judge RefusedError refuse",
            "network": "Network Way straight",
            "node": "HostNode",
            "offspring": "Ended Offspring",
            "orders": "OUTSIDE Orders",
            "pacer": "PATIENCE_S PATIENCE_S_MAX Pacer ProcessDied",
            "phases": "KINDS_IN",
            "refusals": "Refusals",
            "settling": "Settling",
        },
    )

__all__ = [
    "KINDS_IN",
    "OUTSIDE",
    "PATIENCE_S",
    "PATIENCE_S_MAX",
    "Ended",
    "Fleet",
    "HostNode",
    "Joining",
    "Judge",
    "Network",
    "Offspring",
    "Orders",
    "Pacer",
    "ProcessDied",
    "Refusals",
    "RefusedError",
    "Settling",
    "Way",
    "dealt",
    "join",
    "refuse",
    "straight",
]
