"""The log of a keeper: what is read back, and what is refused."""

import os
import re
from functools import cache
from pathlib import Path
from typing import TypeAlias
from zlib import crc32

import msgspec
import pytest

from cubepath.agents.keepers.journal import (
    Acknowledged,
    Committed,
    Compacted,
    Decided,
    FileJournal,
    JoinedRecord,
    Journal,
    KeptCommit,
    MemoryJournal,
    Opened,
    Prepared,
    Record,
)
from cubepath.agents.keepers.keeper import Keeper
from cubepath.agents.keepers.units import UnitsState
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.wire.free_messages import Attempt, Commit, Decision, EnterRequest, Forwarded
from samples.free_runs import FreeRun

Lines: TypeAlias = list[bytes]


def opened(incarnation: int = 1, *, run: str = "run", keeper: int = 0) -> Opened:
    """Return the keeper that opens a log."""
    return Opened(run, keeper, incarnation)


def _passed(number: int) -> Forwarded:
    return Forwarded(Attempt(0, 0, number, 0, (0, 0)), 0, 0, [], [], [], [], [])


def _committed(serial: int) -> Committed:
    moved = Commit(0, serial, 0, 0, serial, 0, 1)
    return Committed(_passed(serial), Decision(0, 0, serial, commit=moved))


RECORDS: list[Record] = [
    Prepared(_passed(1)),
    _committed(1),
    Acknowledged(1, 0, 0, 1),
    Decided(Decision(0, 0, 2, reason="refused")),
    JoinedRecord(EnterRequest(0, 1)),
    _committed(2),
]


def _filled(journal: Journal) -> None:
    for record in RECORDS:
        journal.append(record)


def test_records_and_commits_are_read_back(tmp_path: Path) -> None:
    """In their order, from memory, from the file, and from the file opened again."""
    memory = MemoryJournal()
    _filled(memory)
    path = tmp_path / "log"
    with FileJournal(path, opened()) as file:
        _filled(file)
    with FileJournal(path, opened(2)) as again:
        for journal in (memory, again):
            assert [*journal.records()] == RECORDS
            assert [journal.commit(serial).serial for serial in (1, 2)] == [1, 2]


def test_commits_are_read_between_appends(tmp_path: Path) -> None:
    """Whatever was read ahead before."""
    with FileJournal(tmp_path / "log", opened()) as journal:
        for serial in range(1, 6):
            journal.append(_committed(serial))
            assert [journal.commit(each).serial for each in range(1, serial + 1)] == [
                *range(1, serial + 1)
            ]
            journal.append(RECORDS[2])


def test_a_record_is_whole_however_little_is_written_at_a_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An operating system may write less than it was given."""
    real = os.write
    monkeypatch.setattr(os, "write", lambda file, data: real(file, data[:7]))
    with FileJournal(tmp_path / "log", opened()) as journal:
        _filled(journal)
        assert [*journal.records()] == RECORDS


def test_a_log_has_grown_when_it_is_long_and_has_doubled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Since it was compacted last, if it was; long is more than a mebibyte."""
    path, record, compacted = tmp_path / "log", RECORDS[0], 0
    with FileJournal(path, opened()) as log:
        for log._log.end, grown in ((1 << 20, False), ((1 << 20) + 1, True)):
            assert log.grown == grown
    with FileJournal(path, opened(2)) as log:
        log.append(record)
        long = path.stat().st_size
        monkeypatch.setattr("cubepath.agents.keepers.journal._GROWN_BYTES", long)
        for _ in range(20):
            assert log.grown == (path.stat().st_size > max(long, 2 * compacted))
            if log.grown:
                log.compact([record] * 3)
                compacted = path.stat().st_size
            log.append(record)
    assert compacted > long


def test_what_is_compacted_takes_the_place_of_all_before(tmp_path: Path) -> None:
    """Records and commits, in memory and in a file; what a compaction that died left counts not."""
    memory = MemoryJournal()
    (tmp_path / "log.new").write_bytes(b"left over\n")
    with FileJournal(tmp_path / "log", opened()) as file:
        for log in (memory, file):
            _filled(log)
            log.compact(iter(RECORDS[4:]))
            assert [*log.records()] == RECORDS[4:]
    with pytest.raises(KeyError):
        memory.commit(1)
    with FileJournal(tmp_path / "log", opened(2)) as again:
        assert [*again.records()] == RECORDS[4:]


OPEN = Path("/proc/self/fd")


def test_no_file_stays_open(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After a log was closed, refused, or compacted, even in vain."""

    def fails(*_: object) -> None:
        raise OSError

    before = len([*OPEN.iterdir()])
    with FileJournal(tmp_path / "log", opened()) as log:
        log.compact(RECORDS)
        monkeypatch.setattr(Path, "replace", fails)
        log.compact(RECORDS)
        assert len([*OPEN.iterdir()]) == before + 1
    with pytest.raises(InputError) as kept:
        FileJournal(tmp_path / "log", opened())
    assert len([*OPEN.iterdir()]) == before
    assert "incarnation 1" in str(kept.value)


@pytest.mark.slow
def test_a_line_that_was_cut_off_anywhere_is_no_record(tmp_path: Path) -> None:
    """Also the first one. It is taken off, so what is appended next is whole."""
    path = tmp_path / "log"
    with FileJournal(path, opened()) as journal:
        _filled(journal)
    first, *lines = path.read_bytes().splitlines(keepends=True)
    for left in range(1, len(lines[-1])):
        path.write_bytes(b"".join((first, *lines[:-1], lines[-1][:left])))
        with FileJournal(path, opened(2)) as journal:
            assert [*journal.records()] == RECORDS[:-1]
            journal.append(_committed(2))
            assert [*journal.records()] == RECORDS
            assert journal.commit(2).serial == 2
    for left in range(len(first)):
        path.write_bytes(first[:left])
        with FileJournal(path, opened()) as journal:
            assert [*journal.records()] == []
        assert path.read_bytes() == first


@pytest.mark.parametrize("line", range(1 + len(RECORDS)))
@pytest.mark.parametrize("at", [0, 8, 9, 12, 20])
def test_a_damaged_line_is_refused(tmp_path: Path, line: int, at: int) -> None:
    """Also the last one, if it is whole: it may have been answered."""
    path = tmp_path / "log"
    with FileJournal(path, opened()) as journal:
        _filled(journal)
    lines = path.read_bytes().splitlines(keepends=True)
    lines[line] = lines[line][:at] + b"?" + lines[line][at + 1 :]
    path.write_bytes(b"".join(lines))
    with pytest.raises(InputError, match=f"log: line {line + 1} .*expected"):
        FileJournal(path, opened(2))


@pytest.mark.parametrize("deep", [False, True])
@pytest.mark.parametrize("body", [b"", b"{}", b'{"type":"\xff"}', b'{"type":"decided","x":'])
def test_a_line_with_a_right_checksum_that_is_no_record_is_refused(
    tmp_path: Path, body: bytes, *, deep: bool
) -> None:
    """Whatever the decoder makes of it."""
    path = tmp_path / "log"
    text = b"1 " + body + b"[" * (9999 * deep)
    path.write_bytes(b"%08x %b\n" % (crc32(text), text))
    with pytest.raises(InputError, match="log: line 1 is damaged, expected a record"):
        FileJournal(path, opened())


def test_a_log_begins_with_the_keeper_that_opened_it(tmp_path: Path) -> None:
    """Not with a record, whosever that is."""
    text = b"1 " + msgspec.json.encode(RECORDS[0])
    (tmp_path / "log").write_bytes(b"%08x %b\n" % (crc32(text), text))
    with pytest.raises(InputError, match="log: line 1 is a record, expected the keeper that"):
        FileJournal(tmp_path / "log", opened())


OTHERS = (
    opened(),
    Compacted(0, UnitsState([], [], [], {}), {}, []),
    KeptCommit(Commit(0, 1, 0, 0, 1, 0, 1)),
)


@pytest.mark.parametrize("record", [*RECORDS, *OTHERS], ids=lambda each: type(each).__name__)
def test_a_field_that_is_none_of_its_kind_is_refused(
    record: Record | Opened, tmp_path: Path
) -> None:
    """In any record: it was written by another program."""
    path = tmp_path / "log"
    with FileJournal(path, opened()):
        before = int(path.read_bytes()[:8], 16)
    text = b"2 " + msgspec.json.encode({**msgspec.to_builtins(record), "x": 1})
    path.write_bytes(path.read_bytes() + b"%08x %b\n" % (crc32(text, before), text))
    with pytest.raises(InputError, match="log: line 2 is damaged, expected a record"):
        FileJournal(path, opened(2))


@pytest.mark.parametrize(
    ("digits", "why"), [(18, "has record 9"), (19, "damaged"), (5000, "damaged")]
)
def test_a_long_number_is_damage(digits: int, why: str, tmp_path: Path) -> None:
    """No log has so many records, and Python reads no number of thousands of digits."""
    path = tmp_path / "log"
    path.write_bytes(b"00000000 %b {}\n" % (b"9" * digits))
    with pytest.raises(InputError, match=f"log: line 1 .*{why}"):
        FileJournal(path, opened())


@cache
def _records(keeper: int) -> tuple[Record, ...]:
    """Return the records of a keeper in a run whose modules were started again."""
    run = FreeRun("hex:n=5", keepers=2, seed=1)
    run.play(30, restarts=2)
    return tuple(run.keepers[keeper]._journal.records())


def _lines(path: Path, keeper: int = 0, run: str = "run") -> Lines:
    """Return the lines of its log, which was opened twice."""
    records = _records(keeper)
    half = len(records) // 2
    for incarnation, part in ((1, records[:half]), (2, records[half:])):
        with FileJournal(path, opened(incarnation, run=run, keeper=keeper)) as journal:
            for record in part:
                journal.append(record)
    return path.read_bytes().splitlines(keepends=True)


def _altered(kind: str, lines: Lines, at: int, others: dict[str, Lines]) -> Lines:
    """Return the lines of a log to one of which something was done."""
    altered, line, far = [*lines], lines[at], (at + len(lines) // 2) % len(lines)
    match kind:
        case "removed":
            del altered[at]
        case "doubled":
            altered.insert(at, line)
        case "swapped with the next":
            altered[at : at + 2] = lines[at + 1], line
        case "swapped with a distant one":
            altered[at], altered[far] = lines[far], line
        case "replaced by one of the same log":
            altered[at] = lines[far]
        case "replaced with a right checksum":
            text = b"%d %b" % (at + 1, lines[far].split(b" ", 2)[2][:-1])
            checksum = crc32(text, int(lines[at - 1][:8], 16) if at else 0)
            altered[at] = b"%08x %b\n" % (checksum, text)
        case "changed":
            altered[at] = line[:-3] + b"?" + line[-2:]
        case _:
            altered[at] = others[kind][at % len(others[kind])]
    return altered


# What can be done to a record, and to how many of the last ones it leaves a log that can be.
DONE = {
    "removed": 1,
    "doubled": 0,
    "swapped with the next": 1,
    "swapped with a distant one": 0,
    "replaced by one of the same log": 0,
    "replaced by one of another keeper": 0,
    "replaced by the same one of another run": 0,
    "replaced with a right checksum": 1,
    "changed": 0,
}


@pytest.mark.parametrize("kind", DONE)
def test_what_was_done_to_a_record_is_found(kind: str, tmp_path: Path) -> None:
    """To every record of a log; in its line, or the one after it."""
    path = tmp_path / "log"
    lines = _lines(path)
    others = {
        "replaced by one of another keeper": _lines(tmp_path / "keeper", keeper=1),
        "replaced by the same one of another run": _lines(tmp_path / "run", run="other"),
    }
    assert len(lines) > 100
    for at in range(len(lines) - DONE[kind]):
        path.write_bytes(b"".join(_altered(kind, lines, at, others)))
        with pytest.raises(InputError) as error:
            FileJournal(path, opened(3))
        first = min(at, (at + len(lines) // 2) % len(lines)) if "distant" in kind else at
        assert re.fullmatch(
            rf"{path}: line ({first + 1}|{first + 2}) [^\n]*expected[^\n]*", str(error.value)
        )


@pytest.mark.slow
def test_a_log_that_was_written_anew_is_believed_or_refused(tmp_path: Path) -> None:
    """Without a record, and with right numbers and checksums: nothing else is raised."""
    run = FreeRun("hex:n=5", keepers=2)
    records, refusals = _records(0), list[str]()
    for at in range(len(records)):
        journal = MemoryJournal()
        for record in (*records[:at], *records[at + 1 :]):
            journal.append(record)
        try:
            Keeper(0, run.scene, run.tiles, journal)
        except InputError as error:
            refusals.append(str(error))
    assert refusals
    assert all(re.fullmatch(r".* of keeper_0 cannot follow .*, expected .*", e) for e in refusals)


def test_a_log_is_opened_by_later_incarnations_alone(tmp_path: Path) -> None:
    """An older file of incarnations is noticed, and one with too few commits."""
    path = tmp_path / "log"
    with FileJournal(path, opened(2)) as journal:
        _filled(journal)
    before = path.read_bytes()
    with pytest.raises(
        InputError, match="log: was opened in incarnation 2, expected one before incarnation 2"
    ):
        FileJournal(path, opened(2))
    with pytest.raises(InputError, match="log: has 2 commits, expected the 3 that were heard of"):
        FileJournal(path, opened(3), commits=3)
    assert path.read_bytes() == before
    with FileJournal(path, opened(3)) as journal:
        journal.append(opened(3))
    with pytest.raises(
        InputError, match="log: line 9 opens it in incarnation 3, expected one after 3"
    ):
        FileJournal(path, opened(4))


def test_a_commit_that_was_changed_since_is_noticed(tmp_path: Path) -> None:
    """It is not told as what it is not."""
    path = tmp_path / "log"
    with FileJournal(path, opened()) as journal:
        journal.append(_committed(1))
        path.write_bytes(path.read_bytes().replace(b"committed", b"Committed"))
        with pytest.raises(CheckError, match="commit 1 was changed"):
            journal.commit(1)


def test_a_full_disk_ends_a_keeper(tmp_path: Path) -> None:
    """With a line that says so; nothing was logged."""
    with FileJournal(tmp_path / "log", opened()) as journal:
        journal._log.file.close()
        journal._log.file = Path("/dev/full").open("r+b")  # noqa: SIM115 - closed with the journal
        with pytest.raises(CheckError, match="log of the keeper stopped: No space left"):
            journal.append(RECORDS[0])
        assert [*journal.records()] == []


def test_a_log_never_leads_through_a_link(tmp_path: Path) -> None:
    """What the link leads to keeps its bytes."""
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "keeper-0.log").symlink_to("mine")
    with pytest.raises(InputError, match="symbolic links, expected a keeper's log"):
        FileJournal(tmp_path / "keeper-0.log", opened())
    assert (tmp_path / "mine").read_text() == "mine"


def test_a_log_that_cannot_be_opened_is_bad_input(tmp_path: Path) -> None:
    """With the path, and why."""
    with pytest.raises(InputError, match="Is a directory, expected a keeper's log"):
        FileJournal(tmp_path, opened())
