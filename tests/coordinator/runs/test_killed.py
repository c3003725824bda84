"""Runs whose coordinator is killed: what was said a second before, and every finished round."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import pytest

from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.recordings.recording import Recording, read_recording

TOLD = """
import sys, time
from pathlib import Path
from cubepath.coordinator.runs import driver
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import run
from cubepath.protocol.recordings.writing import RecordingWriter

class Told(RecordingWriter):
    def write(self, *arguments, **keywords):
        super().write(*arguments, **keywords)
        sys.stdout.write(f"message {time.monotonic()}\\n")  # at once, as another thread may flush
        sys.stdout.flush()

driver.RecordingWriter = Told
clock, processes = sys.argv[2:]
plan = Plan(
    "hex:n=6", "random", max_rounds=10**6, clock=clock, processes=int(processes),
    speeds=dict.fromkeys(range(6), 5.0) if clock == "free" else {}, log=Path(sys.argv[1]),
)
run(plan, watch=lambda gathered: print("round", gathered.rounds, flush=True))
"""
"""Runs, and says when each message was given to be recorded, and which rounds are over."""


@contextmanager
def running(path: Path, clock: str, processes: int) -> Generator[subprocess.Popen[str]]:
    """Start a run that says what it does; leave nothing of it."""
    with subprocess.Popen(
        [sys.executable, "-c", TOLD, path, clock, str(processes)], stdout=subprocess.PIPE, text=True
    ) as child:
        try:
            yield child
        finally:
            child.kill()  # its children end when its pipes to them close


def killed(path: Path, clock: str, processes: int, *, rounds: int, seconds: float) -> list[str]:
    """Kill a run after so many rounds and seconds, at whatever it does then; return what it said.

    The seconds are those between its first message and its last.
    """
    with running(path, clock, processes) as child:
        assert child.stdout is not None
        said: list[str] = []
        over = 0
        for line in child.stdout:
            said.append(line)
            over += line.startswith("round")
            if over >= rounds and line.startswith("message") and lasted(said) >= seconds:
                break
        child.kill()
        return [*said, *child.stdout]


def times(said: list[str]) -> list[float]:
    return [float(line.split()[1]) for line in said if line.startswith("message ")]


def lasted(said: list[str]) -> float:
    first = next(line for line in said if line.startswith("message"))
    return float(said[-1].split()[1]) - float(first.split()[1])


def assert_kept(recording: Recording, said: list[str]) -> None:
    """All that was given a second before the last message, and nothing but what was given."""
    found = len(recording.records)
    given = times(said)
    # A message was given before the next was: when exactly, only the process knew.
    due = sum(after <= given[-1] - 1.0 for _, after in pairwise(given))
    assert due <= found <= len(given) + 1
    assert [record.sequence for record in recording.records] == [*range(found)]
    assert recording.problems


@pytest.mark.slow
@pytest.mark.parametrize(
    ("processes", "rounds"),
    [
        (0, 20),
        *(
            pytest.param(processes, rounds, marks=pytest.mark.nightly)
            for processes in (0, 2)
            for rounds in range(1, 40, 12)
        ),
    ],
)
def test_a_killed_run_has_every_round_that_was_over(
    processes: int, rounds: int, tmp_path: Path
) -> None:
    """Each with its edges, and what it was derived from: nothing but the end is missing."""
    path = tmp_path / "run.mcap"
    said = killed(path, "lockstep", processes, rounds=rounds, seconds=0.0)
    recording = read_recording(path)
    assert_kept(recording, said)
    over = max(int(line.split()[1]) for line in said if line.startswith("round"))
    found = verify(recording)
    assert found.rounds >= over >= rounds
    assert [check.name for check in found.checks if not check.ok] == ["readable", "complete"]


@pytest.mark.thorough
def test_a_killed_run_without_rounds_has_all_of_a_second_before(tmp_path: Path) -> None:
    """Slow modules fill no chunk in that time."""
    path = tmp_path / "run.mcap"
    said = killed(path, "free", 1, rounds=0, seconds=1.6)
    recording = read_recording(path)
    assert_kept(recording, said)
    assert len(recording.records) > 0


def is_within_a_round(recording: Recording) -> bool:
    over = [record.round for record in recording.of_kind("edges")]
    return max(record.round for record in recording.records) > max(over, default=0)


@pytest.mark.slow
@pytest.mark.parametrize("clock", ["lockstep", pytest.param("free", marks=pytest.mark.thorough)])
def test_what_was_said_last_is_written_where_nothing_follows(clock: str, tmp_path: Path) -> None:
    """All others stand still, with rounds in the middle of one: what came before is on record."""
    path = tmp_path / "run.mcap"
    with running(path, clock, 1) as child:
        assert child.stdout is not None
        given = 0
        while given < 100:
            given += child.stdout.readline().startswith("message")
        others = [
            int(other)
            for task in Path(f"/proc/{child.pid}/task").iterdir()
            for other in (task / "children").read_text().split()
        ]
        try:
            for other in others:
                os.kill(other, signal.SIGSTOP)
            until = time.monotonic() + 30
            while True:
                found = read_recording(path)
                if clock == "free" and len(found.records) >= given:
                    break
                if clock == "lockstep" and is_within_a_round(found):
                    break
                assert time.monotonic() < until
                time.sleep(0.05)
        finally:
            for other in others:
                os.kill(other, signal.SIGCONT)
