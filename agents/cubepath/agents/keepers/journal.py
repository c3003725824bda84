"""The log of a keeper: written before the keeper answers, and read when it restarts.

A record is one line: a checksum, the number of the record, from 1, and its JSON. The checksum is a
CRC-32 seeded with the checksum of the previous record, so each depends on all earlier records. The
first record names the keeper, and so does the record written each time the log is reopened. A last
line that a crash cut off does not count: the keeper had not answered for it.
"""

import os
from abc import abstractmethod
from array import array
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple, Protocol, Self, TypeAlias
from zlib import crc32

import msgspec

from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.output_files import appended_file
from cubepath.protocol.core.sites import site_hook
from cubepath.protocol.wire.free_messages import Commit, Decision, EnterRequest, Forwarded


class Prepared(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="prepared"):
    """An attempt is prepared, with all that is passed on of it."""

    passed: Forwarded


class Decided(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="decided"):
    """What came of an attempt; its own refusals have nothing prepared before them."""

    decision: Decision


class Committed(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="committed"):
    """This keeper was the last of the chain: this record is the move."""

    passed: Forwarded
    decision: Decision


class JoinedRecord(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="born"):
    """A module has entered."""

    enter: EnterRequest


class Acknowledged(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="acknowledged"):
    """A keeper of the chain has taken note of a commit."""

    keeper: int
    module: int
    epoch: int
    number: int


class Opened(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="opened"):
    """A keeper has opened its log, in one of its incarnations."""

    run: str
    """The run that began the log: one that is taken up again has another name on the wire."""
    keeper: int
    incarnation: int


Record: TypeAlias = Prepared | Decided | Committed | JoinedRecord | Acknowledged
_decoder: msgspec.json.Decoder[Record | Opened] = msgspec.json.Decoder(
    Record | Opened, dec_hook=site_hook
)
_encode = msgspec.json.Encoder().encode
_PER_COMMIT = 3
_DIGITS_MAX = 18


class Journal(Protocol):
    """What a keeper writes to, and reads its commits from."""

    @abstractmethod
    def append(self, record: Record) -> None:
        """Add a record; once this returns, a crash does not lose it."""

    @abstractmethod
    def records(self) -> Iterator[Record]:
        """Yield all records, in their order."""

    @abstractmethod
    def commit(self, serial: int) -> Commit:
        """Return the commit of this serial number, from 1."""


class MemoryJournal:
    """A journal that lasts as long as this process."""

    def __init__(self) -> None:
        """Begin empty."""
        self._records: list[Record] = []
        self._commits: list[Commit] = []

    def append(self, record: Record) -> None:
        """Add a record."""
        self._records.append(record)
        if isinstance(record, Committed):
            self._commits.append(_moved(record))

    def records(self) -> Iterator[Record]:
        """Yield all records, in their order."""
        return iter(tuple(self._records))

    def commit(self, serial: int) -> Commit:
        """Return the commit of this serial number, from 1."""
        return self._commits[serial - 1]


class Line(NamedTuple):
    """A record as it is in a file."""

    record: Record | Opened
    length: int
    checksum: int


def read_log(path: Path, lines: Iterable[bytes], run: str, keeper: int) -> Iterator[Line]:
    """Yield the records of a keeper's log in this run, up to a last line that was cut off.

    InputError if a line is not the next record of that log.
    """
    checksum = incarnation = 0
    for number, text in enumerate(lines, 1):
        if not text.endswith(b"\n"):  # cut off: whoever was to be answered was not
            return
        line = _line(path, number, text, checksum)
        record, checksum = line.record, line.checksum
        if isinstance(record, Opened):
            if (record.run, record.keeper) != (run, keeper):
                raise InputError(
                    f"{path}: line {number} is of keeper_{record.keeper} in run {record.run!r},"
                    f" expected keeper_{keeper} in run {run!r}"
                )
            if record.incarnation <= incarnation:
                raise InputError(
                    f"{path}: line {number} opens it in incarnation {record.incarnation},"
                    f" expected one after {incarnation}"
                )
            incarnation = record.incarnation
        elif number == 1:
            raise InputError(f"{path}: line 1 is a record, expected the keeper that opened the log")
        yield line


def _line(path: Path, number: int, text: bytes, before: int) -> Line:
    """Return a whole line as the record of this number; InputError if it is not that."""
    stored, _, numbered = text[:-1].partition(b" ")
    told, _, body = numbered.partition(b" ")
    if not told.isdigit() or len(told) > _DIGITS_MAX:
        raise InputError(f"{path}: line {number} is damaged, expected a record")
    if int(told) != number:
        raise InputError(
            f"{path}: line {number} has record {int(told)}, expected record {number}: records are"
            " missing, doubled or not in their order"
        )
    checksum = crc32(numbered, before)
    if stored != b"%08x" % checksum:
        raise InputError(
            f"{path}: line {number} lacks the checksum {checksum:08x} that was expected: it was"
            " changed, or a record before it"
        )
    try:
        record = _decoder.decode(body)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        raise InputError(f"{path}: line {number} is damaged, expected a record") from None
    return Line(record, len(text), checksum)


class FileJournal:
    """A journal in a file; what it says survives the end of the process, however that comes.

    It is handed to the operating system and not forced onto the disk, so a power failure may lose
    the last records. A context manager that closes the file.
    """

    def __init__(self, path: Path, opened: Opened, commits: int = 0) -> None:
        """Open or create the file, for this keeper in this incarnation.

        InputError if that fails, or it is not the log of this keeper, whole and in order, or has
        fewer commits than are known. A last line that was cut off is removed.
        """
        self.path = path
        self._opened = opened
        self._commits = array("q")
        """Of each commit the offset, the length, and the checksum of the record before."""
        self._end = self._number = self._checksum = 0
        try:
            self._file = appended_file(path)
            try:
                self._take_up(commits)
            except BaseException:
                self._file.close()
                raise
        except OSError as error:
            raise InputError(
                f"{path}: {error.strerror or error}, expected a keeper's log"
            ) from None

    def _take_up(self, commits: int) -> None:
        opened, incarnation = self._opened, 0
        self._file.seek(0)
        for line in read_log(self.path, self._file, opened.run, opened.keeper):
            self._added(line.record, line.length, line.checksum)
            if isinstance(line.record, Opened):
                incarnation = line.record.incarnation
        if opened.incarnation <= incarnation:
            raise InputError(
                f"{self.path}: was opened in incarnation {incarnation},"
                f" expected one before incarnation {opened.incarnation}"
            )
        found = len(self._commits) // _PER_COMMIT
        if found < commits:
            raise InputError(
                f"{self.path}: has {found} commits, expected the {commits} that were heard of: it"
                " is older"
            )
        self._file.truncate(self._end)
        self.append(opened)

    def __enter__(self) -> Self:
        """Return the journal."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self._file.close()

    def append(self, record: Record | Opened) -> None:
        """Add a record; CheckError if it cannot be written."""
        text = b"%d %b" % (self._number + 1, _encode(record))
        checksum = crc32(text, self._checksum)
        line = b"%08x %b\n" % (checksum, text)
        try:
            written = 0
            while written < len(line):
                written += os.write(self._file.fileno(), line[written:])
        except OSError as error:
            raise CheckError(
                f"{self.path}: the log of the keeper stopped: {error.strerror or error}"
            ) from None
        self._added(record, len(line), checksum)

    def _added(self, record: Record | Opened, length: int, checksum: int) -> None:
        if isinstance(record, Committed):
            self._commits.extend((self._end, length, self._checksum))
        self._end += length
        self._number += 1
        self._checksum = checksum

    def records(self) -> Iterator[Record]:
        """Yield all records, in their order."""
        with self.path.open("rb") as file:
            for line in read_log(self.path, file, self._opened.run, self._opened.keeper):
                if not isinstance(line.record, Opened):
                    yield line.record

    def commit(self, serial: int) -> Commit:
        """Return the commit of this serial number, from 1."""
        # Not by a buffered file: it would not know where what was appended since lies.
        begin = _PER_COMMIT * (serial - 1)
        offset, length, before = self._commits[begin : begin + _PER_COMMIT]
        line = os.pread(self._file.fileno(), length, offset)
        stored, _, numbered = line[:-1].partition(b" ")
        if stored == b"%08x" % crc32(numbered, before):
            record = _decoder.decode(numbered.partition(b" ")[2])
            if isinstance(record, Committed):
                return _moved(record)
        raise CheckError(f"{self.path}: commit {serial} was changed since it was written")


def _moved(record: Committed) -> Commit:
    moved = record.decision.commit
    if moved is None:
        raise CheckError("a commit without what it commits")
    return moved
