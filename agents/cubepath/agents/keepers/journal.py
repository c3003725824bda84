"""The log of a keeper: what it has logged before it answered, and what it comes back from.

Room: agents. A record is one line: the CRC-32 of its JSON in hexadecimal, a blank, and the JSON. A
last line that was cut off by a crash is no record, and nobody was answered for it.
"""

from __future__ import annotations

import os
from abc import abstractmethod
from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol, Self, TypeAlias
from zlib import crc32

import msgspec

from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.output_files import appended_file
from cubepath.protocol.wire.free_messages import Decision, Enter, Moved, Passed


class Prepared(msgspec.Struct, frozen=True, tag="prepared"):
    """An attempt is prepared, with all that is passed on of it."""

    passed: Passed


class Decided(msgspec.Struct, frozen=True, tag="decided"):
    """What came of an attempt; its own refusals have nothing prepared before them."""

    decision: Decision


class Committed(msgspec.Struct, frozen=True, tag="committed"):
    """This keeper was the last of the chain: this record is the move."""

    passed: Passed
    decision: Decision


class Born(msgspec.Struct, frozen=True, tag="born"):
    """A module has entered."""

    enter: Enter


class Acknowledged(msgspec.Struct, frozen=True, tag="acknowledged"):
    """A keeper of the chain has taken note of a commit."""

    keeper: int
    module: int
    epoch: int
    number: int


Record: TypeAlias = Prepared | Decided | Committed | Born | Acknowledged
_decoder: msgspec.json.Decoder[Record] = msgspec.json.Decoder(Record)
_encode = msgspec.json.Encoder().encode


class Journal(Protocol):
    """What a keeper writes to, and reads its commits from."""

    @abstractmethod
    def append(self, record: Record) -> None:
        """Add a record; once this returns, a crash does not lose it."""

    @abstractmethod
    def records(self) -> Iterator[Record]:
        """Yield all records, in their order."""

    @abstractmethod
    def commit(self, serial: int) -> Moved:
        """Return the commit of this serial number, from 1."""


class MemoryJournal:
    """A journal that lasts as long as this process."""

    def __init__(self) -> None:
        """Begin empty."""
        self._records: list[Record] = []
        self._commits: list[Moved] = []

    def append(self, record: Record) -> None:
        """Add a record."""
        self._records.append(record)
        if isinstance(record, Committed):
            self._commits.append(_moved(record))

    def records(self) -> Iterator[Record]:
        """Yield all records, in their order."""
        return iter(tuple(self._records))

    def commit(self, serial: int) -> Moved:
        """Return the commit of this serial number, from 1."""
        return self._commits[serial - 1]


class FileJournal:
    """A journal in a file; what it says survives the end of the process, however that comes.

    It is handed to the operating system and not forced onto the disk, so a power failure may lose
    the last records. A context manager that closes the file.
    """

    def __init__(self, path: Path) -> None:
        """Open or create the file; InputError if that fails, or a record is damaged."""
        self.path = path
        self._commits = array("q")
        """The offset of each commit, and its length."""
        self._end = 0
        try:
            self._file = appended_file(path)
        except OSError as error:
            raise InputError(
                f"{path}: {error.strerror or error}, expected a keeper's log"
            ) from None
        try:
            self._scan()
        except InputError:
            self._file.close()
            raise

    def _scan(self) -> None:
        self._file.seek(0)
        for number, line in enumerate(self._file, 1):
            if not line.endswith(b"\n"):  # cut off: whoever was to be answered was not
                self._file.truncate(self._end)
                break
            record = _record(line)
            if record is None:
                raise InputError(f"{self.path}: line {number} is damaged, expected a record")
            self._added(record, line)

    def __enter__(self) -> Self:
        """Return the journal."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self._file.close()

    def append(self, record: Record) -> None:
        """Add a record; CheckError if it cannot be written."""
        text = _encode(record)
        line = b"%08x %b\n" % (crc32(text), text)
        try:
            written = 0
            while written < len(line):
                written += os.write(self._file.fileno(), line[written:])
        except OSError as error:
            raise CheckError(
                f"{self.path}: the log of the keeper stopped: {error.strerror or error}"
            ) from None
        self._added(record, line)

    def _added(self, record: Record, line: bytes) -> None:
        if isinstance(record, Committed):
            self._commits.extend((self._end, len(line)))
        self._end += len(line)

    def records(self) -> Iterator[Record]:
        """Yield all records, in their order."""
        with self.path.open("rb") as file:
            for line in file:
                record = _record(line)
                if record is not None:
                    yield record

    def commit(self, serial: int) -> Moved:
        """Return the commit of this serial number, from 1."""
        # Not by a buffered file: it would not know where what was appended since lies.
        offset, length = self._commits[2 * serial - 2 : 2 * serial]
        record = _record(os.pread(self._file.fileno(), length, offset))
        if not isinstance(record, Committed):
            raise CheckError(f"{self.path}: commit {serial} was changed since it was written")
        return _moved(record)


def _record(line: bytes) -> Record | None:
    crc, _, text = line.rstrip(b"\n").partition(b" ")
    if not line.endswith(b"\n") or crc != b"%08x" % crc32(text):
        return None
    try:
        return _decoder.decode(text)
    except msgspec.DecodeError:
        return None


def _moved(record: Committed) -> Moved:
    moved = record.decision.moved
    if moved is None:
        raise CheckError("a commit without what it commits")
    return moved
