"""Whether the parameters of a recording are those of a run, and fit its scene.

Room: coordinator. Part of `cubepath verify`. A parameter that is missing is not held against a
recording: those written by other programs have fewer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from cubepath.coordinator.verification.transcript import Fail
from cubepath.protocol.recordings.recording import Recording

CHECK = "parameters"


def check_parameters(recording: Recording, fail: Fail) -> None:
    """Check each parameter that is there: its form, and what the scene says of it."""
    told, scene = recording.parameters, recording.scene
    modules = len(scene.start)

    def wrong(key: str, expected: str) -> None:
        fail(CHECK, f"{key}={told.get(key)!r}: expected {expected}")

    for key in ("seed", "max_rounds", "processes", "modules", "keepers"):
        if key in told and _number(told[key]) is None:
            wrong(key, "a whole number of at least 0")
    if "hesitate" in told and hesitation_in(told) is None:
        wrong("hesitate", "at least 0 and less than 1")
    if _number(told.get("modules", "")) not in (None, modules):
        wrong("modules", f"{modules}, which start in the scene")
    if (_number(told.get("processes", "")) or 0) > modules:
        wrong("processes", f"at most {modules}, one for each module")
    for key, value in (("system", scene.spec), ("family", scene.family)):
        if told.get(key, value) != value:
            wrong(key, f"{value!r}, as in the scene")
    _check_clock(recording, wrong)
    _check_schedule(recording, wrong)


def _check_clock(recording: Recording, wrong: Callable[[str, str], None]) -> None:
    told = recording.parameters
    if told.get("clock", "lockstep") != recording.clock:
        wrong("clock", f"{recording.clock!r}, as {recording.format} has it")
    if recording.clock == "free" and keepers_of(recording) is None:
        wrong("keepers", "how many there were")
    logical = "level" if recording.clock == "free" else "round"
    if told.get("log_time", logical) not in (logical, "wall"):
        wrong("log_time", f"'{logical}' or 'wall'")


def _check_schedule(recording: Recording, wrong: Callable[[str, str], None]) -> None:
    told = recording.parameters
    if recording.schedule is not None and told.get("rule", "schedule") != "schedule":
        wrong("rule", "'schedule', since there is one on record")
    if "repair" in told and "schedule" not in told:
        wrong("repair", "none, since there is no schedule that it could go on after")
    if "schedule" in told and hesitation_in(told):
        wrong("hesitate", "0, since a schedule has a round for every cube")


def _number(text: str) -> int | None:
    """Return a whole number of at least 0 as it is written, None if it is none."""
    if not (text.isascii() and text.isdigit()) or (text[0] == "0" and text != "0"):
        return None
    try:
        return int(text)
    except ValueError:  # Python reads no number of thousands of digits
        return None


def seed_in(parameters: Mapping[str, str]) -> int | None:
    """Return the seed of a run; None if it is missing or malformed."""
    return _number(parameters.get("seed", ""))


def max_rounds_in(parameters: Mapping[str, str]) -> int | None:
    """Return after how many rounds a run ends; None if it is missing or malformed."""
    return _number(parameters.get("max_rounds", ""))


def processes_of(recording: Recording) -> int | None:
    """Return the number of processes, 1 for modules in a thread; None if it is not known."""
    found = _number(recording.parameters.get("processes", ""))
    return None if found is None or found > len(recording.scene.start) else max(found, 1)


def keepers_of(recording: Recording) -> int | None:
    """Return the number of keepers; None if it is missing or malformed."""
    return _number(recording.parameters.get("keepers", "")) or None


def hesitation_in(parameters: Mapping[str, str]) -> float | None:
    """Return the probability that a module makes no claim; None if it is missing or malformed."""
    try:
        found = float(parameters["hesitate"])
    except (KeyError, ValueError):
        return None
    return found if 0.0 <= found < 1.0 else None
