"""Simulation: whole runs under faults, in one process and virtual time, each from its seed.

Room: coordinator. The nodes are those of a run, on a simulated wire. It imports `runs` and
`verification`, and of the agents `processes`, `rules` and the environment, which is the other way
to the edge path of a run. The command `simulate` uses it, and so do experiments.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.simulation.faults import SECOND_US, Fault
    from cubepath.coordinator.simulation.free_scenarios import FreeScenario
    from cubepath.coordinator.simulation.free_simulated import FreeSimulated, free_simulate
    from cubepath.coordinator.simulation.lockstep import Lockstep
    from cubepath.coordinator.simulation.scenarios import Asked, Scenario, check
    from cubepath.coordinator.simulation.simulated import Simulated, simulate
    from cubepath.coordinator.simulation.swarm import Kept, Tally, simulate_seeds, simulator_of
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "faults": "SECOND_US Fault",
            "free_scenarios": "FreeScenario",
            "free_simulated": "FreeSimulated free_simulate",
            "lockstep": "Lockstep",
            "scenarios": "Asked Scenario check",
            "simulated": "Simulated simulate",
            "swarm": "Kept Tally simulate_seeds simulator_of",
        },
    )

__all__ = [
    "SECOND_US",
    "Asked",
    "Fault",
    "FreeScenario",
    "FreeSimulated",
    "Kept",
    "Lockstep",
    "Scenario",
    "Simulated",
    "Tally",
    "check",
    "free_simulate",
    "simulate",
    "simulate_seeds",
    "simulator_of",
]
