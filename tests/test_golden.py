"""Golden recordings: made by an earlier version, they must stay readable, right and repeatable."""

from __future__ import annotations

from pathlib import Path

import pytest

from cubepath.coordinator.auditing.recording import audit
from cubepath.coordinator.playback.replaying import replay
from cubepath.coordinator.runs.launch import run
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.verification.recording import recover, verify
from cubepath.protocol.recordings.recording import Recording, read_recording

GOLDEN = sorted((Path(__file__).parent.parent / "logs" / "golden").glob("*.mcap"))


def test_there_are_golden_recordings() -> None:
    """Vehicles, hexagons and an arm are among them."""
    assert {path.stem.partition("-")[0] for path in GOLDEN} >= {"hex", "agv", "arm"}


@pytest.fixture(params=GOLDEN, ids=lambda path: path.stem)
def golden(request: pytest.FixtureRequest) -> Recording:
    """Read one of them."""
    return read_recording(request.param)


def test_a_golden_recording_verifies(golden: Recording) -> None:
    """Every check holds on it."""
    found = audit(golden)
    assert found.ok, [check for check in found.checks if not check.ok]
    assert all(check.checked for check in found.checks if check.name != "certificate")
    assert found.moves > 0


def test_a_golden_recording_stays_what_it_is_when_it_is_copied(
    golden: Recording, tmp_path: Path
) -> None:
    """In its format, whose messages of modules stand by themselves."""
    recover(golden, tmp_path / "copy.mcap")
    copy = read_recording(tmp_path / "copy.mcap")
    assert copy.format == golden.format
    assert audit(copy).ok


@pytest.mark.slow
def test_a_golden_recording_replays(golden: Recording) -> None:
    """Put back on zenoh it gives what it says."""
    found = replay(golden)
    assert found.same, found.differences


@pytest.mark.few(2)
@pytest.mark.slow
def test_a_golden_run_can_be_run_again(golden: Recording, tmp_path: Path) -> None:
    """The same system, rule and seed take the same path today, chains without rounds too."""
    told = golden.parameters
    outcome = run(
        Plan(
            system=told["system"],
            rule=told["rule"],
            seed=int(told["seed"]),
            hesitate=float(told["hesitate"]),
            processes=0 if golden.clock == "lockstep" else 1,
            clock=golden.clock,
            max_rounds=int(told["max_rounds"]),
            log=tmp_path / "again.mcap",
        )
    )
    assert outcome.path_digest == verify(golden).path_digest
