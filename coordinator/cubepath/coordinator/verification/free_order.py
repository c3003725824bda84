"""An order in which the commits of a run without rounds can have happened, by their versions.

Part of `cubepath verify`. Commits are named by numbers, and kept in arrays.
"""

from __future__ import annotations

from array import array
from collections.abc import Hashable, Iterable, Iterator
from heapq import heapify, heappop, heappush
from itertools import groupby
from typing import NamedTuple

import numpy as np

READ, GUARD = -2, -1
"""What a commit does with a version, unless it ends it: then it counts who has read it."""


class AtVersion(NamedTuple):
    """The commits that touch a thing at one of its versions."""

    version: int
    readers: list[int]
    guards: list[int]
    writers: list[int]
    """Those that end it."""
    counted: list[int]
    """How many readers each of these counts."""


class Touches:
    """What commits touch, units or modules, at which versions: 24 bytes for each touch."""

    def __init__(self) -> None:
        """Begin with no touch."""
        self._numbers: dict[Hashable, int] = {}
        self._things, self._commits = array("i"), array("i")
        self._versions, self._what = array("q"), array("q")

    def add(self, thing: Hashable, version: int, what: int, commit: int) -> None:
        """Take note that a commit touches a thing at a version; commits come in their order."""
        self._things.append(self._numbers.setdefault(thing, len(self._numbers)))
        self._versions.append(version)
        self._what.append(what)
        self._commits.append(commit)

    def sort(self) -> None:
        """Put all touches in order of things, as they were first touched, and of versions."""
        rows = (self._things, self._versions, self._what, self._commits)
        columns = [np.asarray(each) for each in rows]
        things, versions, what, _ = columns
        order = np.lexsort((np.minimum(what, 0), versions, things))
        for column in columns:
            column[:] = column[order]

    def __iter__(self) -> Iterator[tuple[Hashable, int, Iterator[AtVersion]]]:
        """Yield things, how many of their versions were ended, and each version in order."""
        things, begin = self._things, 0
        for name, number in self._numbers.items():
            end, ended, last = begin, 0, None
            while end < len(things) and things[end] == number:
                if self._what[end] >= 0 and self._versions[end] != last:
                    last = self._versions[end]
                    ended += 1
                end += 1
            yield name, ended, self._each_version(begin, end)
            begin = end

    def _each_version(self, begin: int, end: int) -> Iterator[AtVersion]:
        for version, places in groupby(range(begin, end), key=self._versions.__getitem__):
            found = AtVersion(version, [], [], [], [])
            for place in places:
                what, commit = self._what[place], self._commits[place]
                if what >= 0:
                    found.writers.append(commit)
                    found.counted.append(what)
                else:
                    (found.readers if what == READ else found.guards).append(commit)
            yield found

    def edges(self) -> Iterator[tuple[int, int]]:
        """Yield pairs of commits of which the first came before the second."""
        for _, _, versions in self:
            before = AtVersion(-2, [], [], [], [])
            for this in versions:
                users = [*this.readers, *this.guards]
                for writer in before.writers[:1] if before.version + 1 == this.version else ():
                    yield from ((writer, user) for user in (*users, *this.writers[:1]))
                for writer in this.writers[:1]:
                    yield from ((user, writer) for user in users)
                before = this


def in_order(count: int, edges: Iterable[tuple[int, int]]) -> tuple[array[int], int | None]:
    """Return an order of so many commits in which the first of each pair is before the second.

    Of those that can be next it has the least. Where pairs contradict each other the rest is left
    out, and the least that is left out is returned too.
    """
    firsts, seconds = array("i"), array("i")
    for one, two in edges:
        if one != two:
            firsts.append(one)
            seconds.append(two)
    first, second = np.asarray(firsts), np.asarray(seconds)
    begin = np.zeros(count + 1, np.int32)
    np.cumsum(np.bincount(first, minlength=count), out=begin[1:])
    before = array("i", np.bincount(second, minlength=count).astype(np.int32).tobytes())
    after = array("i", second[np.argsort(first, kind="stable")].tobytes())
    begins = array("i", begin.tobytes())
    ready = [number for number in range(count) if not before[number]]
    heapify(ready)
    found = array("i")
    while ready:
        number = heappop(ready)
        found.append(number)
        for each in after[begins[number] : begins[number + 1]]:
            before[each] -= 1
            if not before[each]:
                heappush(ready, each)
    if len(found) == count:
        return found, None
    return found, next(number for number in range(count) if before[number])
