"""Schedules: cubes to be executed one per round, each move by its generator and its place.

As text, a schedule has the format of a cubes file, see docs/files.md. The recording of a run that
executed it holds it in this form.

Timetables: when each move begins and how long it takes, one move per line.

It touches only the files it is given, and knows nothing of scheduling.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TypeAlias

import msgspec

from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import Source, opened
from cubepath.protocol.core.parsing import check_keys
from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.path_files.durations import Number, duration_from, time_from
from cubepath.protocol.path_files.jsonl import decode_line, write_lines
from cubepath.protocol.path_files.moves import CubeLine, CubeName

Cubes: TypeAlias = tuple[tuple[GeneratorPlacement, ...], ...]
"""The cubes of a schedule; the first is for round 1."""
OwnMoves: TypeAlias = Mapping[int, GeneratorPlacement]
"""A module's own part of a schedule: by round, the move of which it is the mover."""

_encoder = msgspec.json.Encoder()
_decoder = msgspec.json.Decoder(CubeLine)


def schedule_to_jsonl(cubes: Iterable[Iterable[GeneratorPlacement]]) -> bytes:
    """Return a schedule as text, one cube per line."""
    return _encoder.encode_lines(CubeLine(list(cube)) for cube in cubes)


def schedule_from_jsonl(text: bytes) -> Cubes:
    """Read a schedule from text; InputError if a line is no cube of moves by generator."""
    try:
        lines = _decoder.decode_lines(text)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"no schedule: {error}") from None
    for number, line in enumerate(text.splitlines(), 1):
        try:
            check_keys(line)
        except InputError as error:
            raise InputError(f"no schedule: line {number}: {error}") from None
    return tuple(by_generator(number, line.moves) for number, line in enumerate(lines, 1))


def by_generator(number: int, moves: Iterable[CubeName]) -> tuple[GeneratorPlacement, ...]:
    """Return the moves of a cube; InputError if one is named by an id, or is at no site.

    `number` is the number of the cube, for the error.
    """
    found: list[GeneratorPlacement] = []
    for move in moves:
        if not isinstance(move, GeneratorPlacement):
            named = msgspec.json.encode(move).decode()
            raise InputError(
                f"cube {number}: move {named} is named by an id, expected generator and place:"
                " a module has to know what to do"
            )
        try:
            site_from_json(move.at)
        except InputError as error:
            raise InputError(f"cube {number}: {error}") from None
        found.append(move)
    return tuple(found)


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
