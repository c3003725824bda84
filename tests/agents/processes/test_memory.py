"""What a module process takes of its machine's memory."""

import re
from pathlib import Path
from typing import Literal

import pytest

from cubepath.coordinator.runs.run import start

FLEET_MAX = 2 * 1024 * 1024
"""Kilobytes that 64 processes may take."""


def _private(pid: int) -> int:
    """Return the kilobytes that a process shares with no other."""
    rollup = Path(f"/proc/{pid}/smaps_rollup").read_text()
    return sum(map(int, re.findall(r"^Private_\w+: +(\d+) kB", rollup, re.MULTILINE)))


@pytest.mark.slow
@pytest.mark.parametrize("clock", ["lockstep", "free"])
def test_a_fleet_of_64_processes_takes_less_than_two_gigabytes(
    clock: Literal["lockstep", "free"], tmp_path: Path
) -> None:
    """A process with its modules, after a step: what it imports and zenoh's threads, above all."""
    with start("hex:n=6", processes=2, clock=clock, log=tmp_path / "run.mcap") as run:
        run.step()
        taken = [_private(pid) for name, pid in run.pids.items() if name.startswith("process")]
    assert len(taken) == 2
    assert max(taken) * 64 < FLEET_MAX, taken
