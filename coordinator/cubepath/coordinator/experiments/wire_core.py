"""Runs over the wire: real processes, real messages, a recording."""

from __future__ import annotations

import shutil
import tempfile
import time
from pathlib import Path

from cubepath.coordinator.experiments.facts import SceneFacts
from cubepath.coordinator.experiments.gathered_runs import recorded_run
from cubepath.coordinator.experiments.outcomes import ERROR, GAVE_UP, GOAL, MAX_ROUNDS, PlayedRun
from cubepath.coordinator.experiments.setting import RunSetting, thinking
from cubepath.coordinator.runs.launch import run
from cubepath.coordinator.runs.outcome import Outcome
from cubepath.coordinator.runs.plan import Plan
from cubepath.protocol.recordings.recording import read_recording

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
