"""Child processes end with all that they have started."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from cubepath.agents.processes.child_processes import ChildProcesses
from cubepath.coordinator.runs.run import start
from cubepath.protocol.wire.messages import Go
from processes.elsewhere import soon
from processes.living import is_there

pytestmark = pytest.mark.slow

FORKS = """
import os, signal
from pathlib import Path
from cubepath.agents import FreeRule, RuleType


def make(knowledge):
    def choose(view):
        file = Path(__file__).with_name(str(knowledge.module))
        if not file.exists():
            file.touch()
            if not os.fork():
                while True:
                    signal.pause()
            with Path(__file__).with_name("pids").open("a") as pids:
                pids.write(f"{os.getpid()}\\n")
        return int(view.mask.nonzero()[0][-1])

    return choose


RULE = RuleType("forks", "stays", "a test", lambda system: True, make, free=FreeRule("a test"))
"""
LOCKSTEP: dict[str, Any] = {"clock": "lockstep"}
FREE: dict[str, Any] = {"clock": "free", "keepers": 1}


def group(leader: int) -> list[int]:
    """Return the processes of a group that have not ended."""
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                same = os.getpgid(int(folder.name)) == leader
            except ProcessLookupError:
                continue
            if same and is_there(int(folder.name)):
                found.append(int(folder.name))
    return found


@pytest.mark.few(1)
@pytest.mark.parametrize("options", [LOCKSTEP, FREE], ids=["lockstep", "free"])
@pytest.mark.parametrize("end", ["told", "killed"])
def test_what_a_rule_forks_ends_with_the_run(
    end: str, options: dict[str, Any], tmp_path: Path
) -> None:
    """Whether processes end as they are told to, or one of them is killed before."""
    file = tmp_path / "f.py"
    file.write_text(FORKS)
    with start("hex:n=4", f"{file}:RULE", processes=2, **options, log=tmp_path / "a") as run:
        pids = [pid for name, pid in run.pids.items() if name.startswith("process_")]
        run.until(lambda _: (tmp_path / "pids").exists() and run.gathered.moves)
        assert sum(len(group(pid)) for pid in pids) > len(pids)
        if end == "killed":
            run.signal("process_0", signal.SIGKILL)
            assert run.play().ended == "failed"
    soon(lambda: not any(map(group, pids)), "the end of what was forked")


def test_what_a_rule_forks_ends_when_the_run_is_killed(tmp_path: Path) -> None:
    """Its processes end by themselves then, and take it with them."""
    file = tmp_path / "f.py"
    file.write_text(FORKS)
    command = [sys.executable, "-m", "cubepath.coordinator", "run", "hex:n=4"]
    begun = subprocess.Popen(
        [
            *command,
            f"--rule={file}:RULE",
            "--processes=1",
            "--max-rounds=20000",
            f"--log={tmp_path / 'a.mcap'}",
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "TMPDIR": str(tmp_path)},
        process_group=0,
    )
    pids = tmp_path / "pids"
    try:
        soon(lambda: pids.exists() and len(pids.read_text().split()) == 4, "forks")
    finally:
        begun.kill()
        begun.wait()
    soon(lambda: not group(int(pids.read_text().split()[0])), "the end of what was forked")


def test_processes_start_side_by_side(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """None waits until the one before has read its configuration, which no pipe may hold."""
    tired = tmp_path / "tired"
    (tmp_path / "deaf.py").write_text(f"import time; time.sleep(5); open({str(tired)!r}, 'w')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    children = ChildProcesses()
    children.spawn("deaf", "deaf", Go(0, "x" * 2**20))  # type: ignore[arg-type]  # any text will do
    assert not tired.exists()
    children.end(0.0)
    assert not children.by_name
