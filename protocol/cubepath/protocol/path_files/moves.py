"""Moves files and cubes files: the path of another planner as input, and its cubes as output.

Both are JSON Lines, read as a stream and refused with file, line and reason; see docs/files.md. A
moves file has one move per line, all in one of two forms: ``{"generator", "at"}`` for a system, or
self-contained ``{"id", "support", "trace", "before", "after"}``. A cubes file has one cube per
line, ``{"moves": [...]}``.
"""

from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, TypeVar

import msgspec

from cubepath.protocol.core.actions import Action, apply_in_place, end_at
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import Source, opened
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.core.parsing import check_keys
from cubepath.protocol.core.sites import Site, in_order, site_from_json, site_hook
from cubepath.protocol.core.system import Scene

_Line = TypeVar("_Line")
_encode = msgspec.json.Encoder().encode


def decode_line(
    decode: Callable[[bytes], _Line],
    line: bytes,
    keys: str,
    least: Callable[[_Line], int] = lambda _: 1,
) -> _Line:
    """Return a decoded line; InputError says what was found and the expected `keys`.

    `least` returns how many keys a line with this content has at least, see `check_keys`.
    """
    try:
        found = decode(line)
        check_keys(line, least(found))
    except msgspec.ValidationError as error:
        raise InputError(f"{error}; a line has {keys}") from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"found no whole JSON object, expected one a line: {error}") from None
    return found


def write_lines(path: Path | str, lines: Iterable[object]) -> None:
    """Write one JSON document per line; afterwards the file is complete, or unchanged.

    Raises InputError if it cannot be written; other errors of `lines` propagate, see
    `written_whole`.
    """
    with written_whole(path) as stream:
        for line in lines:
            stream.write(_encode(line) + b"\n")


MoveName: TypeAlias = str | int | GeneratorPlacement
"""How a move is written: its id, or its generator and where that is placed."""


class NumberedId(NamedTuple):
    """An id that moves with different contents have, and which of the input's moves is meant."""

    id: str | int
    move: int
    """Counted from 1."""


CubeName: TypeAlias = MoveName | NumberedId
"""How a move is written in a cubes file: as in its input, with its number where that is not enough.
"""

# Part of the extra site that stands for the name of a move of which only support and trace are
# known. No file has a reason to name a site like this; if one did, some moves would merely not
# commute.
NAME = "\0id"


class GeneratorLine(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A move as a generator of the system, and where it is placed."""

    generator: str
    at: Site


class ContentsLine(msgspec.Struct, forbid_unknown_fields=True, frozen=True, omit_defaults=True):
    """A move by its contents; `before` and `after` are the sites of the support that are on.

    Where these two are left out, only commuting is known and the id names the action.
    """

    id: str | int
    support: list[Any]
    trace: list[Any]
    before: list[Any] | None = None
    after: list[Any] | None = None


class CubeLine(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A cube: the moves that can be executed at one time.

    An id that several contents have in the input stands with the number of the move: [id, number].
    """

    moves: list[CubeName]


@dataclass(frozen=True, slots=True)
class PathMove:
    """One move of a path: its action, its name, and the local state that it was made from.

    `before` holds the sites of the support that were on, or is None if the file does not say. An id
    is also the label of the action, as JSON text.
    """

    action: Action
    name: MoveName
    before: frozenset[Site] | None = None


def read_moves(source: Source, scene: Scene | None = None) -> Iterator[PathMove]:
    """Yield the moves of a moves file in order, each as soon as its line is read and checked.

    Moves are checked as far as possible: each must be admissible (one of its two local states
    shown) at the known part of the state. With a scene, that is the whole state, from its start on;
    without one, the first move with a site in its support tells, by `before`, whether the site is
    on. After a move without `before` and `after`, its trace is unknown again.

    Such a move becomes an action with its id as an extra site in support and trace, which the move
    turns on or off. So it equals only moves with the same id, support and trace, and commutes as
    support and trace imply; its local states mean nothing.

    Raises InputError, as ``FILE:LINE: what was found, what was expected``, at the first line that
    is no move, or no admissible one. Empty lines, CRLF and a byte order mark are accepted, and an
    empty file is a path without moves.

    >>> done = convert("logs/golden/hex-5.mcap", "five.jsonl")
    >>> for move in read_moves("five.jsonl", scene_from_spec("hex:n=5")):
    ...     pass
    >>> move.name.generator, sorted(move.before)
    ('pivot-2-left', [(4, 3), (5, 3)])
    """
    reader = _Reader(scene)
    with opened(source) as file:
        for number, line in file.numbered_lines():
            try:
                move = reader.move(number, line)
            except InputError as error:
                raise InputError(f"{file.path}:{number}: {error}") from None
            except RecursionError:
                where = f"{file.path}:{number}"
                raise InputError(f"{where}: lists in lists, nested too deeply") from None
            yield move


def named_action(name: str | int, support: Iterable[Site], trace: Iterable[Site]) -> Action:
    """Return the action of a move of which only support and trace are known; see `read_moves`."""
    site = (NAME, name)
    label = _encode(name).decode()
    return Action([*support, site], [*trace, site], (), (site,), label=label)


def known_of_named(name: MoveName, sites: Iterable[Site]) -> frozenset[Site]:
    """Return the sites of a `named_action` without the one that stands for its name."""
    return frozenset(sites) - {(NAME, name)}


def read_cubes(source: Source) -> Iterator[tuple[CubeName, ...]]:
    """Yield the cubes of a cubes file, each as the names of its moves; errors as in `read_moves`.

    Whether their moves commute is not checked: names alone do not tell.

    >>> write_cubes("two.jsonl", [["a", "b"], ["c"]])
    >>> list(read_cubes("two.jsonl"))
    [('a', 'b'), ('c',)]
    """
    with opened(source) as file:
        for number, line in file.numbered_lines():
            try:
                yield tuple(decode_line(_cube, line, 'the key "moves"', keys_of_cube).moves)
            except InputError as error:
                raise InputError(f"{file.path}:{number}: {error}") from None


def write_cubes(path: Path | str, cubes: Iterable[Iterable[CubeName]]) -> None:
    """Write a cubes file, complete or not at all; InputError if it cannot be written.

    >>> write_cubes("cubes.jsonl", shorten(play("hex:n=4")).named)
    >>> cubes = list(read_cubes("cubes.jsonl"))
    >>> len(cubes), cubes[0][0].generator
    (14, 'pivot-2-right')
    """
    write_lines(path, (CubeLine(list(cube)) for cube in cubes))


class _Form(NamedTuple):
    """A kind of line: its decoder, and its keys for error messages."""

    decode: Callable[[bytes], GeneratorPlacement | ContentsLine]
    keys: str


_generator = msgspec.json.Decoder(GeneratorLine, dec_hook=site_hook).decode


def placement_in(line: bytes) -> GeneratorPlacement:
    """Return the move that a line names by its generator; msgspec's errors if it does not.

    In a moves file other keys are refused; messages and cubes may have them.
    """
    found = _generator(line)
    return GeneratorPlacement(found.generator, found.at)


_GENERATOR = _Form(placement_in, 'the keys "generator" and "at"')
_CONTENTS = _Form(
    msgspec.json.Decoder(ContentsLine).decode,
    'the keys "id", "support", "trace", and "before" with "after" or neither',
)
_cube = msgspec.json.Decoder(CubeLine, dec_hook=site_hook).decode


def keys_of_cube(line: CubeLine) -> int:
    """Return the least number of keys of a line with this cube."""
    return 1 + 2 * sum(isinstance(move, GeneratorPlacement) for move in line.moves)


def _keys_of(line: GeneratorPlacement | ContentsLine) -> int:
    if isinstance(line, GeneratorPlacement):
        return 2
    return 3 + (line.before is not None) + (line.after is not None)


def _form_of(line: bytes) -> _Form | None:
    """Return the form that the keys of a line suggest; None if it is no object."""
    try:
        found = msgspec.json.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    if not isinstance(found, dict):
        return None
    return _GENERATOR if "generator" in found or "at" in found else _CONTENTS


def is_by_generator(line: bytes) -> bool:
    """Return whether a line has a key that only a move by its generator has."""
    return _form_of(line) is _GENERATOR


class _Reader:
    """The memory of reading one file: its form, its ids, its sites, and the state so far."""

    def __init__(self, scene: Scene | None) -> None:
        self._scene = scene
        self._form: _Form | None = None
        self._known = _Known(None if scene is None else scene.start_state)
        self._sites = _Sites()
        self._placed: dict[tuple[str, Site], Action] = {}
        # By the sites as a line lists them: building an action costs more than everything else.
        self._contents: dict[tuple[tuple[Site, ...], ...], Action] = {}
        # By id: the line where it came first, and the action if the id names one.
        self._first: dict[str | int, int] = {}
        self._named: dict[str | int, Action] = {}

    def move(self, number: int, line: bytes) -> PathMove:
        found = self._read(line)
        if isinstance(found, GeneratorPlacement):
            return self._by_generator(found)
        self._sites.watch(line)
        if (found.before is None) != (found.after is None):
            given, left_out = ("before", "after") if found.after is None else ("after", "before")
            raise InputError(f'found "{given}" without "{left_out}", expected both or neither')
        if not found.trace:
            raise InputError("the trace is empty, a move changes something")
        if found.before is None or found.after is None:
            return self._by_name(found, number)
        return self._by_contents(found, found.before, found.after, number)

    def _read(self, line: bytes) -> GeneratorPlacement | ContentsLine:
        if self._form is None:
            # The first line decides. If it is no object, the error describes both forms.
            self._form = _form_of(line)
        if self._form is None:
            keys = f"{_GENERATOR.keys}, or {_CONTENTS.keys}"
            decode_line(msgspec.json.decode, line, keys)  # a line that is cut off is no JSON
            return decode_line(_CONTENTS.decode, line, keys)
        try:
            return decode_line(self._form.decode, line, self._form.keys, _keys_of)
        except InputError:
            form = _form_of(line)
            if form is None or form is self._form:
                raise
        raise InputError(
            f"a line with {form.keys}, where those before have {self._form.keys}:"
            " expected one form in a file"
        )

    def _by_generator(self, line: GeneratorPlacement) -> PathMove:
        if self._scene is None:
            raise InputError(
                f"generator {line.generator!r} without a system, expected --system SYSTEM"
                ' (or moves with "id", "support" and "trace")'
            )
        key = line.generator, line.at
        action = self._placed.get(key)
        if action is None:
            action = self._placed[key] = self._scene.system.action(*key)
        before = action.support & self._known.on
        apply_in_place(action, self._known.on)
        return PathMove(action, line, before)

    def _by_name(self, line: ContentsLine, number: int) -> PathMove:
        trace = self._sites.read(line.trace)
        action = named_action(line.id, self._sites.read(line.support), trace)
        label = action.label
        first = self._first.setdefault(line.id, number)
        if first == number:
            self._named[line.id] = action
        known = self._named.get(line.id)
        if known is None:
            raise InputError(
                f'id {label} has "before" and "after" in line {first}, but not here:'
                " expected another id, for here it names the action"
            )
        if known != action:
            what = "trace" if known.support == action.support else "support"
            raise InputError(
                f"id {label} has another {what} in line {first}, expected the same:"
                ' without "before" and "after" the id names the action'
            )
        self._known.forget(trace)
        return PathMove(known, line.id)

    def _by_contents(
        self, line: ContentsLine, before: list[Any], after: list[Any], number: int
    ) -> PathMove:
        read = self._sites.read
        label = _encode(line.id).decode()
        parts = [tuple(read(sites)) for sites in (line.support, line.trace, before, after)]
        known = self._contents.get(key := tuple(parts))
        if known is None:
            known = self._contents[key] = Action(*parts, label=label)
        action = known if known.label == label else known.labelled(label)
        first = self._first.setdefault(line.id, number)
        if line.id in self._named:
            raise InputError(
                f'id {label} has no "before" and "after" in line {first}, where it names the'
                " action: expected another id"
            )
        shown = frozenset(parts[2])
        self._known.learn(action.support, shown)
        state = self._known.on
        end = end_at(action, state)
        if end is None:
            # Described relative to the local state that the line starts from, as a planner reads
            # it.
            site = in_order((action.support & state) ^ shown)[0]
            found, expected = ("on", "off") if site in state else ("off", "on")
            text = _encode(site).decode()
            raise InputError(
                f"move {label} is not admissible: site {text} is {found}, expected {expected}"
            )
        apply_in_place(action, self._known.on)
        return PathMove(action, line.id, action.ends[end])


class _Known:
    """What is known of a state: all of it from a start on, or what moves have shown."""

    def __init__(self, start: Iterable[Site] | None) -> None:
        self.on: set[Site] = set(start or ())
        self._whole = start is not None
        # The exceptions: unknown sites if the whole state was known at the start, else known sites.
        self._odd: set[Site] = set()

    def learn(self, support: Iterable[Site], shown: Collection[Site]) -> None:
        """Learn the sites of a support that are not known yet; those in `shown` are on."""
        if self._whole and not self._odd:
            return
        for site in support:
            if (site in self._odd) is self._whole:
                self._odd ^= {site}
                (self.on.add if site in shown else self.on.discard)(site)

    def forget(self, sites: Iterable[Site]) -> None:
        """Forget the state of these sites."""
        if self._whole:
            self._odd.update(sites)
        else:
            self._odd.difference_update(sites)


class _Sites:
    """The sites of a file, each kept once."""

    def __init__(self) -> None:
        self._kept: dict[Site, Site] = {}
        self._booleans = False

    def watch(self, line: bytes) -> None:
        """Note whether this line may have booleans, which are no sites but equal some in Python."""
        self._booleans = b"true" in line or b"false" in line

    def read(self, values: Iterable[Any]) -> list[Site]:
        """Return the sites; InputError if one is invalid."""
        return [self._seen(value) or self._new(value) for value in values]

    def _seen(self, value: Any) -> Site | None:
        # Most sites recur, and most are flat: then this is their whole cost.
        if self._booleans:
            return None
        try:
            return self._kept.get(tuple(value) if isinstance(value, list) else value)
        except TypeError:  # a list in a list
            return None

    def _new(self, value: Any) -> Site:
        site = site_from_json(value)
        return self._kept.setdefault(site, site)
