"""How long moves take; schedules, one cube per round; and timetables, one move per line.

Each move is named by its generator and its place. As text, a schedule has the format of a cubes
file, see docs/files.md. The recording of a run that executed a schedule holds it in this form. A
timetable says when each move begins and how long it takes.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal, TypeAlias, cast

import msgspec

from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError, errors_at
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.input_files import Source, opened
from cubepath.protocol.core.parsing import check_keys, parsed_toml
from cubepath.protocol.core.sites import Site, site_from_json, site_hook
from cubepath.protocol.path_files.moves import CubeLine, CubeName, MoveName, write_lines

FORMAT = "cubepath-durations-1"
Time: TypeAlias = Fraction | int
"""An exact time; whole numbers are added and compared much faster than fractions."""
Number: TypeAlias = int | str
"""A time in a file: an integer, or text such as ``"3/2"`` or ``"1.5"``."""

_NUMBER = re.compile(r"(\d{1,18})(?:/(\d{1,18})|\.(\d{1,18}))?", re.ASCII)


@dataclass(frozen=True, slots=True)
class Durations:
    """How long moves take: looked up by place, then by generator or id, then `default`.

    The keys of `named` are generators and ids as text; those of `placed` are generator and place.
    """

    default: Fraction = Fraction(1)
    named: Mapping[str, Fraction] = field(default_factory=dict[str, Fraction])
    placed: Mapping[tuple[str, Site], Fraction] = field(
        default_factory=dict[tuple[str, Site], Fraction]
    )

    def of(self, name: MoveName) -> Fraction:
        """Return the duration of the move with this name."""
        if not isinstance(name, GeneratorPlacement):
            return self.named.get(str(name), self.default)
        by_name = self.named.get(name.generator, self.default)
        return self.placed.get(_place(name), by_name) if self.placed else by_name

    def is_placed(self, name: MoveName) -> bool:
        """Return whether a move has a duration by its place."""
        return (
            bool(self.placed)
            and isinstance(name, GeneratorPlacement)
            and _place(name) in self.placed
        )

    def unused(self, names: Iterable[MoveName]) -> str | None:
        """Return a text on the first duration that none of these moves has, or None."""
        known = list(names)
        used = {
            name.generator if isinstance(name, GeneratorPlacement) else str(name) for name in known
        }
        for text in self.named:
            if text not in used:
                return f"{text!r}{did_you_mean(text, used)} is no generator and no id of a move"
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
        """Return these durations with others for some generators and ids."""
        return replace(self, named={**self.named, **named})


def _place(name: GeneratorPlacement) -> tuple[str, Site]:
    return name.generator, name.at


def time_from(value: Number) -> Fraction:
    """Return a time from an integer or text; InputError if it is none.

    >>> time_from(2), time_from("3/2"), time_from("0.25")
    (Fraction(2, 1), Fraction(3, 2), Fraction(1, 4))
    """
    text = str(value)
    found = _NUMBER.fullmatch(text)
    if found is None or (found[2] is not None and not int(found[2])):
        raise InputError(f"found the time {text[:40]!r}, expected a number such as 2, 1.5 or 3/2")
    return Fraction(text)


def time_text(time: Time) -> Number:
    """Return a time as files and answers write it: an integer, or a text ``p/q``.

    >>> time_text(Fraction(4, 2)), time_text(Fraction(3, 2))
    (2, '3/2')
    """
    return time.numerator if time.denominator == 1 else str(time)


def duration_from(value: Number) -> Fraction:
    """Return a duration; InputError if it is no time, or not above 0."""
    found = time_from(value)
    if not found:
        raise InputError("found the duration 0, expected more than 0")
    return found


def durations_in_words(texts: Iterable[str]) -> dict[str, Fraction]:
    """Return durations by name from texts ``NAME=TIME``; InputError says which is wrong, and why.

    >>> durations_in_words(["slide=3/2", "7=2"])
    {'slide': Fraction(3, 2), '7': Fraction(2, 1)}
    """
    found: dict[str, Fraction] = {}
    for text in texts:
        name, equals, time = text.rpartition("=")
        if not equals or not name:
            raise InputError(f"{text}: expected NAME=TIME, as in slide=3/2")
        if name in found:
            raise InputError(f"{text}: {name!r} has a duration already, expected one")
        with errors_at(text):
            found[name] = duration_from(time)
    return found


class _Placed(msgspec.Struct, forbid_unknown_fields=True):
    generator: str
    at: Any
    duration: Any


class _File(msgspec.Struct, forbid_unknown_fields=True):
    format: Literal["cubepath-durations-1"]
    default: Any = 1
    generators: dict[str, Any] = {}
    ids: dict[str, Any] = {}
    moves: list[_Placed] = []


def read_durations(source: Source) -> Durations:
    """Read durations from a TOML file, or from JSON if the file's name ends in ``.json``.

    Raises InputError, with the file and the key in it, if it cannot be read or a value is no
    duration.

    >>> from pathlib import Path
    >>> _ = Path("times.json").write_text('{"format": "cubepath-durations-1", "default": "3/2"}')
    >>> found = read_durations("times.json")
    >>> found.default
    Fraction(3, 2)
    """
    with opened(source) as file:
        text = file.text()
    try:
        is_json = file.path.suffix.lower() == ".json"
        found = _json(text) if is_json else parsed_toml(text, Decimal)
        return _durations(_file(found))
    except (InputError, msgspec.ValidationError) as error:
        raise InputError(f"{file.path}: {error}") from None


def _json(text: str) -> object:
    try:
        found: object = json.loads(text, parse_float=Decimal, parse_constant=Decimal)
    except RecursionError:
        raise InputError("lists in lists, nested too deeply") from None
    except ValueError as error:
        raise InputError(f"not JSON: {error}") from None
    check_keys(text.encode(), where="line ")
    return found


def _file(found: object) -> _File:
    if isinstance(found, dict):  # before the keys, most of which another kind of file lacks
        form = cast("dict[str, object]", found).get("format")
        if form != FORMAT:
            raise InputError(f"format: found {form!r:.40}, expected {FORMAT!r}")
    return msgspec.convert(found, _File)


def _durations(found: _File) -> Durations:
    named: dict[str, Fraction] = {}
    for kind, values in (("generators", found.generators), ("ids", found.ids)):
        for name, value in values.items():
            if name in named:
                raise InputError(
                    f"{name!r} is among the generators and the ids, expected one of them"
                )
            named[name] = _duration(value, f"{kind}.{name}")
    placed: dict[tuple[str, Site], Fraction] = {}
    for number, move in enumerate(found.moves, 1):
        with errors_at(f"moves {number}.at"):
            key = move.generator, site_from_json(_exact(move.at))
        if key in placed:
            where = f"moves {number}: generator {move.generator!r} at {move.at}"
            raise InputError(f"{where} comes twice")
        placed[key] = _duration(move.duration, f"moves {number}.duration")
    return Durations(_duration(found.default, "default"), named, placed)


def _duration(value: object, where: str) -> Fraction:
    if isinstance(value, bool) or not isinstance(value, int | str | Decimal):
        expected = "expected a number such as 2, 1.5 or 3/2"
        raise InputError(f"{where}: found {value!r}, {expected}")
    with errors_at(where):
        return duration_from(str(value))


def _exact(value: object) -> object:
    """Return a place with its decimals as floats."""
    if isinstance(value, list):
        return [_exact(each) for each in cast("list[object]", value)]
    return float(value) if isinstance(value, Decimal) else value


Cubes: TypeAlias = tuple[tuple[GeneratorPlacement, ...], ...]
"""The cubes of a schedule; the first is for round 1."""
OwnMoves: TypeAlias = Mapping[int, GeneratorPlacement]
"""A module's own part of a schedule: by round, the move of which it is the mover."""

_encoder = msgspec.json.Encoder()
_decoder = msgspec.json.Decoder(CubeLine, dec_hook=site_hook)


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
        with errors_at(f"no schedule: line {number}"):
            check_keys(line)
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
        found.append(move)
    return tuple(found)


class TimedLine(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A line of a timetable: when a move begins, how long it takes, and how it is written."""

    start: Number
    duration: Number
    move: CubeName


def write_timetable(path: Path | str, lines: Iterable[TimedLine]) -> None:
    """Write a timetable, complete or not at all; InputError if it cannot be written.

    >>> write_timetable("times.jsonl", [TimedLine(0, "3/2", "left"), TimedLine("3/2", 1, "right")])
    >>> print(Path("times.jsonl").read_text().splitlines()[1])
    {"start":"3/2","duration":1,"move":"right"}
    """
    write_lines(path, lines)
