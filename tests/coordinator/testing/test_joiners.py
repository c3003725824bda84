"""Commands that do not join a run: told in time, with what they said."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from cubepath.coordinator.testing.fixtures import StartRun
from cubepath.protocol.core.errors import CheckError, InputError

pytestmark = pytest.mark.slow
SYSTEM = "hex:n=4"


def test_a_command_that_ends_before_it_joins_is_told(cubepath_run: StartRun) -> None:
    """At once, with its exit code and its last words."""
    robot = [sys.executable, "-c", "import sys; print('no arm', file=sys.stderr); sys.exit(3)"]
    line = r"^robot ended before it joined, exit code 3; stdout: nothing; stderr: no arm$"
    with pytest.raises(CheckError, match=line):
        cubepath_run(SYSTEM, commands={"robot": robot})


def test_a_command_that_never_joins_is_told(cubepath_run: StartRun) -> None:
    """When the time is over; it is ended."""
    robot = [sys.executable, "-c", "import time; print('here'); time.sleep(1000)"]
    line = r"^not within 1 s: the commands have joined; own_0: stdout: here; stderr: nothing$"
    with pytest.raises(CheckError, match=line):
        cubepath_run(SYSTEM, commands=[robot], timeout_s=1.0)
    (rig,) = cubepath_run.rigs
    assert rig.commands["own_0"].returncode is not None


def test_commands_join_without_tls(cubepath_run: StartRun, tmp_path: Path) -> None:
    """What cannot come to pass is refused before anything starts."""
    line = r"^commands with secure=.*: they join a run without TLS, expected one of both$"
    with pytest.raises(InputError, match=line):
        cubepath_run(SYSTEM, commands=["robot"], secure=tmp_path, listen="tls/127.0.0.1:0")
