"""Whether what is asked of a comparison is of use for the two that are compared.

What would be passed over is refused in one line.
"""

from __future__ import annotations

from cubepath.coordinator.tools.comparison.lockstep import Asked, SideBySide
from cubepath.coordinator.tools.comparison.reading import Reading
from cubepath.coordinator.verification.round_spans import rounds_text
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import InputFile
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import KINDS

COMPARED_KINDS = ("here", "note", "claim", "verdict", "report", "edges", "cube", "summary")
"""The kinds of messages that are compared, in the order of a round and then of the end."""


def _range(asked: Asked) -> str:
    """Return the rounds that are asked for, as on the command line."""
    return f"{asked.first}..{'' if asked.last is None else asked.last}"


def check_asked(asked: Asked) -> None:
    """Check what is asked by itself; InputError."""
    if asked.context < 0:
        raise InputError(f"context={asked.context}: expected 0 or more")
    if asked.first < 1 or (asked.last is not None and asked.last < asked.first):
        raise InputError(f"rounds={_range(asked)}: expected 1 or more, up")


def check_use(
    a: Recording | InputFile, b: Recording | InputFile, asked: Asked, system: str | None
) -> None:
    """Refuse what would make no difference for these two; InputError."""
    recordings = [each for each in (a, b) if isinstance(each, Recording)]
    if system is not None and len(recordings) == 2:
        raise InputError(
            f"system={system}: {a.path} and {b.path} are recordings, which say themselves what"
            " their system is: expected no system"
        )
    free = next((each for each in recordings if each.clock == "free"), None)
    moves = next((each for each in (a, b) if not isinstance(each, Recording)), None)
    why = None
    if moves is not None:
        why = f"{moves.path} is no recording, so the moves alone are compared"
    elif free is not None:
        why = f"{free.path} is a run without rounds"
    if why is not None and asked.limited:
        raise InputError(f"rounds={_range(asked)}: {why}: expected no rounds")
    if why is not None and asked.context:
        raise InputError(f"context={asked.context}: {why}: expected no context")
    known = {"format", *(name for each in recordings for name in each.parameters)}
    for name in sorted(asked.ignored):
        if moves is not None:
            raise InputError(f"ignore={name}: {why}: expected nothing to ignore")
        if name in COMPARED_KINDS and why is not None:
            raise InputError(f"ignore={name}: {why}: expected a parameter")
        if name not in COMPARED_KINDS and name not in known:
            what = "messages of this kind are not compared" if name in KINDS else "neither has that"
            raise InputError(
                f"ignore={name}: {what}, expected a parameter ({', '.join(sorted(known))}) or a"
                f" kind of message ({', '.join(COMPARED_KINDS)})"
            )


def check_compared(side_by_side: SideBySide, asked: Asked) -> None:
    """Refuse two runs of which no round could be compared; InputError, OutOfOrder as for `go`.

    A run that ended before its first round has nothing that could differ, and is compared.
    """
    readings = side_by_side.readings
    none = any(reading.ended and not reading.spans for reading in readings)
    if side_by_side.found.compared or (none and not asked.limited):
        return
    side_by_side.read_on()
    told = [f"{reading.recording.path} has {_whole_rounds(reading)}" for reading in readings]
    where = f"rounds={_range(asked)}: " if asked.limited else ""
    raise InputError(f"{where}nothing to compare: {'; '.join(told)}")


def _whole_rounds(reading: Reading) -> str:
    """Return in words which rounds a run has."""
    if reading.spans:
        return rounds_text(reading.spans)
    why = [] if reading.cut is None else [reading.cut]
    why += [f"damaged: {problem}" for problem in reading.recording.problems[:1]]
    return ": ".join(["no round that all modules report", *why])
