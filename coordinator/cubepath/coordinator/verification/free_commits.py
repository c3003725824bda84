"""The commits of a run without rounds, some fifty bytes each.

Part of `cubepath verify`.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any, overload

import msgspec
from msgspec.structs import astuple, fields

from cubepath.coordinator.verification.number_table import NumberTable
from cubepath.protocol.wire.free_messages import Moved

_KEPT = 256
"""So many commits are kept as they were decoded: what is said of one stands close together."""
_pack = msgspec.msgpack.Encoder().encode
_row: Any = tuple[tuple(each.type for each in fields(Moved))]  # type: ignore[misc]  # by its fields
_unpack = msgspec.msgpack.Decoder(_row).decode


class PackedCommits(Sequence[Moved]):
    """The commits by keeper, then by serial number; each is decoded when it is asked for."""

    def __init__(self) -> None:
        """Begin with none."""
        self._keepers: dict[int, NumberTable] = {}
        """By keeper and serial number which of the commits it is, as they were taken."""
        self._data, self._ends = bytearray(), array("q", [0])
        self._odd: dict[int, Moved] = {}
        """Those with numbers that cannot be packed, which only a wrong recording has."""
        self._announced = bytearray()
        self._order = array("q")
        self._taken = lru_cache(maxsize=_KEPT)(self._unpacked)

    def add(self, moved: Moved, *, announced: bool) -> bool:
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

    def _unpacked(self, place: int) -> Moved:
        odd = self._odd.get(place)
        if odd is not None:
            return odd
        return Moved(*_unpack(self._data[self._ends[place] : self._ends[place + 1]]))

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
    def __getitem__(self, index: int) -> Moved: ...

    @overload
    def __getitem__(self, index: slice) -> list[Moved]: ...

    def __getitem__(self, index: int | slice) -> Moved | list[Moved]:
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
