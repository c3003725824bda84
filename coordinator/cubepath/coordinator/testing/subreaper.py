"""A subreaper: it runs a command, and ends everything the command left when its parent is gone.

It runs as a separate script, with the standard library alone, so that it starts quickly. It adopts
every process that the command leaves behind, and ends all of them when the command ends, when its
standard input closes, or when its parent is gone: a killed test process leaves nothing running.
Over standard input you can tell it to watch other processes and folders; it kills and removes these
too, unless it hears that all is well.

    python -I -S subreaper.py FD [COMMAND ...]
"""

import contextlib
import ctypes
import os
import select
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

_SET_PARENT_DEATH_SIGNAL, _SET_CHILD_SUBREAPER = 1, 36
_POLL_S = 1.0
_KILL_S_MAX = 5.0
NOT_STARTED = 127
"""Exit code where the command could not be started, as of a shell."""


def started(pid: int) -> str:
    """Return when a process was started, which tells it from others of its number; else empty."""
    try:
        return Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()[19]
    except (OSError, IndexError):
        return ""


def descendants(root: int) -> list[int]:
    """Return the processes that a process has started, directly or not, and that still are."""
    parents: dict[int, int] = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                fields = (folder / "stat").read_text("utf-8").rpartition(")")[2].split()
            except OSError:
                continue
            if fields[0] != "Z":
                parents[int(folder.name)] = int(fields[1])
    found = [root]
    for one in found:
        found += [pid for pid, parent in parents.items() if parent == one]
    return found[1:]


class Subreaper:
    """What is to be ended, and where to tell what."""

    def __init__(self, report: int, command: list[str]) -> None:
        """Start the command, if there is one, and tell its process id."""
        self._parent = os.getppid()
        self._report = report
        self._watched: dict[int, str] = {}
        self._folders: list[str] = []
        self._text = b""
        self._libc = ctypes.CDLL(None)
        self._libc.prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        self.child: subprocess.Popen[bytes] | None = None
        if command:
            self.child = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                process_group=0,
                preexec_fn=self._end_with_subreaper,  # noqa: PLW1509 - a subreaper has one thread
            )
            os.write(report, f"{self.child.pid}\n".encode())
        os.close(report)

    def _end_with_subreaper(self) -> None:
        # What is ignored stays so in a new program: a command is interrupted as from a terminal.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        self._libc.prctl(_SET_PARENT_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)

    def wait(self) -> None:
        """Wait until it is time to end everything."""
        ends = [] if self.child is None else [os.pidfd_open(self.child.pid)]
        while os.getppid() == self._parent:
            ready = select.select([0, *ends], [], [], _POLL_S)[0]
            if ends and ends[0] in ready:
                return
            if 0 in ready:
                data = os.read(0, 1 << 16)
                if not data or self._is_over(data):
                    return
        self._hear_the_rest()

    def _hear_the_rest(self) -> None:
        """Take the last order of a parent that is gone."""
        os.set_blocking(0, False)  # who else holds the other end has nothing to tell
        with contextlib.suppress(BlockingIOError):
            while data := os.read(0, 1 << 16):
                if self._is_over(data):
                    return

    def _is_over(self, data: bytes) -> bool:
        """Take the orders; return whether all is well, so that nothing need be watched."""
        *lines, self._text = (self._text + data).split(b"\n")
        for line in lines:
            what, _, value = line.decode().partition(" ")
            if what == "watch":
                self._watched[int(value)] = started(int(value))
            elif what == "folder":
                self._folders.append(value)
            elif what == "over":
                self._watched.clear()
                return True
        return False

    def end(self) -> int:
        """End everything; return the exit code of the command, or minus its signal."""
        deadline = time.monotonic() + _KILL_S_MAX
        while (left := descendants(os.getpid())) and time.monotonic() < deadline:
            for pid in left:
                self._kill(pid)
            time.sleep(0.001)
        for pid, when in self._watched.items():
            if when and started(pid) == when:
                self._kill(pid)
        for folder in self._folders:
            shutil.rmtree(folder, ignore_errors=True)
        return 0 if self.child is None else self.child.wait()

    def _kill(self, pid: int) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def main() -> int:
    """Run the command, wait and end; end as the command has."""
    # The parent handles interrupts; a terminal sends them to every process.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN if number == signal.SIGINT else signal.SIG_DFL)
    try:
        subreaper = Subreaper(int(sys.argv[1]), sys.argv[2:])
    except OSError as error:
        print(f"{sys.argv[2]}: {error.strerror or error}", file=sys.stderr)
        return NOT_STARTED
    code = 0
    try:
        subreaper.wait()
    finally:
        code = subreaper.end()
    if code < 0:
        with contextlib.suppress(OSError):  # some signals have no other disposition
            signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    return code


if __name__ == "__main__":
    sys.exit(main())
