"""Runs with messages, as gathered: their paths, lost claims and messages.

Faults occur at the rates of the setting, drawn from the seed. Without faults, the path is that of
the same run in compiled code, which the simulator checks.
"""

import shutil
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from random import Random

import numpy as np

from cubepath.coordinator.experiments.instances import Change, SceneFacts
from cubepath.coordinator.experiments.outcomes import (
    ERROR,
    FAULT,
    GAVE_UP,
    GOAL,
    MAX_ROUNDS,
    PlayedRun,
)
from cubepath.coordinator.experiments.rows import sum_of_costs
from cubepath.coordinator.experiments.setting import FaultRates, RunSetting, thinking
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.free_gatherer import FreeGatherer
from cubepath.coordinator.runs.gathering import gathered
from cubepath.coordinator.runs.outcome import Outcome
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import run
from cubepath.coordinator.simulation.faults import SECOND_US, Fault
from cubepath.coordinator.simulation.free_simulated import FreeSimulatedRun, free_simulate
from cubepath.coordinator.simulation.scenarios import FreeScenario, Scenario
from cubepath.coordinator.simulation.simulated import SimulatedRun, simulate
from cubepath.protocol.core.sites import Ordinals
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.writing import copy_recording
from cubepath.protocol.wire.messages import Report, decode

_RESULTS = ("edges", "cube", "certificate", "summary")
"""Recorded messages that no process sent, but the coordinator derived."""


def gathered_run(found: Gathered, facts: SceneFacts, ended: str, reason: str | None) -> PlayedRun:
    """Return a run as it was gathered: ended at its goal, or otherwise as its summary says."""
    numbers = Ordinals[Change]()
    state = set(found.scene.start_state)
    moves: list[int] = []
    movers: list[int] = []
    ends: list[int] = []
    for step in found.steps:
        for action in step.actions:
            one, other = action.ends
            off, on = one - other, other - one
            if not (off <= state and not on & state):
                off, on = on, off
            state -= off
            state |= on
            moves.append(numbers[off, on])
        movers += [move.module for move in step.executed]
        ends.append(len(moves))
    heap = found.heap
    return PlayedRun(
        moves=np.array(moves, np.int64),
        measures=facts.measures(numbers),
        ends=np.array(ends, np.int64),
        sites=tuple(found.sites),
        costs=sum_of_costs(movers, np.array(ends, np.int64)),
        reduced=heap.reduced_moves,
        cubes=heap.cubes,
        largest_cube=heap.max_cube_dimension,
        digest=found.digest,
        ended=GOAL if found.reached else ended,
        reason=None if found.reached else reason,
    )


def recorded_run(
    recording: Recording, facts: SceneFacts, ended: str, reason: str | None
) -> PlayedRun:
    """Return a run from its recording; CheckError or InputError if that cannot be gathered."""
    found = gathered_run(gathered(recording), facts, ended, reason)
    found.messages = sum(record.kind not in _RESULTS for record in recording.records)
    if recording.clock == "lockstep":
        lost = [0] * len(found.ends)
        for record in recording.of_kind("report"):
            report = decode(record.data)
            # Of a round that not all have reported nothing is gathered.
            if isinstance(report, Report) and report.claim == "lost" and report.round <= len(lost):
                lost[report.round - 1] += 1
        found.conflicts = np.array(lost, np.int64)
    return found


_TRIES = 3
_scratch: set[str] = set()
"""Folders with recordings that nobody asked for."""
_GAVE_UP = "module_"
"""How the error of a run begins if a rule gave up."""


def play_on_wire(setting: RunSetting, facts: SceneFacts, seed: int, log: Path | None) -> PlayedRun:
    """Return a run in processes; its recording goes to `log`, or else away.

    KeyboardInterrupt if it was interrupted.
    """
    if log is not None:
        log.parent.mkdir(parents=True, exist_ok=True)
        log.unlink(missing_ok=True)  # of a run that was cut off
        played = _played(setting, facts, seed, log)
        played.recording = log.name
        return played
    with tempfile.TemporaryDirectory(prefix="cubepath-sweep-") as folder:
        _scratch.add(folder)
        try:
            return _played(setting, facts, seed, Path(folder) / "run.mcap")
        finally:
            _scratch.discard(folder)


def discard_scratch() -> None:
    """Remove the folders of runs that are played now; for a process that has to end at once."""
    for folder in sorted(_scratch):
        for _ in range(_TRIES):  # the run may be writing there still
            shutil.rmtree(folder, ignore_errors=True)


def _played(setting: RunSetting, facts: SceneFacts, seed: int, log: Path) -> PlayedRun:
    began = time.monotonic()
    scene, free = facts.scene, setting.clock == "free"
    outcome = run(
        Plan(
            system=setting.system,
            rule=setting.rule,
            seed=seed,
            hesitate=setting.hesitate,
            processes=setting.processes,
            max_rounds=setting.max_rounds,
            log=log,
            clock=setting.clock,
            keepers=setting.keepers if free else 4,
            speeds=thinking(setting, scene, seed),
        )
    )
    if outcome.ended == "interrupted":
        raise KeyboardInterrupt
    played = recorded_run(read_recording(log), facts, *_ended(outcome))
    played.seconds = time.monotonic() - began
    return played


def _ended(outcome: Outcome) -> tuple[str, str | None]:
    if outcome.ended == "goal":
        return GOAL, None
    if outcome.ended == "max-rounds":
        return MAX_ROUNDS, None
    gave_up = outcome.error is not None and outcome.error.startswith(_GAVE_UP)
    return GAVE_UP if gave_up else ERROR, outcome.error


_BACK_US = SECOND_US
"""Without rounds, the time after which another process takes the place of a dead one."""
_DOUBLED_US = 1000
"""How much later a message comes for the second time."""
_LONG_US = 120 * SECOND_US
"""Without rounds, there are no more faults after this virtual time, and the run must end."""
_EXPECTED = ("ended", "ran away")
"""What the simulator finds fault with, and is no error of code where faults have no bounds: that
they ended a run, or kept it from its end."""
_ENDLESS = "liveness"
"""It also finds fault with a run without rounds that continues for very long without an end."""


class _AtRates:
    """Faults at fixed rates, drawn from the seed."""

    liars: frozenset[str] = frozenset()

    def __init__(self, rates: FaultRates, seed: int, *, back: bool) -> None:
        self._random = Random(f"{seed}/experiment")  # noqa: S311 - not for secrets
        hops = {
            "loss": (rates.loss, 0),
            "delay": (rates.delay, round(1000 * rates.delay_ms)),
            "duplicate": (rates.duplicate, _DOUBLED_US),
        }
        dies = {"return": (rates.crash, _BACK_US)} if back else {"crash": (rates.crash, 0)}
        self._rates = {"up": hops, "down": hops, "": dies}

    def at(self, where: str, nth: int, kinds: Sequence[str] = ()) -> Fault | None:  # noqa: ARG002
        """Draw whether something happens to a message, or whether a module process dies."""
        name, _, link = where.partition(" ")
        rates = self._rates.get(link, {}) if link or name.startswith("process_") else {}
        if not any(rate for rate, _ in rates.values()):
            return None
        one = self._random.random()
        for kind, (rate, amount_us) in rates.items():
            if one < rate:
                return Fault(where, nth, kind, amount_us)
            one -= rate
        return None


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
    played = recorded_run(found.recording, facts, *_ended_simulated(found, setting))
    if log is not None:
        log.parent.mkdir(parents=True, exist_ok=True)
        why = f"seed {seed}, faults {setting.faults.text()}"
        copy_recording(found.recording, log, {"simulated": why})
        played.recording = log.name
    played.time = found.seconds
    played.seconds = time.monotonic() - began
    return played


def _ended_simulated(found: SimulatedRun, setting: RunSetting) -> tuple[str, str | None]:
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
