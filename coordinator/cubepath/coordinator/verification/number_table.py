"""A table from whole numbers to whole numbers, eight bytes each: the record of a long run.

Part of `cubepath verify`. The commits of a run without rounds take some fifty bytes each.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Sequence
from functools import lru_cache
from heapq import merge
from typing import Any, TypeAlias, overload

import msgspec
from msgspec.structs import astuple, fields

from cubepath.protocol.core.sites import site_hook
from cubepath.protocol.wire.free_messages import Commit

_NONE = -(1 << 63)
_GAP = 64

Name: TypeAlias = tuple[int, int, int]
"""What a module numbers in one of its epochs: module, epoch, number."""


class NumberTable:
    """Numbers by keys of at least 0, most of which follow on each other.

    Keys far beyond the others, which only a wrong recording has, take more memory.

    >>> table = NumberTable()
    >>> table.setdefault(1, 7), table.setdefault(1, 8), table.setdefault(10**9, 9), table.get(2)
    (7, 7, 9, None)
    >>> list(table), len(table)
    ([1, 1000000000], 2)
    """

    __slots__ = ("_count", "_far", "_near", "last")

    def __init__(self) -> None:
        self._near = array("q")
        self._far: dict[int, int] = {}
        self._count = 0
        self.last = 0
        """The greatest key, 0 if there is none."""

    def __len__(self) -> int:
        return self._count

    def get(self, key: int) -> int | None:
        """Return the number of a key, None if it has none."""
        if key < len(self._near):
            found = self._near[key]
            if found != _NONE:
                return found
        return self._far.get(key)

    def setdefault(self, key: int, value: int) -> int:
        """Return the number of a key, which is `value` if it had none before."""
        near = self._near
        gap = key - len(near)
        if gap != 0 or self._far:
            known = self.get(key)
            if known is not None:
                return known
        if gap < 0:
            near[key] = value
        elif key <= _GAP + 2 * self._count:  # else gaps of forged keys could add up
            near.extend([_NONE] * gap)
            near.append(value)
        else:
            self._far[key] = value
        self._count += 1
        self.last = max(self.last, key)
        return value

    def __iter__(self) -> Iterator[int]:
        near = (key for key, value in enumerate(self._near) if value != _NONE)
        return merge(near, sorted(self._far))


class Names:
    """Numbers from 0 on for what modules number in each of their epochs.

    >>> names = Names()
    >>> names.place((3, 1, 1)), names.place((2, 1, 1)), names.place((3, 1, 1)), names.get((0, 0, 0))
    (0, 1, 0, None)
    >>> list(names), list(names.of(3))
    ([(2, 1, 1), (3, 1, 1)], [(3, 1, 1)])
    """

    def __init__(self) -> None:
        self._tables: dict[tuple[int, int], NumberTable] = {}
        self._epochs: dict[int, list[int]] = {}
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def get(self, name: Name) -> int | None:
        """Return the number of a name, None if it has none."""
        module, epoch, number = name
        table = self._tables.get((module, epoch))
        return None if table is None else table.get(number)

    def place(self, name: Name) -> int:
        """Return the number of a name, the next one if it had none."""
        module, epoch, number = name
        table = self._tables.get((module, epoch))
        if table is None:
            table = self._tables[module, epoch] = NumberTable()
            self._epochs.setdefault(module, []).append(epoch)
        found = table.setdefault(number, self._count)
        if found == self._count:
            self._count += 1
        return found

    def of(self, module: int) -> Iterator[Name]:
        """Yield the names of a module in order."""
        for epoch in sorted(self._epochs.get(module, ())):
            for number in self._tables[module, epoch]:
                yield module, epoch, number

    def __iter__(self) -> Iterator[Name]:
        for module in sorted(self._epochs):
            yield from self.of(module)


_KEPT = 256
"""This many commits are kept as they were decoded: the numbers of one stand close together."""
_pack = msgspec.msgpack.Encoder().encode
_row: Any = tuple[tuple(each.type for each in fields(Commit))]  # type: ignore[misc]  # by its fields
_unpack = msgspec.msgpack.Decoder(_row, dec_hook=site_hook).decode


class PackedCommits(Sequence[Commit]):
    """The commits by keeper, then by serial number; each is decoded when it is asked for."""

    def __init__(self) -> None:
        self._keepers: dict[int, NumberTable] = {}
        """By keeper and serial number which of the commits it is, as they were taken."""
        self._data, self._ends = bytearray(), array("q", [0])
        self._odd: dict[int, Commit] = {}
        """Those with numbers that cannot be packed, which only a wrong recording has."""
        self._announced = bytearray()
        self._order = array("q")
        self._taken = lru_cache(maxsize=_KEPT)(self._unpacked)

    def add(self, moved: Commit, *, announced: bool) -> bool:
        """Take a commit; return whether it is the same as before, if it is known.

        A commit that a keeper does not announce came by a tail or a decision.
        """
        count = len(self._announced)
        table = self._keepers.setdefault(moved.keeper, NumberTable())
        place = table.setdefault(moved.serial, count)
        if place < count:
            self._announced[place] |= announced
            return self._taken(place) == moved
        try:
            self._data += _pack(astuple(moved))
        except OverflowError:
            self._odd[count] = moved
        self._ends.append(len(self._data))
        self._announced.append(announced)
        return True

    def _unpacked(self, place: int) -> Commit:
        odd = self._odd.get(place)
        if odd is not None:
            return odd
        return Commit(*_unpack(self._data[self._ends[place] : self._ends[place + 1]]))

    def _places(self) -> array[int]:
        if len(self._order) < len(self):
            each = (place for keeper in self.keepers for place in self._of(keeper))
            self._order = array("q", each)
        return self._order

    def _of(self, keeper: int) -> Iterator[int]:
        table = self._keepers[keeper]
        for serial in table:
            place = table.get(serial)
            if place is not None:
                yield place

    def __len__(self) -> int:
        return len(self._announced)

    @overload
    def __getitem__(self, index: int) -> Commit: ...

    @overload
    def __getitem__(self, index: slice) -> list[Commit]: ...

    def __getitem__(self, index: int | slice) -> Commit | list[Commit]:
        if isinstance(index, slice):
            return [self._taken(place) for place in self._places()[index]]
        return self._taken(self._places()[index])

    def announced(self, number: int) -> bool:
        """Return whether a commit did not come by a tail or a decision alone."""
        return bool(self._announced[self._places()[number]])

    @property
    def keepers(self) -> list[int]:
        """The keepers that have commits, in order."""
        return sorted(self._keepers)

    def serials(self, keeper: int) -> NumberTable:
        """Return the serial numbers that a keeper has."""
        return self._keepers.get(keeper, NumberTable())
