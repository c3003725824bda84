"""Simulation: whole runs under faults, in one process and virtual time, each from its seed.

Room: coordinator. The nodes are those of a run, on a simulated wire. It imports `runs` and
`verification`, and of the agents `processes`, `rules` and the environment, which is the other way
to the edge path of a run. The command `simulate` uses it, and so do experiments.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.simulation.faults import (
        ENDING,
        KINDS,
        ON_HOPS,
        ROUTER,
        SECOND_US,
        Fault,
        Listed,
    )
    from cubepath.coordinator.simulation.free_faults import FREE_KINDS, STARTS
    from cubepath.coordinator.simulation.free_scenarios import FreeScenario
    from cubepath.coordinator.simulation.free_simulated import FreeSimulated, free_simulate
    from cubepath.coordinator.simulation.lockstep import Lockstep
    from cubepath.coordinator.simulation.scenarios import Asked, Scenario, built, check
    from cubepath.coordinator.simulation.simulated import (
        MakeNode,
        Simulated,
        host_node,
        simulate,
    )
    from cubepath.coordinator.simulation.swarm import Kept, Tally, simulate_seeds, simulator_of
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "faults": "ENDING Fault KINDS Listed ON_HOPS ROUTER SECOND_US",
            "free_faults": "FREE_KINDS STARTS",
            "free_scenarios": "FreeScenario",
            "free_simulated": "FreeSimulated free_simulate",
            "lockstep": "Lockstep",
            "scenarios": "Asked Scenario built check",
            "simulated": "MakeNode Simulated host_node simulate",
            "swarm": "Kept Tally simulate_seeds simulator_of",
        },
    )

__all__ = [
    "ENDING",
    "FREE_KINDS",
    "KINDS",
    "ON_HOPS",
    "ROUTER",
    "SECOND_US",
    "STARTS",
    "Asked",
    "Fault",
    "FreeScenario",
    "FreeSimulated",
    "Kept",
    "Listed",
    "Lockstep",
    "MakeNode",
    "Scenario",
    "Simulated",
    "Tally",
    "built",
    "check",
    "free_simulate",
    "host_node",
    "simulate",
    "simulate_seeds",
    "simulator_of",
]
