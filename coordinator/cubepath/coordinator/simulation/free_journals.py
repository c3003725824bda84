"""Journals of simulated keepers: they survive their keeper, but for what was being written.

Every record is shown to whoever checks the run, once it is sure to stay.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from msgspec.structs import replace

from cubepath.agents.keepers.journal import Committed, FileJournal, Opened, Record
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.wire.free_messages import Moved


class SimulatedJournal:
    """A journal in memory that can lose what was written since the last look at it."""

    def __init__(self, wrote: Callable[[], None]) -> None:
        """Begin empty; `wrote` is called for each record."""
        self._wrote = wrote
        self._records: list[Record] = []
        self._commits: list[Moved] = []
        self._looked = 0

    def append(self, record: Record) -> None:
        """Add a record."""
        self._records.append(record)
        self._wrote()
        if isinstance(record, Committed) and record.decision.moved is not None:
            self._commits.append(record.decision.moved)

    def records(self) -> Iterator[Record]:
        """Yield all records, in their order."""
        return iter(tuple(self._records))

    def commit(self, serial: int) -> Moved:
        """Return the commit of this serial number, from 1."""
        return self._commits[serial - 1]

    def fresh(self) -> list[Record]:
        """Return the records since this was last called."""
        if self._looked == len(self._records):
            return []
        found = self._records[self._looked :]
        self._looked = len(self._records)
        return found

    def tear(self, number: int) -> bool:
        """Lose a fresh record, which the number decides, and all after it.

        Return whether there was one.
        """
        fresh = len(self._records) - self._looked
        if not fresh:
            return False
        self._cut(self._looked + number % fresh)
        return True

    def _cut(self, left: int) -> None:
        for record in self._records[left:]:
            if isinstance(record, Committed):
                self._commits.pop()
        del self._records[left:]

    def again(self) -> SimulatedJournal:
        """Return the journal for the next keeper."""
        return self


class SimulatedFile(SimulatedJournal):
    """The same in a file, as real keepers have it, of whose torn record a part remains."""

    def __init__(self, wrote: Callable[[], None], path: Path) -> None:
        """Begin with a file that has nothing in it."""
        super().__init__(wrote)
        self._opened = Opened("simulated", 0, 1)
        self._file = FileJournal(path, self._opened)
        self._ends = [path.stat().st_size]

    def append(self, record: Record) -> None:
        """Add a record."""
        super().append(record)
        self._file.append(record)
        self._ends.append(self._file.path.stat().st_size)

    def records(self) -> Iterator[Record]:
        """Yield all records as they are in the file."""
        found = list(self._file.records())
        if found != self._records:
            raise CheckError(f"{self._file.path}: {len(found)} records are not those written")
        return iter(found)

    def commit(self, serial: int) -> Moved:
        """Return the commit of this serial number, from 1."""
        return self._file.commit(serial)

    def _cut(self, left: int) -> None:
        super()._cut(left)
        begin, end = self._ends[left : left + 2]
        del self._ends[left + 1 :]
        with self._file.path.open("r+b") as file:
            file.truncate(begin + (end - begin) // 2)

    def again(self) -> SimulatedJournal:
        """Open the file again, for the next keeper."""
        self.close()
        self._opened = replace(self._opened, birth=self._opened.birth + 1)
        self._file = FileJournal(self._file.path, self._opened)
        return self

    def close(self) -> None:
        """Close the file."""
        self._file.__exit__()
