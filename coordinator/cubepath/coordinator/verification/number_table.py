"""Whole numbers by whole numbers, eight bytes each: what is kept of each message of a long run.

Part of `cubepath verify`.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from heapq import merge
from typing import TypeAlias

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
        """Begin with no key."""
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
        """Yield the keys in order."""
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
        """Begin with no name."""
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
