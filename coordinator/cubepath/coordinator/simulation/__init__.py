"""Simulation: whole runs under faults, in one process and virtual time, each from its seed.

Room: coordinator. The nodes are those of a run, on a simulated wire. It imports `runs` and
`verification`, and of the agents `processes`, `rules` and the environment, which is the other way
to the edge path of a run. The command `simulate` uses it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.simulation.scenarios import Asked, check
    from cubepath.coordinator.simulation.swarm import Kept, Tally, simulate_seeds, simulator_of
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "scenarios": "Asked check",
            "swarm": "Kept Tally simulate_seeds simulator_of",
        },
    )

__all__ = ["Asked", "Kept", "Tally", "check", "simulate_seeds", "simulator_of"]
