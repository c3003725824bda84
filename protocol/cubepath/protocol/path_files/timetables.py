"""Durations of moves as they come in, and timetables as they go out; see docs/certificates.md.

All times are exact: whole numbers and fractions. What has a decimal point is read as it is written,
never as a binary floating-point number.

Room: protocol. It touches the files that it is told to, and knows nothing of scheduling.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal, TypeAlias

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import Source, opened
from cubepath.protocol.core.json_keys import check_keys
from cubepath.protocol.core.names import GeneratorPlacement, Json
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.path_files.jsonl import decode_line, line_schema, write_lines
from cubepath.protocol.path_files.moves import CubeName, MoveName

FORMAT = "cubepath-durations-1"

Number: TypeAlias = int | str
"""A time in a file: a whole number, or text: ``"3/2"``, ``"1.5"``."""

_NUMBER = re.compile(r"(\d{1,18})(?:/(\d{1,18})|\.(\d{1,18}))?", re.ASCII)


@dataclass(frozen=True, slots=True)
class Durations:
    """How long moves take: each by its place, else by its generator or its id, else `default`.

    `named` goes by generators and by the text of ids, `placed` by generator and place.
    """

    default: Fraction = Fraction(1)
    named: Mapping[str, Fraction] = field(default_factory=dict[str, Fraction])
    placed: Mapping[tuple[str, Site], Fraction] = field(
        default_factory=dict[tuple[str, Site], Fraction]
    )

    def of(self, name: MoveName) -> Fraction:
        """Return how long a move takes that is written so."""
        if not isinstance(name, GeneratorPlacement):
            return self.named.get(str(name), self.default)
        by_name = self.named.get(name.generator, self.default)
        return self.placed.get(_place(name), by_name) if self.placed else by_name

    def is_placed(self, name: MoveName) -> bool:
        """Tell whether a duration is given for a move by its place."""
        return (
            bool(self.placed)
            and isinstance(name, GeneratorPlacement)
            and _place(name) in self.placed
        )

    def unused(self, names: Iterable[MoveName]) -> str | None:
        """Return the first duration that is of none of these moves, in words, else None."""
        known = list(names)
        used = {
            name.generator if isinstance(name, GeneratorPlacement) else str(name) for name in known
        }
        for text in self.named:
            if text not in used:
                return f"{text!r} is no generator and no id of a move"
        places = (
            {_place(name) for name in known if isinstance(name, GeneratorPlacement)}
            if self.placed
            else ()
        )
        for generator, at in self.placed:
            if (generator, at) not in places:
                return f"generator {generator!r} at {at!r} is no move"
        return None

    def with_named(self, named: Mapping[str, Fraction]) -> Durations:
        """Return these with other durations for some generators and ids."""
        return replace(self, named={**self.named, **named})


def _place(name: GeneratorPlacement) -> tuple[str, Site]:
    return name.generator, site_from_json(name.at)


def time_from(value: Number) -> Fraction:
    """Return a time from a whole number or text; InputError where it is none.

    >>> time_from(2), time_from("3/2"), time_from("0.25")
    (Fraction(2, 1), Fraction(3, 2), Fraction(1, 4))
    """
    text = str(value)
    found = _NUMBER.fullmatch(text)
    if found is None or (found[2] is not None and not int(found[2])):
        raise InputError(f"found the time {text[:40]!r}, expected a number such as 2, 1.5 or 3/2")
    return Fraction(text)


def time_text(time: Fraction) -> Number:
    """Return a time as files and answers have it: a whole number, or as text ``p/q``.

    >>> time_text(Fraction(4, 2)), time_text(Fraction(3, 2))
    (2, '3/2')
    """
    return time.numerator if time.denominator == 1 else str(time)


def duration_from(value: Number) -> Fraction:
    """Return a duration; InputError where it is no time, or not above 0."""
    found = time_from(value)
    if not found:
        raise InputError("found the duration 0, expected more than 0")
    return found


class _MoveEntry(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    generator: str
    at: Json
    duration: Number


class _File(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    format: Literal["cubepath-durations-1"]
    default: Number = 1
    generators: dict[str, Number] = {}
    ids: dict[str, Number] = {}
    moves: list[_MoveEntry] = []


def read_durations(path: Path) -> Durations:
    """Read durations from a TOML file, or a JSON file if its name ends so.

    InputError, with the file, where it cannot be read or something in it is no duration.
    """
    try:
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else None
        raise InputError(f"{path}: {reason or error}") from None
    try:
        return _durations(_parsed(text, as_json=path.suffix.lower() == ".json"))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _parsed(text: str, *, as_json: bool) -> _File:
    try:
        if as_json:
            found: Any = json.loads(text, parse_float=str, parse_constant=str)
            check_keys(text.encode(), where="line ")
        else:
            found = tomllib.loads(text, parse_float=str)
        return msgspec.convert(found, _File)
    except (ValueError, RecursionError) as error:  # that of msgspec and of both parsers is one
        raise InputError(f"no {FORMAT}: {error}") from None


def _durations(found: _File) -> Durations:
    def told(where: str, value: Number) -> Fraction:
        try:
            return duration_from(value)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None

    twice = [name for name in found.generators if name in found.ids]
    if twice:
        raise InputError(f"{twice[0]!r} is among the generators and the ids, expected one of them")
    placed: dict[tuple[str, Site], Fraction] = {}
    for entry in found.moves:
        key = entry.generator, site_from_json(entry.at)
        where = f"generator {entry.generator!r} at {entry.at}"
        if key in placed:
            raise InputError(f"{where} comes twice")
        placed[key] = told(where, entry.duration)
    named = {**found.generators, **found.ids}
    return Durations(
        told("default", found.default),
        {name: told(name, value) for name, value in named.items()},
        placed,
    )


class TimedLine(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A line of a timetable: when a move begins, how long it takes, and how it is written."""

    start: Number
    duration: Number
    move: CubeName


_line = msgspec.json.Decoder(TimedLine).decode


def read_timetable(source: Source) -> Iterator[TimedLine]:
    """Yield the lines of a timetable; InputError with file and line where one is none."""
    with opened(source) as file:
        for number, line in file.numbered_lines():
            try:
                found = decode_line(_line, line, 'the keys "start", "duration" and "move"')
                time_from(found.start)
                duration_from(found.duration)
            except InputError as error:
                raise InputError(f"{file.path}:{number}: {error}") from None
            yield found


def write_timetable(path: Path, lines: Iterable[TimedLine]) -> None:
    """Write a timetable; it is complete or as it was before. InputError where it cannot be."""
    write_lines(path, lines)


def timetable_schema() -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of a line of a timetable."""
    return line_schema(TimedLine)
