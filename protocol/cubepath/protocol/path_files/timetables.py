"""Timetables: when each move begins and how long it takes, one move per line.

It touches only the files it is given, and knows nothing of scheduling.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import Source, opened
from cubepath.protocol.path_files.durations import Number, duration_from, time_from
from cubepath.protocol.path_files.jsonl import decode_line, line_schema, write_lines
from cubepath.protocol.path_files.moves import CubeName


class TimedLine(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A line of a timetable: when a move begins, how long it takes, and how it is written."""

    start: Number
    duration: Number
    move: CubeName


_line = msgspec.json.Decoder(TimedLine).decode


def read_timetable(source: Source) -> Iterator[TimedLine]:
    """Yield the lines of a timetable; InputError, with file and line, at the first invalid one.

    >>> write_timetable("times.jsonl", [TimedLine(0, "3/2", "left")])
    >>> for line in read_timetable("times.jsonl"):
    ...     print(line.start, line.duration, line.move)
    0 3/2 left
    """
    with opened(source) as file:
        for number, line in file.numbered_lines():
            try:
                found = decode_line(_line, line, 'the keys "start", "duration" and "move"')
                time_from(found.start)
                duration_from(found.duration)
            except InputError as error:
                raise InputError(f"{file.path}:{number}: {error}") from None
            yield found


def write_timetable(path: Path | str, lines: Iterable[TimedLine]) -> None:
    """Write a timetable, complete or not at all; InputError if it cannot be written.

    >>> write_timetable("times.jsonl", [TimedLine(0, "3/2", "left"), TimedLine("3/2", 1, "right")])
    >>> [(each.start, each.move) for each in read_timetable("times.jsonl")]
    [(0, 'left'), ('3/2', 'right')]
    """
    write_lines(path, lines)


def timetable_schema() -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of a line of a timetable.

    >>> timetable_schema()["required"]
    ['start', 'duration', 'move']
    """
    return line_schema(TimedLine)
