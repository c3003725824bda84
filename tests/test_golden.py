"""Golden recordings: readable, right, and what runs of today say; `golden.py` makes them anew."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from cubepath.coordinator.auditing.rule_audit import audit
from cubepath.coordinator.playback.player import replay
from cubepath.coordinator.runs.run import run
from cubepath.coordinator.verification.recording import verify
from cubepath.coordinator.verification.recovery import recover
from cubepath.protocol.recordings.recording import Recording, read_recording
from golden import FOLDER, PLANS, path_of, write

WITH_ROUNDS = [name for name, plan in PLANS.items() if not plan.is_free]


def test_they_are_those_of_the_script() -> None:
    """Each has its plan there, and no other file is in the folder."""
    assert {path.stem for path in FOLDER.iterdir()} == PLANS.keys()


@pytest.fixture(params=PLANS)
def golden(request: pytest.FixtureRequest) -> Recording:
    """Read one of them."""
    return read_recording(path_of(request.param))


@pytest.mark.parametrize("name", WITH_ROUNDS)
def test_a_golden_recording_is_what_the_script_writes(name: str, tmp_path: Path) -> None:
    """If it is not, what recordings hold has changed: see `golden.py`, and commit the files."""
    again, golden = (read_recording(each) for each in (write(name, tmp_path), path_of(name)))
    assert (again.format, again.parameters) == (golden.format, golden.parameters)
    assert list(again.records) == list(golden.records)


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("name", WITH_ROUNDS)
def test_real_processes_say_what_is_on_record(name: str, tmp_path: Path) -> None:
    """The same messages; only the order of those of several processes in a phase is another."""
    run(replace(PLANS[name], log=tmp_path / "again.mcap"))
    said, golden = (
        Counter((each.topic, each.round, each.data) for each in read_recording(path).records)
        for path in (tmp_path / "again.mcap", path_of(name))
    )
    assert said == golden


@pytest.mark.slow
def test_a_golden_run_without_rounds_can_be_run_again(tmp_path: Path) -> None:
    """In the same format, with the same parameters, and to the same path."""
    again, golden = (
        read_recording(each) for each in (write("hex-free-5", tmp_path), path_of("hex-free-5"))
    )
    assert (again.format, again.parameters) == (golden.format, golden.parameters)
    assert verify(again).path_digest == verify(golden).path_digest


def test_a_golden_recording_verifies(golden: Recording) -> None:
    """Every check holds on it."""
    found = audit(golden)
    assert found.ok, [check for check in found.checks if not check.ok]
    assert all(check.checked for check in found.checks)
    assert found.moves > 0


def test_a_golden_recording_stays_what_it_is_when_it_is_copied(
    golden: Recording, tmp_path: Path
) -> None:
    """In its format, and right."""
    recover(golden, tmp_path / "copy.mcap")
    copy = read_recording(tmp_path / "copy.mcap")
    assert copy.format == golden.format
    assert audit(copy).ok


@pytest.mark.slow
def test_a_golden_recording_replays(golden: Recording) -> None:
    """Put back on zenoh it gives what it says."""
    found = replay(golden)
    assert found.same, found.differences
