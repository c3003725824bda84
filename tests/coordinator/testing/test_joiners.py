"""Commands that do not join a run: told in time, with what they said."""

import sys
from pathlib import Path

import pytest

from cubepath.coordinator.testing.commands import Command
from cubepath.coordinator.testing.fixtures import RunFixture
from cubepath.coordinator.testing.run_under_test import RunUnderTest
from cubepath.protocol.core.errors import CheckError, InputError

pytestmark = pytest.mark.slow
SYSTEM = "hex:n=4"


def test_a_command_that_ends_before_it_joins_is_told(cubepath_run: RunFixture) -> None:
    """At once, with its exit code and its last words."""
    robot = [sys.executable, "-c", "import sys; print('no arm', file=sys.stderr); sys.exit(3)"]
    line = r"^robot ended before it joined, exit code 3; stdout: nothing; stderr: no arm$"
    with pytest.raises(CheckError, match=line):
        cubepath_run(SYSTEM, commands={"robot": robot})


def test_a_command_that_never_joins_is_told(cubepath_run: RunFixture) -> None:
    """When the time is over; it is ended."""
    robot = [sys.executable, "-c", "import time; print('here'); time.sleep(1000)"]
    line = r"^not within 1 s: the commands have joined; own_0: stdout: \w+; stderr: nothing$"
    with pytest.raises(CheckError, match=line):
        cubepath_run(SYSTEM, commands=[robot], timeout_s=1.0)
    (rig,) = cubepath_run.rigs
    assert rig.commands["own_0"].returncode is not None


def test_commands_join_without_tls(cubepath_run: RunFixture, tmp_path: Path) -> None:
    """What cannot come to pass is refused before anything starts."""
    line = r"^commands with secure=.*: they join a run without TLS, expected one of both$"
    with pytest.raises(InputError, match=line):
        cubepath_run(SYSTEM, commands=["robot"], secure=tmp_path, listen="tls/127.0.0.1:0")


STARTS = """
import os, sys
from pathlib import Path
from cubepath.coordinator.testing import RunUnderTest
from cubepath.coordinator.testing.commands import lives
robot = f"import os, signal, time; print(os.getpid()); os.kill({os.getpid()}, signal.SIGINT)"
robot = [sys.executable, "-c", robot + "; time.sleep(1000)"]
rig = RunUnderTest("hex:n=4", commands=[robot], log=sys.argv[1])
try:
    with rig:
        print("it has begun")
except BaseException as error:
    print("ended by", repr(error))
print("left", [pid for each in rig.commands.values() if lives(pid := each.pid)])
"""


def test_an_interrupt_of_a_start_stays_one(tmp_path: Path) -> None:
    """It is not replaced by what comes of closing what was not yet open; nothing is left."""
    with Command([sys.executable, "-c", STARTS, str(tmp_path / "run.mcap")]) as start:
        assert start.says("ended by (.*)")[1] == "KeyboardInterrupt()"
        assert start.says("left (.*)")[1] == "[]"
        assert start.wait() == 0


def test_the_first_error_of_a_start_is_raised(tmp_path: Path) -> None:
    """And none that follows from it."""
    log = tmp_path / "run.mcap"
    log.touch()
    with pytest.raises(InputError, match="exists already"), RunUnderTest(SYSTEM, log=log):
        pass
