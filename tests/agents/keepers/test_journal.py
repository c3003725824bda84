"""The log of a keeper: what is read back, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from cubepath.agents.keepers.journal import (
    Acknowledged,
    Born,
    Committed,
    Decided,
    FileJournal,
    Journal,
    MemoryJournal,
    Prepared,
    Record,
)
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.wire.free_messages import Attempt, Decision, Enter, Moved, Passed


def _passed(number: int) -> Passed:
    return Passed(Attempt(0, 0, number, 0, [0, 0]), 0, 0, [], [], [], [], [])


def _committed(serial: int) -> Committed:
    moved = Moved(0, serial, 0, 0, serial, 0, 1)
    return Committed(_passed(serial), Decision(0, 0, serial, moved=moved))


RECORDS: list[Record] = [
    Prepared(_passed(1)),
    _committed(1),
    Acknowledged(1, 0, 0, 1),
    Decided(Decision(0, 0, 2, why="refused")),
    Born(Enter(0, 1)),
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
    with FileJournal(path) as file:
        _filled(file)
    with FileJournal(path) as again:
        for journal in (memory, again):
            assert [*journal.records()] == RECORDS
            assert [journal.commit(serial).serial for serial in (1, 2)] == [1, 2]


def test_commits_are_read_between_appends(tmp_path: Path) -> None:
    """Whatever was read ahead before."""
    with FileJournal(tmp_path / "log") as journal:
        for serial in range(1, 6):
            journal.append(_committed(serial))
            assert [journal.commit(each).serial for each in range(1, serial + 1)] == [
                *range(1, serial + 1)
            ]
            journal.append(RECORDS[2])


@pytest.mark.parametrize("cut", [1, 2, 30])
def test_a_line_that_was_cut_off_is_no_record(tmp_path: Path, cut: int) -> None:
    """It is taken off, so what is appended next is whole."""
    path = tmp_path / "log"
    with FileJournal(path) as journal:
        _filled(journal)
    path.write_bytes(path.read_bytes()[:-cut])
    with FileJournal(path) as journal:
        assert [*journal.records()] == RECORDS[:-1]
        journal.append(_committed(2))
        assert [*journal.records()] == RECORDS
        assert journal.commit(2).serial == 2


@pytest.mark.parametrize("line", range(len(RECORDS)))
@pytest.mark.parametrize("at", [0, 8, 9, 20])
def test_a_damaged_line_is_refused(tmp_path: Path, line: int, at: int) -> None:
    """Also the last one, if it is whole: it may have been answered."""
    path = tmp_path / "log"
    with FileJournal(path) as journal:
        _filled(journal)
    lines = path.read_bytes().splitlines(keepends=True)
    lines[line] = lines[line][:at] + b"?" + lines[line][at + 1 :]
    path.write_bytes(b"".join(lines))
    with pytest.raises(InputError, match=f"log: line {line + 1} is damaged, expected a record"):
        FileJournal(path)


def test_a_commit_that_was_changed_since_is_noticed(tmp_path: Path) -> None:
    """It is not told as what it is not."""
    path = tmp_path / "log"
    with FileJournal(path) as journal:
        journal.append(_committed(1))
        path.write_bytes(path.read_bytes().replace(b"committed", b"Committed"))
        with pytest.raises(CheckError, match="commit 1 was changed"):
            journal.commit(1)


def test_a_full_disk_ends_a_keeper(tmp_path: Path) -> None:
    """With a line that says so; nothing was logged."""
    with FileJournal(tmp_path / "log") as journal:
        journal._file.close()
        journal._file = Path("/dev/full").open("r+b")  # noqa: SIM115 - closed with the journal
        with pytest.raises(CheckError, match="log of the keeper stopped: No space left"):
            journal.append(RECORDS[0])
        assert [*journal.records()] == []


def test_a_log_never_leads_through_a_link(tmp_path: Path) -> None:
    """What the link leads to keeps its bytes."""
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "keeper-0.log").symlink_to("mine")
    with pytest.raises(InputError, match="symbolic links, expected a keeper's log"):
        FileJournal(tmp_path / "keeper-0.log")
    assert (tmp_path / "mine").read_text() == "mine"


def test_a_log_that_cannot_be_opened_is_bad_input(tmp_path: Path) -> None:
    """With the path, and why."""
    with pytest.raises(InputError, match="Is a directory, expected a keeper's log"):
        FileJournal(tmp_path)
