"""Reading self-contained moves straight into arrays, without an action per line.

Each distinct text of contents is decoded once and becomes an action by the numbers of its sites, so
that lines with the same meaning are the same action however they are written. Anything unusual is
left to the reader of lines, `cubepath.protocol.path_files.moves.read_moves`, which says what is
wrong with it, or accepts it.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.parsing import check_keys
from cubepath.protocol.core.sites import Ordinals, Site, site_from_json
from cubepath.protocol.path_files.moves import NAME
from cubepath.protocol.path_files.supports import GrowingRows, Supports

Id = str | int
_LEFT_OUT = msgspec.Raw()
_NUL = b"\\u0000"


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
    first: NDArray[np.int64]
    named: frozenset[Id]


class _Line(msgspec.Struct, forbid_unknown_fields=True, gc=False):
    """A self-contained move, its lists as they are written."""

    id: Id
    support: msgspec.Raw
    trace: msgspec.Raw
    before: msgspec.Raw = _LEFT_OUT
    after: msgspec.Raw = _LEFT_OUT


_line = msgspec.json.Decoder(_Line).decode
_lists = msgspec.json.Decoder(list[list[Any]]).decode
# Most sites are of these kinds, which msgspec decodes straight to what `site_from_json` returns.
_plain_lists = msgspec.json.Decoder(list[list[int | str | tuple[int, ...]]]).decode


class ContentsReader:
    """What was read so far: texts of contents, and the actions that they stand for.

    Lines raise OddError if they are unusual; msgspec's errors, UnicodeDecodeError, RecursionError
    and InputError if they are no JSON, or their sites are none.
    """

    def __init__(self) -> None:
        self._ids: list[Id] = []
        self._texts: list[int] = []  # of each move
        self._number: dict[bytes | tuple[Id, bytes], int] = {}
        # By the number of a text: its action, and the local state before the move.
        self._actions: list[int] = []
        self._ends: list[int] = []
        self._named: dict[Id, int] = {}
        self._sites = Ordinals[Site]()
        self._rows = GrowingRows()
        self._stated: list[bool] = []

    def take(self, lines: Iterable[bytes]) -> None:
        """Read lines that are not blank."""
        for line in lines:
            found = _line(line)
            named = not (found.before or found.after)
            check_keys(line, 3 if named else 5)
            key: bytes | tuple[Id, bytes]
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

    def _add(self, key: bytes | tuple[Id, bytes]) -> None:
        """Find the action of contents that were not met before."""
        name, text = (None, key) if isinstance(key, bytes) else key
        if _NUL in text:
            raise OddError("a NUL, with which the site begins that stands for an id")
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
                raise OddError("an empty trace")
        found = self._rows.add(support, trace, *ends)
        if found is None:
            raise OddError("no action")
        known, end = found
        if known == len(self._stated):
            self._stated.append(name is None)
        if name is not None and self._named.setdefault(name, known) != known:
            raise OddError("an id with two contents")
        self._actions.append(known)
        self._ends.append(end if name is None else -1)

    def contents(self) -> Contents:
        """Return what was read."""
        supports, swapped = self._rows.supports(list(self._sites), self._stated)
        texts = np.array(self._texts, dtype=np.int32)
        numbers = np.array(self._actions, dtype=np.int32)[texts]
        ends = np.array(self._ends, dtype=np.int8)[texts]
        return Contents(
            supports,
            numbers,
            np.where(ends < 0, ends, ends ^ swapped[numbers]),
            self._ids,
            np.unique(numbers, return_index=True)[1],
            frozenset(self._named),
        )
