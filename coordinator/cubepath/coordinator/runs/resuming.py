"""Taking up a run without rounds that was cut off: its recording, and the logs of its keepers.

While such a run goes on, the logs of its keepers are in a folder beside its recording; a run that
comes to its end takes the folder away, unless it failed.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

from cubepath.agents.free.fleet import ON_CRASH
from cubepath.agents.rules.rule_files import is_in_file, permitted_rule
from cubepath.coordinator.runs.plan import Plan, Task
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import file_within
from cubepath.protocol.core.output_files import locked_file, unwritable
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.wire.free_messages import FREE_KINDS

_LOCK = "lock"
"""The file in the folder of logs that is locked: no run writes to it."""
_LOCK_S_MAX, _POLL_S = 2.0, 0.05
"""So long the keepers of a run whose launcher was killed may take to end."""


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
    logs = file_within(path.parent, keeper_logs(path).name)
    if not logs.is_dir():
        if next(recording.of_kind("summary"), None) is not None:
            raise InputError(f"{path}: the run has come to its end, there is nothing to resume")
        raise _no_logs(logs)
    try:
        rule = permitted_rule(told["rule"], () if plan.rule is None else (plan.rule,))
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


def locked_logs(folder: Path) -> BinaryIO:
    """Lock the folder of keepers' logs for one run; InputError if another has them.

    The lock is on a file in the folder, and stays with it when the folder is renamed.
    """
    deadline = time.monotonic() + _LOCK_S_MAX
    path = folder / _LOCK
    while True:
        try:
            lock = locked_file(path)
            if path.exists() and os.path.samestat(os.fstat(lock.fileno()), path.stat()):
                return lock
            lock.close()  # a run that took it up had just renamed the folder
        except BlockingIOError:
            if time.monotonic() >= deadline:
                raise InputError(
                    f"{folder}: a run is writing there, expected it to end first"
                ) from None
            time.sleep(_POLL_S)
        except FileNotFoundError:
            raise _no_logs(folder) from None
        except OSError as error:
            raise unwritable(path, error) from None


def _no_logs(folder: Path) -> InputError:
    return InputError(f"{folder}: not there, expected the logs of the run's keepers")


def _speeds(told: Mapping[str, str]) -> dict[int, float]:
    pairs = [pair.partition("=") for pair in told["speeds"].split(",") if pair]
    return {int(module): float(factor) for module, _, factor in pairs}


def is_said(kind: str) -> bool:
    """Return whether a record of this kind was on the wire, and is not a result."""
    return kind in FREE_KINDS or kind == "refused"
