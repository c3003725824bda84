"""A path as numbers: each distinct action once, and for every move the number of its action.

This is how a path of a million moves is read. A line by generator that was seen before
costs one lookup in a dict. Self-contained lines are read straight into arrays; each action of
theirs is built when it is asked for.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import islice
from typing import Any, BinaryIO, overload

import msgspec
import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.garbage import collector_paused
from cubepath.protocol.core.input_files import BYTE_ORDER_MARK, InputFile, Source, opened
from cubepath.protocol.core.parsing import check_keys
from cubepath.protocol.core.sites import Ordinals, Site, site_from_json
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.path_files.moves import (
    NAME,
    CubeName,
    MoveName,
    NumberedId,
    PathMove,
    is_by_generator,
    placement_in,
)
from cubepath.protocol.path_files.supports import GrowingRows, Supports, TabledActions, supports_of

Progress = Callable[[int], object]
"""Called from time to time with the number of moves read since the last call."""

PORTION = 1000
"""Number of moves that are read, or written, at a time."""

_KEPT = 1 << 20
_LEFT_OUT = msgspec.Raw()
_NUL = b"\\u0000"
_encode = msgspec.json.Encoder().encode


class _EachAction(Sequence[Action]):
    """The action of each move of a path, taken from the table when it is asked for."""

    def __init__(self, table: Sequence[Action], numbers: NDArray[np.int32]) -> None:
        """Take the table of actions, and for each move its place there."""
        self._table = table
        self._numbers = numbers

    def __len__(self) -> int:
        return len(self._numbers)

    @overload
    def __getitem__(self, index: int) -> Action: ...
    @overload
    def __getitem__(self, index: slice) -> list[Action]: ...
    def __getitem__(self, index: int | slice) -> Action | list[Action]:
        if isinstance(index, slice):
            return [self._table[number] for number in self._numbers[index].tolist()]
        return self._table[int(self._numbers[index])]

    def __iter__(self) -> Iterator[Action]:
        return (self._table[number] for number in self._numbers.tolist())


@dataclass(frozen=True, eq=False)
class NumberedPath:
    """A path of moves whose actions are numbers.

    `numbers` has shape (moves,), int32: for each move its place in `actions`, which are distinct.
    `action_names` holds the name of each of these; `names`, if given, the name of each move. `ends`
    has shape (moves,), int8: the local state, 0 or 1, that the file says the move starts from, and
    -1 if it does not say. `stated` tells for each action whether its local states are known; if
    not, only support and trace are, and it is a `cubepath.protocol.path_files.moves.named_action`.
    `table` holds what the actions do to sites, if that is known already. Where a path was read
    straight into arrays, each of `actions` is built when it is first asked for.
    """

    actions: Sequence[Action]
    action_names: list[MoveName]
    stated: list[bool]
    numbers: NDArray[np.int32]
    ends: NDArray[np.int8]
    names: list[MoveName] | None = None
    table: Supports | None = None

    @cached_property
    def supports(self) -> Supports:
        """What the actions do to sites, as arrays."""
        return supports_of(self.actions, self.stated) if self.table is None else self.table

    @property
    def each_action(self) -> Sequence[Action]:
        """The action of each move, in order."""
        return _EachAction(self.actions, self.numbers)

    def name(self, move: int) -> MoveName:
        """Return the name of a move."""
        if self.names is not None:
            return self.names[move]
        return self.action_names[int(self.numbers[move])]

    def cube_names(
        self, moves: NDArray[np.int64], places: NDArray[np.int64] | None = None
    ) -> list[CubeName]:
        """Return the names of these moves for a cubes file, which tell different contents apart.

        If moves with different contents share an id, the name includes the number of the move in
        its input. `places` are the places in the input, if this path is only part of it.
        """
        given = self.names
        if given is None:
            names: list[CubeName] = [self.name(move) for move in moves.tolist()]
        else:
            names = [given[move] for move in moves.tolist()]
        shared = self._shared_ids()
        if shared:
            numbers = (moves if places is None else places).tolist()
            for place, name in enumerate(names):
                if isinstance(name, str | int) and name in shared:
                    names[place] = NumberedId(name, numbers[place] + 1)
        return names

    def _shared_ids(self) -> set[str | int]:
        """Return the ids that moves with different contents share."""
        names, numbers = self.names, self.numbers.tolist()
        if names is None:
            names, numbers = self.action_names, list(range(len(self.actions)))
        if not set(map(type, names)) <= {str, int}:
            by_id = [
                pair for pair in zip(names, numbers, strict=True) if isinstance(pair[0], str | int)
            ]
            names, numbers = [name for name, _ in by_id], [number for _, number in by_id]
        if len(set(names)) == len(names):
            return set()
        last = dict(zip(names, numbers, strict=True))
        return {
            name
            for name, number in zip(names, numbers, strict=True)
            if last[name] != number and isinstance(name, str | int)
        }

    def move(self, place: int) -> PathMove:
        """Return the move at a place, from 0; an id is also its action's label, as JSON text."""
        return self._move(int(self.numbers[place]), int(self.ends[place]), self.name(place))

    def moves(self) -> Iterator[PathMove]:
        """Yield the moves one by one, as `move` returns them."""
        pairs = zip(self.numbers.tolist(), self.ends.tolist(), strict=True)
        return (self._move(*pair, self.name(place)) for place, pair in enumerate(pairs))

    def _move(self, number: int, end: int, name: MoveName) -> PathMove:
        action = self.actions[number]
        if not isinstance(name, GeneratorPlacement):
            label = _encode(name).decode()
            if label != action.label:
                action = action.labelled(label)
        return PathMove(action, name, action.ends[end] if end >= 0 else None)

    def stated_start(self) -> frozenset[Site] | None:
        """Return what is on at the start, as the first move with each site in its support found it.

        None if some move does not say what it starts from.
        """
        if (self.ends < 0).any():
            return None
        # No later move of an action is the first with one of its sites.
        moves = np.sort(np.unique(self.numbers, return_index=True)[1])
        return self.supports.shown_first(self.numbers[moves], self.ends[moves])


@dataclass(frozen=True, slots=True, eq=False)
class NumberedCubes:
    """A cube path in numbers: the moves of a path that remain, cube by cube.

    `starts` has shape (cubes + 1,) and `moves` (reduced moves,), both int64: cube i has the moves
    ``moves[starts[i]:starts[i + 1]]``, as places in the path from 0.
    """

    starts: NDArray[np.int64]
    moves: NDArray[np.int64]


class _OddError(Exception):
    """Only `read_moves` understands the lines, or says what is wrong with them."""


class IrregularError(CubepathError):
    """`read_path` cannot read the path; `read_moves` can, or says what is wrong."""


@collector_paused()
def read_path(
    source: Source, scene: Scene | None = None, progress: Progress | None = None
) -> NumberedPath:
    """Return the path in a moves file: the moves that `moves.read_moves` yields, in numbers.

    Whether the moves are admissible one after another is not checked. Raises IrregularError if a
    line is invalid, or can only be understood together with the lines before it: then `read_moves`
    reads the file, or says what is wrong.
    """
    with opened(source) as file:
        return _from_lines(file, scene, progress)


def number_actions(actions: Iterable[Action]) -> NumberedPath:
    """Return the path of actions, named by their labels; its moves leave open where they start."""
    kept = _Kept()
    kept.numbers = [kept.add(action, action.label) for action in actions]
    kept.ends = [-1] * len(kept.numbers)
    return kept.path(None)


def number_names(
    names: Sequence[GeneratorPlacement], actions: Sequence[Action], moves: NDArray[np.int32]
) -> NumberedPath:
    """Return the path whose moves are given by the places of their names, shape (moves,).

    `actions` has the action of each name. Several names may be of one action: the path has the one
    that comes first in it. From which local state a move goes is left open.
    """
    kept = _Kept()
    met, first = np.unique(moves, return_index=True)
    number_of = np.zeros(len(names), dtype=np.int32)
    for name in met[np.argsort(first)].tolist():
        number_of[name] = kept.add(actions[name], names[name])
    path = kept.path(None)
    return replace(path, numbers=number_of[moves], ends=np.full(len(moves), -1, dtype=np.int8))


def number_placements(system: System, placed: Iterable[GeneratorPlacement]) -> NumberedPath:
    """Return the path of moves by generator and place; InputError if the system has no such move.

    From which local state a move goes is left open.
    """
    kept = _Kept()
    known: dict[bytes, int] = {}
    for each in placed:
        number = known.get(key := _encode(each))
        if number is None:
            action = system.read_action(each)
            number = known[key] = kept.add(action, each)
        kept.numbers.append(number)
    kept.ends = [-1] * len(kept.numbers)
    return kept.path(None)


@collector_paused()
def number_moves(moves: Iterable[PathMove], progress: Progress | None = None) -> NumberedPath:
    """Return the path of an iterable of moves."""
    kept = _Kept()
    names: list[MoveName] = []
    rest = iter(moves)
    while some := list(islice(rest, PORTION)):
        for move in some:
            number, end = kept.entry(move)
            kept.numbers.append(number)
            kept.ends.append(end)
            names.append(move.name)
        if progress is not None:
            progress(len(some))
    if set(map(type, names)) <= {GeneratorPlacement}:
        return kept.path(None)
    return kept.path(names)


@dataclass(slots=True)
class _Kept:
    """The part of a path that was read so far."""

    actions: list[Action] = field(default_factory=list)
    names: list[MoveName] = field(default_factory=list)
    stated: list[bool] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    ends: list[int] = field(default_factory=list)
    _number: dict[Action, int] = field(default_factory=dict)

    def add(self, action: Action, name: MoveName, *, stated: bool = True) -> int:
        """Return the number of an action."""
        found = self._number.get(action)
        if found is None:
            found = self._number[action] = len(self.actions)
            self.actions.append(action)
            self.names.append(name)
            self.stated.append(stated)
        return found

    def entry(self, move: PathMove) -> tuple[int, int]:
        """Return the number of a move's action, and the local state before it, -1 if not known."""
        action, before = move.action, move.before
        stated = before is not None or isinstance(move.name, GeneratorPlacement)
        number = self.add(action, move.name, stated=stated)
        # A move that leaves open what another of its action says cannot be written, and is refused.
        self.stated[number] |= stated
        if before is None:
            return number, -1
        shown = before - action.free if action.free else before
        return number, int(action.ends[0] != shown)

    def path(self, names: list[MoveName] | None) -> NumberedPath:
        return NumberedPath(
            self.actions,
            self.names,
            self.stated,
            np.array(self.numbers, dtype=np.int32),
            np.array(self.ends, dtype=np.int8),
            names,
        )


def _from_lines(file: InputFile, scene: Scene | None, progress: Progress | None) -> NumberedPath:
    marked = file.head(len(BYTE_ORDER_MARK)) == BYTE_ORDER_MARK
    stream = file.stream if marked else file.from_start()
    begin = stream.tell()
    try:
        first = next((line for line in stream if not line.isspace()), b"")
        stream.seek(begin)
        if first and is_by_generator(first):
            return _by_generators(stream, scene, progress)
        return _by_contents(stream, progress)
    except OSError as error:
        raise InputError(f"{file.path}: {error.strerror or error}") from None
    except (
        msgspec.MsgspecError,
        UnicodeDecodeError,
        RecursionError,
        InputError,
        _OddError,
    ) as error:
        raise IrregularError(f"{file.path}: {error}") from None


def _by_contents(stream: BinaryIO, progress: Progress | None) -> NumberedPath:
    reader = _ContentsReader()
    for lines in _portions(stream):
        reader.take(lines)
        if progress is not None:
            progress(len(lines))
    return reader.path()


class _Line(msgspec.Struct, forbid_unknown_fields=True, gc=False):
    """A self-contained move, its lists as they are written."""

    id: str | int
    support: msgspec.Raw
    trace: msgspec.Raw
    before: msgspec.Raw = _LEFT_OUT
    after: msgspec.Raw = _LEFT_OUT


_line = msgspec.json.Decoder(_Line).decode
_lists = msgspec.json.Decoder(list[list[Any]]).decode
# Most sites are of these kinds, which msgspec decodes straight to what `site_from_json` returns.
_plain_lists = msgspec.json.Decoder(list[list[int | str | tuple[int, ...]]]).decode


class _ContentsReader:
    """The self-contained moves that were read so far, without an action per line.

    Each distinct text of contents is decoded once and becomes an action by the numbers of its
    sites, so that lines with the same meaning are the same action however they are written.
    """

    def __init__(self) -> None:
        self._ids: list[str | int] = []
        self._texts: list[int] = []  # of each move
        self._number: dict[bytes | tuple[str | int, bytes], int] = {}
        # By the number of a text: its action, and the local state before the move.
        self._actions: list[int] = []
        self._ends: list[int] = []
        self._named: dict[str | int, int] = {}
        self._sites = Ordinals[Site]()
        self._rows = GrowingRows()
        self._stated: list[bool] = []

    def take(self, lines: Iterable[bytes]) -> None:
        """Read lines that are not blank."""
        for line in lines:
            found = _line(line)
            named = not (found.before or found.after)
            check_keys(line, 3 if named else 5)
            key: bytes | tuple[str | int, bytes]
            if named:
                key = found.id, b",".join((found.support, found.trace))
            else:
                key = b",".join((found.support, found.trace, found.before, found.after))
            text = self._number.get(key)
            if text is None:
                text = self._number[key] = len(self._number)
                self._add(key)
            self._ids.append(found.id)
            self._texts.append(text)

    def _add(self, key: bytes | tuple[str | int, bytes]) -> None:
        """Find the action of contents that were not met before."""
        name, text = (None, key) if isinstance(key, bytes) else key
        if _NUL in text:
            raise _OddError("a NUL, with which the site begins that stands for an id")
        text, numbers = b"[%b]" % text, self._sites
        lists: list[list[Any]]
        try:
            lists = [*_plain_lists(text)]
        except msgspec.ValidationError:
            lists = [list(map(site_from_json, sites)) for sites in _lists(text)]
        support, trace, *ends = [[numbers[site] for site in sites] for sites in lists]
        if name is not None:
            extra = numbers[NAME, name]
            support, trace, ends = [*support, extra], [*trace, extra], [[], [extra]]
            if len(trace) == 1:
                raise _OddError("an empty trace")
        found = self._rows.add(support, trace, *ends)
        if found is None:
            raise _OddError("no action")
        known, end = found
        if known == len(self._stated):
            self._stated.append(name is None)
        if name is not None and self._named.setdefault(name, known) != known:
            raise _OddError("an id with two contents")
        self._actions.append(known)
        self._ends.append(end if name is None else -1)

    def path(self) -> NumberedPath:
        """Return what was read."""
        # An id that names an action in one line may not label contents in another.
        if self._named and any(
            name in self._named and end >= 0
            for name, end in zip(self._ids, map(self._ends.__getitem__, self._texts), strict=True)
        ):
            raise _OddError("an id with and without local states")
        supports, swapped = self._rows.supports(list(self._sites), self._stated)
        texts = np.array(self._texts, dtype=np.int32)
        numbers = np.array(self._actions, dtype=np.int32)[texts]
        ends = np.array(self._ends, dtype=np.int8)[texts]
        names: list[MoveName] = [*self._ids]
        action_names = [names[move] for move in np.unique(numbers, return_index=True)[1].tolist()]
        return NumberedPath(
            TabledActions(supports, lambda number: _encode(action_names[number]).decode()),
            action_names,
            self._stated,
            numbers,
            np.where(ends < 0, ends, ends ^ swapped[numbers]),
            names,
            supports,
        )


def _by_generators(
    stream: BinaryIO, scene: Scene | None, progress: Progress | None
) -> NumberedPath:
    kept = _Kept()
    known: dict[bytes, int] = {}

    def new(line: bytes) -> int:
        if scene is None:
            raise _OddError("a generator without a system")
        found = placement_in(line)
        check_keys(line, 2)
        number = kept.add(scene.system.read_action(found), found)
        if len(known) >= _KEPT:
            known.clear()
        known[line] = number
        return number

    for lines in _portions(stream):
        found = [known.get(line, -1) for line in lines]
        if -1 in found:
            found = [known[line] if line in known else new(line) for line in lines]
        kept.numbers += found
        if progress is not None:
            progress(len(found))
    kept.ends = [-1] * len(kept.numbers)
    return kept.path(None)


def _portions(stream: BinaryIO) -> Iterator[list[bytes]]:
    """Yield the lines that are not blank, some at a time."""
    while lines := list(islice(stream, PORTION)):
        filled = [line for line in lines if not line.isspace()]
        if filled:
            yield filled
