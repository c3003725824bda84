"""Seeds of runs with rounds: the run that one stands for, and what is kept of a failing one."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from random import Random

from cubepath.coordinator.simulation.faults import KINDS, Drawn, Faults
from cubepath.coordinator.simulation.scenarios import ANYTHING, Asked, Scenario, scenario_of
from cubepath.coordinator.simulation.simulated import (
    COORDINATOR,
    LIE,
    PATIENCE_US,
    MakeNode,
    Simulated,
    host_node,
    process_names,
    simulate,
)
from cubepath.coordinator.simulation.trace import Trace
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.wire.messages import Again, Go, Ready, Said, Waiting, decode, kind_of

OUTCOMES = ("goal", "max-rounds", "gave-up", "crash", "return", "stall", LIE, "failure")
"""How a run can come out: it ends as without faults in the first three, or by one, or it fails."""


class Lockstep:
    """Simulates runs with rounds."""

    kinds = KINDS
    outcomes = OUTCOMES
    unit = "rounds"

    def __init__(self, asked: Asked = ANYTHING, make: MakeNode = host_node) -> None:
        """Draw what is not asked for; `make` makes the nodes of module processes."""
        self.asked = asked
        self._make = make

    def run_of(self, seed: int) -> Simulated:
        """Simulate the run that a seed stands for, with the faults that are drawn from it."""
        scenario = scenario_of(seed, self.asked)
        return self.play(seed, scenario, self._drawn(scenario, f"{seed}/faults", f"{seed}/lies"))

    def play(
        self, seed: int, scenario: Scenario, faults: Faults, trace: Trace | None = None
    ) -> Simulated:
        """Simulate a scenario with these faults."""
        return simulate(scenario, faults, fault_seed=seed, trace=trace, make=self._make)

    def draw(self, seed: int, scenario: Scenario, text: str) -> Faults:
        """Draw other faults for a seed."""
        return self._drawn(scenario, f"{seed}/{text}", f"{seed}/{text}/lies")

    def _drawn(self, scenario: Scenario, faults: str, lies: str) -> Faults:
        random = Random(faults)  # noqa: S311 - not for secrets
        liars = Random(lies) if self.asked.liars else None  # noqa: S311 - not for secrets
        return Drawn(random, COORDINATOR, process_names(scenario), PATIENCE_US, liars)

    def names(self, scenario: Scenario) -> list[str]:
        """Return the names of the processes."""
        return [COORDINATOR, *process_names(scenario)]

    def write(self, run: Simulated, log: Path, why: str) -> bool:
        """Write the recording of a run; return whether there is one."""
        recording = run.recording
        parameters = {**recording.parameters, "simulated": why}
        with RecordingWriter(log, recording.scene, parameters) as writer:
            for record in recording.records:
                writer.write(
                    record.topic, record.data, round_number=record.round, wall_ns=record.wall_ns
                )
        return True

    def label(self, data: bytes) -> str:
        """Return in a few words what a message is, for a picture."""
        return label(data)


def label(data: bytes) -> str:
    """Return in a few words what a message is, for a picture."""
    try:
        message = decode(data)
    except CubepathError:
        return "no message"
    match message:
        case Go() | Ready() | Again() | Waiting():
            return f"{kind_of(message)} {message.round} {message.phase}"
        case Said():
            kinds = Counter(kind_of(part) for part in message.parts)
            told = ", ".join(kind if n == 1 else f"{n} {kind}" for kind, n in kinds.items())
            return f"{told} to {message.region}"
        case _:
            return f"{kind_of(message)} {message.round}"
