"""Commands of others: told by their lines, and ended with all that they have started."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from cubepath.coordinator.testing import subreaper
from cubepath.coordinator.testing.commands import LINE_BYTES_MAX, LINES_MAX, Command, Guard
from cubepath.protocol.core.errors import CheckError, InputError
from processes.living import is_there

pytestmark = pytest.mark.slow
ENOUGH_S = 30.0
FAMILY = """
import os, subprocess, sys, time
# One in a session of its own, whose parent is gone at once, and one that ignores what it can.
child = subprocess.Popen([sys.executable, "-c", "import subprocess;"
    "print(subprocess.Popen(['sleep', '1000'], start_new_session=True).pid)"])
child.wait()
import signal
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print(os.getpid(), subprocess.Popen(["sleep", "1000"]).pid, "all there")
time.sleep(1000)
"""


def gone(*pids: int) -> bool:
    """Wait until processes are gone; return whether they are."""
    end = time.monotonic() + ENOUGH_S
    while any(map(is_there, pids)) and time.monotonic() < end:
        time.sleep(0.02)
    return not any(map(is_there, pids))


def family(command: Command) -> list[int]:
    """Return the process ids of all that the command has started."""
    first = int(command.says(r"^(\d+)$")[1])
    found = command.says(r"^(\d+) (\d+) all there$")
    return [first, int(found[1]), int(found[2])]


@pytest.mark.parametrize("how", ["closed", "killed", "an exception"])
def test_nothing_is_left_of_a_command(how: str) -> None:
    """Nor of what it has started, in whatever session and with whatever parent."""
    command = Command([sys.executable, "-c", FAMILY])
    pids = family(command)
    assert all(map(is_there, pids))
    if how == "closed":
        command.close()
    elif how == "killed":
        command.signal()
        assert command.wait() == -signal.SIGKILL
    else:
        with pytest.raises(ZeroDivisionError), command:
            print(1 // 0)
    assert gone(*pids)
    command.close()


OWNER = """
import os, signal, sys, time
from cubepath.coordinator.testing.commands import Command, Guard
guard = Guard()
stopped = Command(["sleep", "1000"])
command = Command([sys.executable, "-c", sys.argv[1]])
found = command.says("all there")
paused = os.fork()
if not paused:
    os.execvp("sleep", ["sleep", "1000"])
os.kill(paused, signal.SIGSTOP)
guard.watch(paused)
guard.watch_folder(sys.argv[2])
print(command.out.split()[0], *command.says(r"(\\d+) (\\d+) all").groups(), stopped.pid, paused)
sys.stdout.flush()
time.sleep(1000)
"""


def test_nothing_is_left_of_a_process_that_is_killed(tmp_path: Path) -> None:
    """Its commands are ended, what it watched too, standing still, and its folder is gone."""
    folder = tmp_path / "folder"
    folder.mkdir()
    owner = subprocess.Popen(
        [sys.executable, "-c", OWNER, FAMILY, str(folder)], stdout=subprocess.PIPE, text=True
    )
    assert owner.stdout is not None
    with owner.stdout:
        pids = [int(pid) for pid in owner.stdout.readline().split()]
        assert len(pids) == 5
        assert all(map(is_there, pids))
        owner.kill()
        owner.wait()
    assert gone(*pids)
    end = time.monotonic() + ENOUGH_S
    while folder.exists() and time.monotonic() < end:
        time.sleep(0.02)
    assert not folder.exists()


LATE = """
import os, sys
sys.path.insert(0, sys.argv[1])
from subreaper import Subreaper
subreaper = Subreaper(os.open(os.devnull, os.O_WRONLY), [])
subreaper._parent = -1
subreaper.wait()
subreaper.end()
"""


def test_what_a_guard_was_told_last_counts(tmp_path: Path) -> None:
    """Though who told it is gone before it has read that."""
    folder = tmp_path / "folder"
    folder.mkdir()
    where = str(Path(subreaper.__file__).parent)
    with Command("sleep 1000") as command:
        told = f"watch {command.pid}\nfolder {folder}\n"
        start = [sys.executable, "-I", "-S", "-c", LATE, where]
        subprocess.run(start, input=told, text=True, check=True)
        assert gone(command.pid)
    assert not folder.exists()


def test_a_guard_that_is_closed_harms_nobody(tmp_path: Path) -> None:
    """What it watched goes on."""
    guard = Guard()
    guard.watch(os.getpid())
    guard.close()
    with Command("sleep 1000") as command:
        guard = Guard()
        guard.watch(command.pid)
        guard.close()
        assert is_there(command.pid)


def test_a_command_is_told_by_its_lines_and_its_end() -> None:
    """Of both streams; what did not come is told with what came instead."""
    text = "import sys; print('one'); print('two', file=sys.stderr); sys.exit(3)"
    with Command([sys.executable, "-c", text], name="mine") as command:
        assert command.says("tw(.)")[1] == "o"
        assert command.wait() == command.returncode == 3
        assert (command.out, command.err) == ("one", "two")
        with pytest.raises(
            CheckError, match=r"^mine says 'three': it ended \(3\); stdout: one; stderr: two$"
        ):
            command.says("three")
    with Command("sleep 1000") as command:
        with pytest.raises(CheckError, match=r"^sleep did not end within 0.1 s; stdout: nothing"):
            command.wait(0.1)
        with pytest.raises(CheckError, match=r"^sleep says 'x': it did not within 0.1 s; "):
            command.says("x", 0.1)


@pytest.mark.parametrize(
    ("command", "line"),
    [
        ([], "command: is empty, expected a program and its arguments"),
        ("no-such-program now", "command: no-such-program: No such file or directory"),
    ],
)
def test_a_command_that_cannot_be_started_is_one_line(command: str, line: str) -> None:
    """As everywhere."""
    with pytest.raises(InputError, match=f"^{line}$"):
        Command(command)


def test_nothing_is_left_of_a_command_whose_start_is_interrupted(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """While it is waited for its process id."""
    begin, told = Command._begin, tmp_path / "pid"

    def interrupted(self: Command, report: int) -> None:
        begin(self, report)
        told.write_text(str(self.pid))
        raise KeyboardInterrupt

    monkeypatch.setattr(Command, "_begin", interrupted)
    with pytest.raises(KeyboardInterrupt):
        Command("sleep 1000")
    assert gone(int(told.read_text()))


def test_a_command_can_be_interrupted() -> None:
    """As from a terminal, also where this process was started with interrupts ignored."""
    waits = "print('here'); import time; time.sleep(1000)"
    with Command([sys.executable, "-c", waits]) as command:
        command.says("here")
        command.signal(signal.SIGINT)
        command.says("^KeyboardInterrupt")
        assert command.wait() == -signal.SIGINT


def test_the_last_lines_of_a_command_are_kept() -> None:
    """So many of each stream, and long ones in pieces; what was found is not found again."""
    text = f"print('x' * {2 * LINE_BYTES_MAX + 5})\nfor n in range({LINES_MAX + 3}): print(n)"
    with Command([sys.executable, "-c", text]) as command:
        command.says("^1$")
        assert command.says("^2$", again=True)[0] == "2"
        command.wait()
        assert command.out.splitlines() == [str(n) for n in range(3, LINES_MAX + 3)]
        with pytest.raises(CheckError, match=r"says '\^2\$': it ended"):
            command.says("^2$", again=True)
        assert command.says("^4$", again=True)[0] == "4"
    with Command([sys.executable, "-c", text.splitlines()[0]]) as command:
        command.wait()
        assert [len(line) for line in command.out.splitlines()] == [*2 * [LINE_BYTES_MAX], 5]


def test_a_line_can_be_waited_for_again() -> None:
    """The one that was found last does not count, nor what came before it."""
    with Command([sys.executable, "-c", "for n in range(3): print('ready', n)"]) as command:
        found = [command.says(r"ready (\d)", again=True)[1] for _ in range(3)]
        assert (found, command.says("ready 1")[0]) == (["0", "1", "2"], "ready 1")
        command.says("ready 2", again=True)
        with pytest.raises(CheckError, match="says 'ready 2': it ended"):
            command.says("ready 2", again=True)


def test_a_command_that_is_started_again_is_the_same_command() -> None:
    """Its handle has the lines of both lives, and waits for the end of the last."""
    text = "import sys, time\nprint('begun', flush=True)\ntime.sleep(0.3)\nsys.exit(3)"
    with Command([sys.executable, "-c", text]) as command, ThreadPoolExecutor(1) as other:
        command.says("begun")
        waited, first = other.submit(command.wait), command.pid
        command.restart()
        assert command.pid != first
        command.says("begun", again=True)
        assert waited.result() == 3
        assert command.out == "begun\nbegun"


def test_the_end_of_what_a_command_says_is_shown() -> None:
    """The cause is in the last words, however much comes before."""
    text = "import sys; print('x' * 900); sys.exit('y' * 900 + ': no such arm')"
    with Command([sys.executable, "-c", text], name="mine", timeout_s=0.05) as command:
        command.wait(30)
        assert command.last_lines.endswith("yyy: no such arm")
        assert "; stderr: ...yyy" in command.last_lines
    with Command("sleep 1000", timeout_s=0.05) as command:
        for waits in (command.wait, lambda: command.says("x")):
            with pytest.raises(CheckError, match=r"within 0\.05 s; stdout: nothing"):
                waits()


def test_a_misspelt_place_in_a_command_is_refused() -> None:
    """Unless the right one is there too: then it is something of the command."""
    with pytest.raises(InputError, match=r"^command: \{endpont\}: expected \{endpoint\}$"):
        Command("echo {endpont}", endpoint="tcp/h:1")
    with Command("echo {endpont} {endpoint}", endpoint="tcp/h:1") as command:
        command.says(r"\{endpont\} tcp/h:1")
