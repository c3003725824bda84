"""Logs of keepers that are older than what else is known of their run."""

import re
import shutil
from pathlib import Path

import pytest

from cubepath.agents.free.fleet import INCARNATIONS, log_of, next_incarnations
from cubepath.agents.keepers.attempts import chain_of, planned
from cubepath.agents.keepers.journal import (
    Acknowledged,
    Committed,
    Decided,
    FileJournal,
    MemoryJournal,
    Opened,
    Prepared,
    Record,
)
from cubepath.agents.keepers.keeper import Keeper, name_of
from cubepath.coordinator.runs.resuming import check_logs
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.wire.free_messages import Attempt, Requests
from samples.free_runs import FreeRun, write

KEEPERS = 2


class Kept:
    """The logs of a run that was played, and what is on record of it."""

    def __init__(self, folder: Path, *, seed: int = 1, tails: bool = True) -> None:
        """Play it."""
        run = self.run = FreeRun("hex:n=5", keepers=KEEPERS, seed=seed)
        messages = run.play(15, restarts=2)
        recorded = messages if tails else messages[:1]
        path = write(folder / "run.mcap", run.scene, recorded, keepers=KEEPERS)
        self.recording: Recording = read_recording(path)
        self.folder = folder / "logs"
        self.incarnations = next_incarnations(self.folder, "run")
        self.records: list[list[Record]] = []
        for keeper in range(KEEPERS):
            self.records.append([*run.keepers[keeper]._journal.records()])
            self.write(keeper, self.records[-1])
        self.logs = [log_of(self.folder, keeper).read_bytes() for keeper in range(KEEPERS)]

    def write(self, keeper: int, records: list[Record]) -> None:
        """Write a log that has these records."""
        opened = Opened(self.incarnations.run, keeper, self.incarnations.incarnation)
        path = log_of(self.folder, keeper)
        path.unlink(missing_ok=True)
        with FileJournal(path, opened) as journal:
            for record in records:
                journal.append(record)

    def compacted(self, keeper: int, records: list[Record], recorded: int) -> list[Record]:
        """Return the records of a log that was compacted after these, and begins after a commit."""
        journal = MemoryJournal()
        for record in records:
            journal.append(record)
        found = Keeper(keeper, self.run.scene, self.run.tiles, journal)
        return [*found._compacted(min(recorded, found.commits))]

    def refusal(self) -> str:
        """Return why the logs as they are now are refused; nothing if they are not."""
        try:
            check_logs(self.folder, self.recording, KEEPERS)
        except InputError as error:
            return str(error)
        return ""

    def believed(self, keeper: int) -> list[int]:
        """Return how many records of a log may be missing at its end without being noticed."""
        lines = self.logs[keeper].splitlines(keepends=True)
        path, found = log_of(self.folder, keeper), []
        for missing in range(1, len(lines)):
            path.write_bytes(b"".join(lines[:-missing]))
            refusal = self.refusal()
            if refusal:
                assert re.fullmatch(rf"({path}|{self.folder}): .*, expected .*older.*", refusal)
            else:
                found.append(missing)
        path.write_bytes(self.logs[keeper])
        return found


def of_no_consequence(record: Record, records: list[Record]) -> bool:
    """Return whether it is known to nobody else: of an attempt that came to nothing, or settled."""
    match record:
        case Acknowledged():
            return True
        case Decided(decision=decision):
            return decision.commit is None
        case Prepared(passed=passed):
            name = passed.attempt.module, passed.attempt.epoch, passed.attempt.number
            return not any(
                isinstance(each, Decided | Committed)
                and each.decision.commit is not None
                and (each.decision.module, each.decision.epoch, each.decision.number) == name
                for each in records
            )
        case _:
            return False


@pytest.mark.slow
@pytest.mark.parametrize("recorded", [True, False])
@pytest.mark.parametrize("keeper", range(KEEPERS))
def test_a_log_that_lacks_what_others_know_is_refused(
    tmp_path: Path, keeper: int, *, recorded: bool
) -> None:
    """However much is missing at its end; what is believed lacks nothing of consequence."""
    kept = Kept(tmp_path, tails=recorded)
    assert not kept.refusal()
    records = kept.records[keeper]
    believed = kept.believed(keeper)
    assert len(believed) < len(records) / 4
    if recorded:
        for missing in believed:
            assert all(of_no_consequence(each, records) for each in records[-missing:])
    log_of(kept.folder, keeper).unlink()
    assert "older" in kept.refusal()
    log_of(kept.folder, keeper).mkdir()
    assert kept.refusal().endswith("Is a directory, expected a keeper's log")


@pytest.mark.slow
@pytest.mark.parametrize("keeper", range(KEEPERS))
@pytest.mark.parametrize("forgotten", [3, 999])
@pytest.mark.few(2)
@pytest.mark.parametrize("seed", [3, 5, 7])
def test_an_older_log_is_refused_if_logs_are_compacted(
    tmp_path: Path, seed: int, keeper: int, forgotten: int
) -> None:
    """Whether the older one is compacted or not; what is believed lacks nothing of consequence."""
    kept = Kept(tmp_path, seed=seed)
    for other in range(KEEPERS):
        kept.write(other, kept.compacted(other, kept.records[other], forgotten))
    assert not kept.refusal()
    records, believed = kept.records[keeper], 0
    for end in range(len(records)):
        left = records[:end]
        for log in (left, kept.compacted(keeper, left, forgotten)):
            kept.write(keeper, log)
            refusal = kept.refusal()
            assert not refusal or "older" in refusal
            if not refusal:
                believed += 1
                assert all(of_no_consequence(each, records) for each in records[end:])
    assert believed < len(records)


def test_a_compacted_log_shows_who_has_not_acknowledged_a_commit(tmp_path: Path) -> None:
    """The keeper before in the chain has prepared it."""
    kept = Kept(tmp_path, tails=False)
    first, last = kept.records
    prepared = {
        name_of(each.passed.attempt): place
        for place, each in enumerate(first)
        if isinstance(each, Prepared)
    }
    end, place = next(
        (end, prepared[name_of(each.decision)])
        for end, each in enumerate(last, 1)
        if isinstance(each, Committed) and name_of(each.decision) in prepared
    )
    kept.write(1, kept.compacted(1, last[:end], 0))
    kept.write(0, first[: place + 1])
    assert not kept.refusal()
    kept.write(0, first[:place])
    assert re.search(r"keeper_0\.log: the last prepared attempt of module_", kept.refusal())


def test_a_compacted_log_shows_in_which_epochs_modules_acted(tmp_path: Path) -> None:
    """Also if all attempts in an epoch were refused: the keeper that granted it has logged that."""
    kept = Kept(tmp_path, seed=4, tails=False)
    first, _ = kept.records
    end = next(
        end
        for end, each in enumerate(first, 1)
        if isinstance(each, Decided) and each.decision.commit is None and each.decision.epoch > 1
    )
    kept.write(0, kept.compacted(0, first[:end], 0))
    kept.write(1, [])
    assert re.search(r"module_\d entered 1 times, expected 2 as in", kept.refusal())


def test_a_log_that_begins_after_what_is_on_record_is_refused(tmp_path: Path) -> None:
    """The commits before would be lost."""
    kept = Kept(tmp_path)
    count = sum(isinstance(each, Committed) for each in kept.records[0])
    write(kept.recording.path.with_name("less.mcap"), kept.run.scene, [], keepers=KEEPERS)
    kept.write(0, kept.compacted(0, kept.records[0], count))
    assert not kept.refusal()
    kept.recording = read_recording(kept.recording.path.with_name("less.mcap"))
    assert re.search(rf"keeper_0\.log: begins after commit {count}, and 0 were", kept.refusal())


def test_incarnations_that_are_older_than_a_log_are_refused(tmp_path: Path) -> None:
    """The next ones would not be later than those before."""
    kept = Kept(tmp_path)
    before = (kept.folder / INCARNATIONS).read_bytes()
    incarnations = next_incarnations(kept.folder, "other")
    with FileJournal(log_of(kept.folder, 1), Opened(incarnations.run, 1, incarnations.incarnation)):
        pass
    assert not kept.refusal()
    (kept.folder / INCARNATIONS).write_bytes(before)
    assert re.search(
        r"incarnations: the incarnation is 1, .* was opened in incarnation 1000001", kept.refusal()
    )


@pytest.mark.parametrize("spec", ["hex:n=5", "arm:n=6", "agv:graph=grid6x6,n=6"])
def test_the_keepers_of_an_attempt_are_those_of_its_plan(spec: str) -> None:
    """Also where it was not planned again."""
    run = FreeRun(spec, keepers=3)
    asked = [each for said in run.play(10) if isinstance(said, Requests) for each in said.parts]
    attempts = [each for each in asked if isinstance(each, Attempt)]
    assert attempts
    for each in attempts:
        assert chain_of(run.system, run.tiles, each) == planned(run.system, run.tiles, each).chain


def test_logs_of_another_run_are_refused(tmp_path: Path) -> None:
    """Of the same scene, with incarnations of their own: other commits are on record."""
    kept = Kept(tmp_path)
    (tmp_path / "other").mkdir()
    other = Kept(tmp_path / "other", seed=2)
    shutil.rmtree(kept.folder)
    other.folder.rename(kept.folder)
    assert re.search(
        r"keeper_\d\.log: commit \d+ of keeper_\d .* differs from what", kept.refusal()
    )
