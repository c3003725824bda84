"""Nothing is left of a private run, whatever of it is killed: no process, and no folder."""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from processes.elsewhere import Commands, folders, soon

pytestmark = pytest.mark.slow

# A bounded run: it ends by itself when the test is killed before it has ended the run.
RUN = ("run", "hex:n=6", "--rule=random", "--max-rounds=20000", "--log=run.mcap")


def children_of(pid: int) -> dict[str, list[int]]:
    """Return the process ids of the router and of the module processes."""
    found: dict[str, list[int]] = {"router": [], "host": []}
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in (task / "children").read_text().split():
            with suppress(OSError):
                words = Path(f"/proc/{child}/cmdline").read_bytes().decode().split("\0")
                for name, pids in found.items():
                    if any(word.endswith(f".{name}") for word in words):
                        pids.append(int(child))
    return found


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "victims",
    [
        ("coordinator",),
        ("router", "coordinator"),
        pytest.param(("coordinator", "host"), marks=pytest.mark.thorough),
        ("host",),
        pytest.param(("stopped router", "coordinator"), marks=pytest.mark.thorough),
        ("interrupted coordinator",),
    ],
    ids=" ".join,
)
def test_nothing_is_left(tmp_path: Path, victims: tuple[str, ...]) -> None:
    """Those that are left end by themselves, and the last takes the folder away.

    So the command is not one of the plugin's, which would end them.
    """
    begun = subprocess.Popen(
        [sys.executable, "-m", "cubepath.coordinator", *RUN, "--processes=2"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        cwd=tmp_path,
        env={**os.environ, "TMPDIR": str(tmp_path)},
        process_group=0,
    )
    log = tmp_path / "run.mcap"
    soon(lambda: log.exists() and log.stat().st_size > 20_000, "no run")
    pids = children_of(begun.pid)
    everyone = [begun.pid, *pids["router"], *pids["host"]]
    assert (len(everyone), len(folders(tmp_path))) == (4, 1)
    for victim in victims:
        how, _, who = victim.rpartition(" ")
        number = {"stopped": signal.SIGSTOP, "interrupted": signal.SIGINT}.get(how, signal.SIGKILL)
        for pid in pids.get(who, [begun.pid]):
            os.kill(pid, number)
    begun.wait(60)
    soon(lambda: not folders(tmp_path), "the folder is still there")
    for pid in pids["router"]:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)
    soon(lambda: not any(Path(f"/proc/{pid}").exists() for pid in everyone), "some still run")


@pytest.mark.thorough
def test_a_run_that_was_refused_leaves_no_folder(tmp_path: Path) -> None:
    """Nor one that could not begin."""
    with Commands(tmp_path) as commands:
        code, _, errors = commands.start("run", "hex:n=6", "--log=run.mcap", "--rule=tswap").end()
        assert (code, len(errors)) == (2, 1)
        code, _, errors = commands.start("run", "hex:n=6", "--listen=tcp/192.0.2.1:1").end()
        assert (code, len(errors)) == (1, 1)
        assert "cannot listen there" in errors[0]
        assert folders(tmp_path) == []
