"""Journals of keepers: what was written is read, whatever was read before."""

from __future__ import annotations

from pathlib import Path

from cubepath.agents.keepers.journal import Born, Committed, FileJournal
from cubepath.protocol.wire.free_messages import Attempt, Decision, Enter, Moved, Passed


def commit(serial: int) -> Committed:
    """Return a record of a commit that is as long as records are."""
    attempt = Attempt(
        0, 1, serial, serial, [0, 0], "move", [0, 0], [([n, 0], None) for n in range(9)]
    )
    moved = Moved(0, serial, 0, 1, serial, serial, serial, "move", [0, 0])
    passed = Passed(attempt, 0, 0, [], [], [], [], [])
    return Committed(passed, Decision(0, 1, serial, moved=moved))


def test_every_commit_is_read_between_those_written(tmp_path: Path) -> None:
    """Reading does not depend on what was read, and writing on where that ended."""
    with FileJournal(tmp_path / "log") as journal:
        for serial in range(1, 120):
            journal.append(commit(serial))
            if serial > 60:  # the second of these lies across any boundary of what is read at once
                assert [journal.commit(serial - 60).serial] == [serial - 60]
                journal.append(Born(Enter(0, serial)))
                assert [journal.commit(serial - 59).serial] == [serial - 59]


def test_a_torn_record_is_as_if_it_had_never_been(tmp_path: Path) -> None:
    """The next keeper finds what was whole, and writes after that."""
    path = tmp_path / "log"
    with FileJournal(path) as journal:
        journal.append(commit(1))
        whole = path.stat().st_size
        journal.append(Born(Enter(0, 2)))
    with path.open("r+b") as file:
        file.truncate(whole + 7)
    with FileJournal(path) as journal:
        assert list(journal.records()) == [commit(1)]
        journal.append(commit(2))
        assert journal.commit(2).serial == 2
        assert list(journal.records()) == [commit(1), commit(2)]
