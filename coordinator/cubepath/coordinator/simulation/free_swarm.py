"""Seeds of runs without rounds: the run that one stands for, and what is kept of a failing one."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from random import Random

from cubepath.agents.keepers.keeper import Keeper
from cubepath.coordinator.simulation.faults import Faults
from cubepath.coordinator.simulation.free_faults import FREE_KINDS, FreeDrawn
from cubepath.coordinator.simulation.free_scenarios import FreeScenario, free_scenario_of
from cubepath.coordinator.simulation.free_simulated import (
    FreeSimulated,
    MakeKeeper,
    free_simulate,
    host_names,
    keeper_names,
)
from cubepath.coordinator.simulation.scenarios import Asked
from cubepath.coordinator.simulation.simulated import COORDINATOR
from cubepath.coordinator.simulation.trace import Trace
from cubepath.protocol.wire.free_messages import Asks, Passes, Tells, decode_free, free_kind

WITHOUT_ROUNDS = Asked(clock="free")
"""Nothing else is asked for: everything is drawn."""
FREE_OUTCOMES = ("goal", "moves", "blocked", "failure")
"""How a run can come out: at its goal, or with moves enough; nothing could move but for the dead,
or these were in the way of the goal; or it fails."""


class Free:
    """Simulates runs without rounds."""

    kinds = FREE_KINDS
    outcomes = FREE_OUTCOMES
    unit = "moves"

    def __init__(self, asked: Asked = WITHOUT_ROUNDS, make: MakeKeeper = Keeper) -> None:
        """Draw what is not asked for; `make` makes keepers."""
        self.asked = asked
        self._make = make

    def run_of(self, seed: int) -> FreeSimulated:
        """Simulate the run that a seed stands for, with the faults that are drawn from it."""
        scenario = free_scenario_of(seed, self.asked)
        return self.play(seed, scenario, self.draw(seed, scenario, "free faults"))

    def play(
        self, seed: int, scenario: FreeScenario, faults: Faults, trace: Trace | None = None
    ) -> FreeSimulated:
        """Simulate a scenario with these faults."""
        return free_simulate(scenario, faults, fault_seed=seed, trace=trace, make=self._make)

    def draw(self, seed: int, scenario: FreeScenario, text: str) -> Faults:
        """Draw faults for a seed."""
        random = Random(f"{seed}/{text}")  # noqa: S311 - not for secrets
        return FreeDrawn(random, host_names(scenario), keeper_names(scenario))

    def names(self, scenario: FreeScenario) -> list[str]:
        """Return the names of the processes."""
        return [*host_names(scenario), *keeper_names(scenario), COORDINATOR]

    def write(self, _run: FreeSimulated, log: Path, _why: str) -> bool:
        """Write no recording, only make the folder: what was said is in the picture."""
        log.parent.mkdir(parents=True, exist_ok=True)
        return False

    def label(self, data: bytes) -> str:
        """Return in a few words what a message is, for a picture."""
        message = decode_free(data)
        if isinstance(message, Asks | Passes | Tells):
            kinds = Counter(part.__struct_config__.tag for part in message.parts)
            return ", ".join(f"{kind}" if n == 1 else f"{n} {kind}" for kind, n in kinds.items())
        return free_kind(message)
