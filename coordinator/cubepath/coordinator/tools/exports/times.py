"""Log times for the time lines of other tools: rounds that last some time, or the wall clock."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from typing import Literal, TypeAlias

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.records import Record
from cubepath.protocol.wire.free_messages import Moved, Tail, decode_free

LogTime: TypeAlias = Literal["round", "level", "wall"]
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class ExportTimes:
    """How log times are made: from rounds or levels, each `round_ns` nanoseconds, or `by_wall`."""

    by_wall: bool
    round_ns: int

    def at(self, number: int, wall_ns: int) -> int:
        """Return the log time of a round or level, and of a wall time, in nanoseconds.

        InputError if it has more than 63 bits.
        """
        found = wall_ns if self.by_wall else number * self.round_ns
        if not 0 <= found < 1 << 63:
            raise InputError(f"log time {found}: expected less than 2^63 nanoseconds")
        return found


def times_of(
    recording: Recording, log_time: LogTime | None, round_seconds: float | None
) -> ExportTimes:
    """Return how log times are made; by default from rounds, or without rounds from levels.

    InputError if the run has none of what is asked for, or a round lasts no time.
    """
    logical = "level" if recording.clock == "free" else "round"
    if log_time not in (None, logical, "wall"):
        raise InputError(f"{recording.path}: log time {log_time!r}, expected '{logical}' or 'wall'")
    if log_time == "wall" and round_seconds is not None:
        raise InputError(
            f"a round of {round_seconds:g} s: by the wall clock a round lasts as long as it took,"
            f" expected log time '{logical}'"
        )
    round_seconds = 1.0 if round_seconds is None else round_seconds
    if not (isfinite(round_seconds) and round_seconds * _NS >= 1):
        raise InputError(f"a round of {round_seconds:g} s: expected at least 1e-09 s")
    return ExportTimes(log_time == "wall", round(round_seconds * _NS))


def numbered(recording: Recording) -> Iterator[tuple[int, Record]]:
    """Yield the messages in the order of writing, each with its round or the greatest level so far.

    InputError if a commit cannot be decoded.
    """
    if recording.clock != "free" or recording.parameters.get("log_time") != "wall":
        for record in recording.written():
            yield record.round, record
        return
    level = 0
    for record in recording.written():
        if record.kind in ("moved", "tail"):
            level = max([level, *_levels(recording, record)])
        yield level, record


def _levels(recording: Recording, record: Record) -> list[int]:
    try:
        said: msgspec.Struct = decode_free(record.data)
    except InputError as error:
        where = f"{recording.path}: message {record.sequence} ({record.topic})"
        raise InputError(f"{where}: {error}") from None
    told = said.parts if isinstance(said, Tail) else [said] if isinstance(said, Moved) else []
    return [moved.level for moved in told]
