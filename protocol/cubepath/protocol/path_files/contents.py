"""Reading self-contained moves straight into arrays, without an action or a tuple per line.

Compiled code (`scanning`) scans the bytes of the lines. Each distinct text of a site is decoded
once, by the usual functions, so that ``1`` and ``1.0`` are one site. Each distinct text of contents
becomes an action by the numbers of its sites (`supports`), so that lines with the same meaning are
the same action however they are written. Anything unusual is left to the reader of lines,
`cubepath.protocol.path_files.moves.read_moves`, which says what is wrong with it, or accepts it.
"""

from collections.abc import Callable, Iterator
from io import SEEK_END
from typing import Any, BinaryIO, NamedTuple, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.path_files import scanning
from cubepath.protocol.path_files.moves import NAME
from cubepath.protocol.path_files.supports import (
    GrowingRows,
    SupportRows,
    Supports,
    canonical,
    distinct,
)

Id = str | int
PIECE = 1 << 20
"""Bytes that are read at a time."""
_STEPS_A_BYTE = 2
"""Microseconds that the scanner takes for a byte in plain Python."""
_NEWLINE = ord("\n")
_NUL = b"\\u0000"
_ids = msgspec.json.Decoder(list[Id]).decode
_values = msgspec.json.Decoder(list[Any]).decode
_Entry = TypeVar("_Entry", bound=np.generic)


class OddError(Exception):
    """The lines are invalid, or can only be understood by the reader of lines."""


class Contents(NamedTuple):
    """The moves of a file: the supports of distinct actions, and of each move action, end and id.

    `first` is for each action the first move that makes it. `named` are the ids that name actions.
    """

    supports: Supports
    numbers: NDArray[np.int32]
    ends: NDArray[np.int8]
    ids: list[Id]
    first: NDArray[np.int32]
    named: frozenset[Id]


def read_contents(stream: BinaryIO, progress: Callable[[int], object] | None = None) -> Contents:
    """Return the self-contained moves of a stream of lines, from where it stands.

    OddError if a line is not one, or is unusual; msgspec's errors, UnicodeDecodeError,
    RecursionError and InputError for text that is no JSON, or sites that are none.
    """
    begin = stream.tell()
    reading = _Reading(stream.seek(0, SEEK_END) - begin)
    stream.seek(begin)
    for piece in _pieces(stream):
        count = reading.take(piece)
        if progress is not None:
            progress(count)
    return reading.contents()


def _pieces(stream: BinaryIO) -> Iterator[bytes]:
    """Yield the stream in pieces of whole lines, each with a newline at its end."""
    kept: list[bytes] = []
    while piece := stream.read(PIECE):
        end = piece.rfind(b"\n") + 1
        if end:
            yield b"".join([*kept, piece[:end]])
            kept = []
        kept.append(piece[end:])
    rest = b"".join(kept)
    if rest:
        yield rest + b"\n"


class _Reading:
    """What was read so far: texts, what their sites are, and the actions that they stand for."""

    def __init__(self, size: int) -> None:
        """Begin to read this many bytes."""
        # Asked for at once: a large file is for compiled code from its first piece on.
        self._scan = scanning.scan.for_work(size * _STEPS_A_BYTE, by_entries=True)
        self._texts = scanning.Texts(
            slots=_none(np.int64),
            rows=np.zeros((0, 5), dtype=np.int64),
            arena=_none(np.uint8),
            first=_none(np.int32),
            parts_at=_none(np.int32),
            mentions=_none(np.int32),
            site_slots=_none(np.int64),
            site_arena=_none(np.uint8),
            site_at=_none(np.int64),
            totals=np.zeros(scanning.TOTALS, dtype=np.int64),
        )
        self._growing = GrowingRows(
            starts=_none(np.int32),
            sites=_none(np.int32),
            says=_none(np.int8),
            stated=_none(np.bool_),
            slots=_none(np.int64),
            marks=_none(np.int8),
        )
        self._actions = 0
        self._sites: dict[Site, int] = {}
        # By the text of a site: its number.
        self._meant = _none(np.int32)
        self._decoded = 0
        # By the text of contents: the action, and the local state before the move.
        self._numbers = _none(np.int32)
        self._ends = _none(np.int8)
        self._done = 0
        self._named: dict[Id, int] = {}
        self._moves: list[NDArray[np.int32]] = []
        self._ids: list[Id] = []

    def take(self, piece: bytes) -> int:
        """Read the lines of a piece; return how many moves it has."""
        text = np.frombuffer(piece, dtype=np.uint8)
        ends = np.flatnonzero(text == _NEWLINE)
        longest = int(np.diff(ends, prepend=-1).max())
        moves = np.empty(len(ends), dtype=np.int32)
        ids = np.empty(len(piece), dtype=np.uint8)
        value = np.zeros(10, dtype=np.int64)
        totals = self._texts.totals
        totals[scanning.ID_BYTES] = totals[scanning.MENTIONS] = 0
        line = 0
        while line < len(ends):
            self._make_room(longest)
            line = int(self._scan(text, ends, line, self._texts, moves, ids, value))
            if line < 0:
                raise OddError(f"line {-line} of a piece")
        found = moves[moves >= 0]
        self._moves.append(found)
        self._ids += _ids(b"[" + ids[: max(int(totals[scanning.ID_BYTES]) - 1, 0)].tobytes() + b"]")
        self._decode_sites()
        self._number_actions()
        return len(found)

    def _make_room(self, size: int) -> None:
        """Make room for another line of this size, and twice as much as there was."""
        texts, totals = self._texts, self._texts.totals
        count, sites = int(totals[scanning.TEXTS]) + 2, int(totals[scanning.SITES]) + size + 2
        rows = _longer(texts.rows, count)
        self._texts = texts._replace(
            slots=_hashed(texts.slots, count),
            rows=rows,
            arena=_longer(texts.arena, int(totals[scanning.TEXT_BYTES]) + size),
            first=_longer(texts.first, len(rows)),
            parts_at=_longer(texts.parts_at, 4 * len(rows) + 1),
            mentions=_longer(texts.mentions, int(totals[scanning.MENTIONS]) + size),
            site_slots=_hashed(texts.site_slots, sites),
            site_arena=_longer(texts.site_arena, int(totals[scanning.SITE_BYTES]) + size),
            site_at=_longer(texts.site_at, sites),
        )

    def _decode_sites(self) -> None:
        """Find out which sites the texts mean that were not met before."""
        texts, known, count = self._texts, self._decoded, int(self._texts.totals[scanning.SITES])
        if known == count:
            return
        begin, end = texts.site_at[[known, count]].tolist()
        text = texts.site_arena[begin : end - 1].tobytes()
        if _NUL in text:
            raise OddError("a NUL, with which the site begins that stands for an id")
        values = _values(b"[" + text + b"]")
        if len(values) != count - known:
            raise OddError("texts of sites that are not one value each")
        numbers = [self._site_number(_site(value)) for value in values]
        self._meant = _longer(self._meant, count)
        self._meant[known:count] = numbers
        self._decoded = count

    def _site_number(self, site: Site) -> int:
        return self._sites.setdefault(site, len(self._sites))

    def _number_actions(self) -> None:
        """Find the actions of the texts of contents that were not met before."""
        texts, begin, stop = self._texts, self._done, int(self._texts.totals[scanning.TEXTS])
        if begin == stop:
            return
        count, mentioned = self._actions, int(texts.totals[scanning.MENTIONS])
        extra = np.full(stop - begin, -1, dtype=np.int32)
        named = (np.flatnonzero(texts.rows[begin:stop, 4] < 0)).tolist()
        ids = [self._id(begin + place) for place in named]
        extra[named] = [self._site_number((NAME, each)) for each in ids]
        growing, most = self._growing, count + stop - begin + 2
        used = int(growing.starts[count]) if count else 0
        self._growing = growing = GrowingRows(
            starts=_longer(growing.starts, most),
            sites=_longer(growing.sites, used + mentioned + len(extra)),
            says=_longer(growing.says, used + mentioned + len(extra)),
            stated=_longer(growing.stated, most),
            slots=_hashed(growing.slots, most),
            marks=_longer(growing.marks, len(self._sites)),
        )
        self._numbers, self._ends = _longer(self._numbers, stop), _longer(self._ends, stop)
        meant = self._meant[texts.mentions[:mentioned]]
        number = distinct.for_work(3 * mentioned, by_entries=True)
        parts = texts.parts_at[4 * begin : 4 * stop + 1]
        offsets = (self._numbers[begin:stop], self._ends[begin:stop])
        self._actions = int(number(parts, meant, extra, growing, count, *offsets))
        if self._actions < 0:
            raise OddError("no action")
        for place, each in zip(named, ids, strict=True):
            action = int(self._numbers[begin + place])
            if self._named.setdefault(each, action) != action:
                raise OddError("an id with two contents")
        self._done = stop

    def _id(self, number: int) -> Id:
        """Return the id in the text of contents of a move that its id names."""
        texts = self._texts
        begin = int(texts.rows[number, :3].sum())
        end = begin + int(texts.rows[number, 3])
        return _ids(b"[" + texts.arena[begin:end].tobytes() + b"]")[0]

    def contents(self) -> Contents:
        """Return what was read; nothing can be read afterwards."""
        count, growing = self._actions, self._growing
        starts = growing.starts[: count + 1] if count else np.zeros(1, dtype=np.int32)
        used = int(starts[-1])
        rows = SupportRows(
            starts,
            growing.sites[:used],
            growing.says[:used],
            np.zeros(count + 1, dtype=np.int32),
            np.zeros((0, 2), dtype=np.int32),
            growing.stated[:count],
        )
        supports = Supports(rows, list(self._sites))
        swapped = canonical(rows, supports.order)
        texts = np.concatenate(self._moves or [_none(np.int32)])
        # Actions are numbered in the order of the texts, and these in the order of the moves.
        first = self._texts.first[np.unique(self._numbers[: self._done], return_index=True)[1]]
        numbers, ends = self._numbers[texts], self._ends[texts]
        if count:
            ends = np.where(ends < 0, ends, ends ^ swapped[numbers])
        return Contents(supports, numbers, ends, self._ids, first, frozenset(self._named))


_FLAT = {int, str}


def _site(value: object) -> Site:
    """Return the site of a JSON value; errors as `site_from_json`."""
    if type(value) is list and set(map(type, value)) <= _FLAT:
        return tuple(value)  # most are flat lists, and then this is all
    return site_from_json(value)


def _none(kind: type[_Entry]) -> NDArray[_Entry]:
    return np.zeros(0, dtype=kind)


def _longer(array: NDArray[_Entry], size: int) -> NDArray[_Entry]:
    """Return an array of at least this many rows that begins with this one; the rest is 0."""
    if size <= len(array):
        return array
    # Untouched pages take no memory.
    found = np.zeros((max(size, 2 * len(array)), *array.shape[1:]), dtype=array.dtype)
    found[: len(array)] = array
    return found


def _hashed(slots: NDArray[np.int64], size: int) -> NDArray[np.int64]:
    """Return a hash table that this many numbers do not fill to a half."""
    if 2 * size < len(slots):
        return slots
    found = np.zeros(1 << (4 * size).bit_length(), dtype=np.int64)
    scanning.rehash.for_work(len(slots), by_entries=True)(slots, found)
    return found
