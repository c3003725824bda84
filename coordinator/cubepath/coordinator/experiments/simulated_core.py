"""Runs with messages under the simulator: the nodes of a run on a simulated wire, in virtual time.

Faults come at the rates of the setting, drawn from the seed; without them the path is that of the
same run in compiled code, which the simulator checks.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from random import Random

from cubepath.coordinator.experiments.facts import SceneFacts
from cubepath.coordinator.experiments.gathered_runs import gathered_run, recorded_run
from cubepath.coordinator.experiments.outcomes import (
    ERROR,
    FAULT,
    GAVE_UP,
    GOAL,
    MAX_ROUNDS,
    PlayedRun,
)
from cubepath.coordinator.experiments.setting import FaultRates, RunSetting, thinking
from cubepath.coordinator.runs.free_gatherer import FreeGatherer
from cubepath.coordinator.simulation.faults import SECOND_US, Fault
from cubepath.coordinator.simulation.free_simulated import FreeSimulatedRun, free_simulate
from cubepath.coordinator.simulation.scenarios import FreeScenario, Scenario
from cubepath.coordinator.simulation.simulated import SimulatedRun, simulate
from cubepath.coordinator.simulation.swarm import Lockstep

_BACK_US = SECOND_US
"""Without rounds, another process takes the place of one that died after so long."""
_DOUBLED_US = 1000
"""How much later a message comes for the second time."""
_LONG_US = 120 * SECOND_US
"""Without rounds, there are no more faults after this virtual time, and what is left must end."""
_EXPECTED = ("ended", "ran away")
"""What the simulator finds fault with, and is no error of code where faults have no bounds: that
they ended a run, or kept it from its end."""
_ENDLESS = "liveness"
"""It also finds fault with a run without rounds that goes on for very long without an end."""


class _AtRates:
    """Faults at fixed rates, drawn from the seed; places with rates of their own come first."""

    liars: frozenset[str] = frozenset()

    def __init__(self, rates: FaultRates, seed: int, *, back: bool) -> None:
        self._rates = rates
        self._random = Random(f"{seed}/experiment")  # noqa: S311 - not for secrets
        self._back_us = _BACK_US if back else 0
        self._hops: Mapping[str, tuple[float, int]] = {
            "loss": (rates.loss, 0),
            "delay": (rates.delay, round(1000 * rates.delay_ms)),
            "duplicate": (rates.duplicate, _DOUBLED_US),
        }

    def on_hop(self, where: str, nth: int) -> Fault | None:
        """Draw whether something happens to a message."""
        if not (self._rates.loss or self._rates.delay or self._rates.duplicate):
            return None
        one = self._random.random()
        for kind, (rate, amount_us) in self._hops.items():
            if one < rate:
                return Fault(where, nth, kind, amount_us)
            one -= rate
        return None

    def on_process(self, where: str, nth: int) -> Fault | None:
        """Draw whether a module process dies."""
        if not self._rates.crash or not where.startswith("process_") or " " in where:
            return None
        if self._random.random() >= self._rates.crash:
            return None
        return Fault(where, nth, "return" if self._back_us else "crash", self._back_us)

    def on_router(self, nth: int) -> Fault | None:
        """Return None: the router stays."""

    def on_saying(self, where: str, nth: int, kinds: Sequence[str]) -> Fault | None:
        """Return None: nobody lies."""


def play_simulated(
    setting: RunSetting, facts: SceneFacts, seed: int, log: Path | None
) -> PlayedRun:
    """Return a run under the simulator; with a `log` its recording is written there."""
    if setting.clock == "free":
        return _free(setting, facts, seed)
    began = time.monotonic()
    scenario = Scenario(
        system=setting.system,
        rule=setting.rule,
        processes=setting.processes,
        hesitate=setting.hesitate,
        max_rounds=setting.max_rounds,
        seed=seed,
    )
    found = simulate(scenario, _AtRates(setting.faults, seed, back=False), fault_seed=seed)
    played = recorded_run(found.recording, facts, *_ended(found, setting))
    if log is not None:
        log.parent.mkdir(parents=True, exist_ok=True)
        Lockstep().write(found, log, f"seed {seed}, faults {setting.faults.text()}")
        played.recording = log.name
    played.time = found.seconds
    played.seconds = time.monotonic() - began
    return played


def _ended(found: SimulatedRun, setting: RunSetting) -> tuple[str, str | None]:
    if found.failure is not None:
        return _of_failure(found.failure.kind, setting), found.failure.detail
    error = None if found.ending is None else found.ending.error
    match found.outcome:
        case "goal":
            return GOAL, None
        case "max-rounds":
            return MAX_ROUNDS, None
        case "gave-up":
            return GAVE_UP, error
        case _:
            return FAULT, error


def _of_failure(kind: str, setting: RunSetting) -> str:
    return FAULT if setting.faults.of_messages and kind in _EXPECTED else ERROR


def _free(setting: RunSetting, facts: SceneFacts, seed: int) -> PlayedRun:
    began, scene = time.monotonic(), facts.scene
    factors = thinking(setting, scene, seed)
    scenario = FreeScenario(
        system=setting.system,
        rule=setting.rule,
        processes=setting.processes,
        keepers=setting.keepers,
        hesitate=setting.hesitate,
        factors=tuple(factors.get(module, 0.0) for module in range(len(scene.start))),
        moves=setting.max_rounds * len(scene.start),
        long_us=_LONG_US,
        files=False,
        seed=seed,
        ends_at_goal=scene.goal is not None,
    )
    faults = _AtRates(setting.faults, seed, back=True)
    found = free_simulate(scenario, faults, fault_seed=seed)
    gatherer = FreeGatherer(scene, setting.keepers)
    for commit in found.commits:
        gatherer.take(commit)
    played = gathered_run(gatherer, facts, *_free_end(found, setting))
    played.messages = found.messages
    played.time = found.moved_seconds
    played.seconds = time.monotonic() - began
    return played


def _free_end(found: FreeSimulatedRun, setting: RunSetting) -> tuple[str, str | None]:
    if found.failure is None:
        over = found.came_to == "moves" and found.moves < found.scenario.moves
        return (
            MAX_ROUNDS,
            f"no end within {_LONG_US // SECOND_US} virtual seconds" if over else None,
        )
    if found.failure.kind == "rule":
        return GAVE_UP, found.failure.detail
    if found.failure.kind == _ENDLESS:
        return MAX_ROUNDS, found.failure.detail
    return _of_failure(found.failure.kind, setting), found.failure.detail
