"""The log of a keeper: written before the keeper answers, and read when it restarts.

A record is one line: a checksum, the number of the record, from 1, and its JSON. The checksum is a
CRC-32 seeded with the checksum of the previous record, so each depends on all earlier records. The
first record names the keeper, and so does the record written each time the log is reopened. A last
line that a crash cut off does not count: the keeper had not answered for it.

A log that has grown is compacted: another is written whole and takes its place, so a crash leaves
either. It begins with the state of the units; then come the commits that the coordinator may not
have recorded yet, and of each module what is prepared or was decided last. Nothing else is ever
asked for: a keeper takes up no earlier attempt of a module, and what it prepares of one shows that
it has learned the outcome of those before.
"""

import os
from abc import abstractmethod
from array import array
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, Protocol, Self, TypeAlias
from zlib import crc32

import msgspec

from cubepath.agents.keepers.units import UnitsState
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


class Compacted(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="compacted"):
    """What all records before this one had come to, with those that follow up to the last commit.

    The first `commits` of this keeper are no longer in its log.
    """

    commits: int
    units: UnitsState
    entered: dict[int, int]
    """By module how often it has entered here."""
    unsettled: list[tuple[Decision, list[int]]]
    """Commits of this keeper, with the keepers that have not acknowledged them."""


class KeptCommit(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="kept"):
    """A commit that `Compacted` has taken into account, and the coordinator may ask for."""

    commit: Commit


Record: TypeAlias = (
    Prepared | Decided | Committed | JoinedRecord | Acknowledged | Compacted | KeptCommit
)
_decoder: msgspec.json.Decoder[Record | Opened] = msgspec.json.Decoder(
    Record | Opened, dec_hook=site_hook
)
_encode = msgspec.json.Encoder().encode
_PER_COMMIT = 3
_DIGITS_MAX = 18
_GROWN_BYTES = 1 << 20
"""A log is compacted when it has this length, and again when it has doubled."""


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

    @property
    @abstractmethod
    def grown(self) -> bool:
        """Return whether it is time to compact it."""

    @abstractmethod
    def compact(self, records: Iterable[Record]) -> None:
        """Replace all records by these; a crash, or a full disk, may leave those before."""


class MemoryJournal:
    """A journal that lasts as long as this process."""

    def __init__(self) -> None:
        """Begin empty."""
        self._records: list[Record] = []
        self._commits: dict[int, Commit] = {}
        self.grown = False

    def append(self, record: Record) -> None:
        """Add a record."""
        self._records.append(record)
        moved = commit_in(record)
        if moved is not None:
            self._commits[moved.serial] = moved

    def records(self) -> Iterator[Record]:
        """Yield all records, in their order."""
        return iter(tuple(self._records))

    def commit(self, serial: int) -> Commit:
        """Return the commit of this serial number, from 1."""
        return self._commits[serial]

    def compact(self, records: Iterable[Record]) -> None:
        """Replace all records by these."""
        records = list(records)
        self._records.clear()
        self._commits.clear()
        for record in records:
            self.append(record)


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
        if not text.endswith(b"\n"):  # cut off: the request was not answered
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
    digits, _, body = numbered.partition(b" ")
    if not digits.isdigit() or len(digits) > _DIGITS_MAX:
        raise InputError(f"{path}: line {number} is damaged, expected a record")
    if int(digits) != number:
        raise InputError(
            f"{path}: line {number} has record {int(digits)}, expected record {number}: records are"
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


class _LogFile:
    """A log as a file that is open: where it ends, and where its commits are."""

    def __init__(self, path: Path) -> None:
        """Open or create it; OSError if that fails."""
        self.file = appended_file(path)
        self.commits = array("q")
        """Of each commit the offset, the length, and the checksum of the record before."""
        self.forgotten = 0
        """How many commits came before these."""
        self.end = self._number = self._checksum = 0

    def write(self, record: Record | Opened) -> None:
        """Add a record; OSError if it cannot be written."""
        text = b"%d %b" % (self._number + 1, _encode(record))
        checksum = crc32(text, self._checksum)
        line = b"%08x %b\n" % (checksum, text)
        written = 0
        while written < len(line):
            written += os.write(self.file.fileno(), line[written:])
        self.added(Line(record, len(line), checksum))

    def added(self, line: Line) -> None:
        """Note a record that is in the file."""
        if isinstance(line.record, Compacted):
            self.forgotten = line.record.commits
        elif isinstance(line.record, Committed | KeptCommit):
            self.commits.extend((self.end, line.length, self._checksum))
        self.end += line.length
        self._number += 1
        self._checksum = line.checksum


class FileJournal:
    """A journal in a file; what it says survives the end of the process, however that comes.

    It is handed to the operating system and not forced onto the disk, so a power failure may lose
    the last records. A context manager that closes the file.
    """

    def __init__(self, path: Path, opened: Opened, commits: int = 0) -> None:
        """Open or create the file, for this keeper in this incarnation.

        InputError if that fails, or it is not the log of this keeper, whole and in order, or has
        fewer commits than are known, or only later ones. A last line that was cut off is removed.
        """
        self.path = path
        self._opened = opened
        self._compacted = 0
        """The length from which it is counted how much the log has grown."""
        try:
            self._log = _LogFile(path)
            try:
                self._take_up(commits)
            except BaseException:
                self._log.file.close()
                raise
        except OSError as error:
            raise InputError(
                f"{path}: {error.strerror or error}, expected a keeper's log"
            ) from None

    def _take_up(self, commits: int) -> None:
        opened, incarnation, log = self._opened, 0, self._log
        log.file.seek(0)
        for line in read_log(self.path, log.file, opened.run, opened.keeper):
            log.added(line)
            if isinstance(line.record, Opened):
                incarnation = line.record.incarnation
        if opened.incarnation <= incarnation:
            raise InputError(
                f"{self.path}: was opened in incarnation {incarnation},"
                f" expected one before incarnation {opened.incarnation}"
            )
        found = log.forgotten + len(log.commits) // _PER_COMMIT
        if found < commits:
            raise InputError(
                f"{self.path}: has {found} commits, expected the {commits} that were heard of: it"
                " is older"
            )
        check_kept(self.path, log.forgotten, commits)
        log.file.truncate(log.end)
        self.append(opened)

    def __enter__(self) -> Self:
        """Return the journal."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self._log.file.close()

    def append(self, record: Record | Opened) -> None:
        """Add a record; CheckError if it cannot be written."""
        try:
            self._log.write(record)
        except OSError as error:
            raise CheckError(
                f"{self.path}: the log of the keeper stopped: {error.strerror or error}"
            ) from None

    def records(self) -> Iterator[Record]:
        """Yield all records, in their order."""
        with self.path.open("rb") as file:
            for line in read_log(self.path, file, self._opened.run, self._opened.keeper):
                if not isinstance(line.record, Opened):
                    yield line.record

    def commit(self, serial: int) -> Commit:
        """Return the commit of this serial number, from 1."""
        # Not by a buffered file: it would not know where what was appended since lies.
        log = self._log
        begin = _PER_COMMIT * (serial - 1 - log.forgotten)
        offset, length, before = log.commits[begin : begin + _PER_COMMIT]
        line = os.pread(log.file.fileno(), length, offset)
        stored, _, numbered = line[:-1].partition(b" ")
        if stored == b"%08x" % crc32(numbered, before):
            moved = commit_in(_decoder.decode(numbered.partition(b" ")[2]))
            if moved is not None:
                return moved
        raise CheckError(f"{self.path}: commit {serial} was changed since it was written")

    @property
    def grown(self) -> bool:
        """Return whether it is long, and has doubled since it was compacted."""
        return self._log.end > max(_GROWN_BYTES, 2 * self._compacted)

    def compact(self, records: Iterable[Record]) -> None:
        """Write these records to a new file, which then takes the place of the old one.

        If that cannot be done, the old one is continued until it has doubled again.
        """
        path, fresh = self.path.with_suffix(".new"), None
        try:
            path.unlink(missing_ok=True)
            fresh = _LogFile(path)
            for record in (self._opened, *records):
                fresh.write(record)
            path.replace(self.path)
            self._log, fresh = fresh, self._log
        except OSError:
            with suppress(OSError):
                path.unlink()
        finally:
            if fresh is not None:
                fresh.file.close()
            self._compacted = self._log.end


def commit_in(record: Record | Opened) -> Commit | None:
    """Return the commit of this keeper that a record has, None if it has none."""
    match record:
        case Committed(decision=decision):
            return decision.commit
        case KeptCommit(commit=moved):
            return moved
        case _:
            return None


def check_kept(path: Path, forgotten: int, commits: int) -> None:
    """Check that what is not in a log any more is known; InputError if not."""
    if forgotten > commits:
        raise InputError(
            f"{path}: begins after commit {forgotten}, and {commits} were heard of, expected"
            " a recording with all commits before"
        )
