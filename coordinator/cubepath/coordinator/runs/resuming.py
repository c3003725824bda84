"""Taking up a run without rounds that was cut off: its recording, and the logs of its keepers.

Room: coordinator. While such a run goes on, the logs of its keepers are in a folder beside its
recording; a run that comes to its end takes the folder away, unless it failed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from cubepath.agents.free.fleet import ON_CRASH
from cubepath.agents.rules.rule_files import is_in_file, permitted_rule
from cubepath.coordinator.runs.plan import Plan, Task
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.wire.free_messages import FREE_KINDS


def keeper_logs(recording: Path) -> Path:
    """Return the folder of the keepers' logs of a run with this recording."""
    return recording.with_name(recording.name + ".keepers")


def resumed(plan: Plan, path: Path) -> tuple[Plan, Task, Recording]:
    """Return plan and task of the run in a recording, and the recording.

    InputError if its keepers' logs are not there: a run that did not fail takes them away.
    """
    given = {
        "system": plan.system,
        "schedule": plan.schedule,
        "speed": plan.speeds,
    }
    for key, value in given.items():
        if value:
            raise InputError(f"{key}: the run that is resumed has its own")
    recording = read_recording(path)
    told = recording.parameters
    if recording.clock != "free":
        raise InputError(f"{path}: a run in rounds, expected one without (clock=free)")
    if "schedule" in told:
        raise InputError(f"{path}: a run of a schedule, expected one of a rule")
    logs = keeper_logs(path)
    if not logs.is_dir():
        if next(recording.of_kind("summary"), None) is not None:
            raise InputError(f"{path}: the run has come to its end, there is nothing to resume")
        raise InputError(f"{logs}: not there, expected the logs of the run's keepers")
    try:
        rule = permitted_rule(told["rule"], plan.rule)
        if plan.rule is not None and not is_in_file(rule):
            raise InputError("rule: the run that is resumed has its own")
        again = replace(
            plan,
            clock="free",
            seed=int(told["seed"]),
            hesitate=float(told["hesitate"]),
            processes=int(told["processes"]),
            keepers=int(told["keepers"]),
            speeds=_speeds(told),
            jitter=float(told["jitter"]),
            on_crash=next(each for each in ON_CRASH if each == told["on_crash"]),
            log_time="wall" if told["log_time"] == "wall" else "level",
        )
        most = int(told["max_rounds"]) if plan.max_rounds is None else plan.max_rounds
        return again, Task(recording.scene, rule, most), recording
    except (KeyError, ValueError, StopIteration) as error:
        raise InputError(f"{path}: its parameters are not those of a run: {error!r}") from None


def _speeds(told: Mapping[str, str]) -> dict[int, float]:
    pairs = [pair.partition("=") for pair in told["speeds"].split(",") if pair]
    return {int(module): float(factor) for module, _, factor in pairs}


def is_said(kind: str) -> bool:
    """Return whether a record of this kind was on the wire, and is not a result."""
    return kind in FREE_KINDS or kind == "refused"
