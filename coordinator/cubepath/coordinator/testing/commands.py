"""Your commands in separate processes, which end with the test whatever happens.

Each runs under a `subreaper`, which ends it together with everything it started.
"""

import contextlib
import os
import re
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from itertools import takewhile
from pathlib import Path
from typing import IO, Any, Self, TypeAlias

from cubepath.coordinator.testing import subreaper
from cubepath.coordinator.testing.wire_messages import short
from cubepath.protocol.core.errors import CheckError, InputError

_END_S_MAX = 10.0
_LINES_SHOWN, _SHOWN_MAX = 10, 300
_POLL_S = 0.01
_STDERR_MAX = 1 << 14
CommandLine: TypeAlias = "str | Sequence[str]"
LINES_MAX = 10_000
"""The number of last lines of a command that are kept, of each stream."""
LINE_BYTES_MAX = 1 << 13
"""A longer line is kept as several."""


def new_subreaper(
    command: Sequence[str] = (), **options: Any
) -> tuple[subprocess.Popen[bytes], int]:
    """Start a subreaper; return it and the descriptor on which it reports the command's process id.

    `options` are those of `subprocess.Popen`.
    """
    read, write = os.pipe()
    try:
        child: Any = subprocess.Popen(
            [sys.executable, "-I", "-S", str(Path(subreaper.__file__)), str(write), *command],
            stdin=subprocess.PIPE,
            pass_fds=(write,),
            process_group=0,
            **options,
        )
    except BaseException:
        os.close(read)
        raise
    finally:
        os.close(write)
    return child, read


class Guard:
    """A subreaper without a command: it ends everything it watches if this process is killed."""

    def __init__(self) -> None:
        self._subreaper, report = new_subreaper()
        os.close(report)

    def watch(self, pid: int) -> None:
        """Have a process killed if this one is; one that has stopped does not notice it itself."""
        self._tell(f"watch {pid}")

    def watch_folder(self, path: Path) -> None:
        """Have a folder removed as well."""
        self._tell(f"folder {path}")

    def _tell(self, line: str) -> None:
        if self._subreaper.stdin is not None:
            with contextlib.suppress(OSError):
                self._subreaper.stdin.write(line.encode() + b"\n")
                self._subreaper.stdin.flush()

    def close(self) -> None:
        """Tell it that all is well, and wait for its end."""
        self._tell("over")
        if self._subreaper.stdin is not None:
            with contextlib.suppress(OSError):
                self._subreaper.stdin.close()
        _ended(self._subreaper, _END_S_MAX)


def check_command(command: object) -> list[str]:
    """Return a command as a list, a text split as a shell does; InputError if it is none."""
    if isinstance(command, str):
        try:
            return shlex.split(command)
        except ValueError as error:
            raise InputError(f"command={command}: {error}") from None
    parts: list[Any] = list(command) if isinstance(command, Sequence) else [None]
    if not all(isinstance(part, str) for part in parts):
        raise InputError(f"command={command!r}: expected a text, or a program and its arguments")
    return parts


class _Lines:
    """The last lines of a stream, each with its number from the beginning of it."""

    def __init__(self) -> None:
        self.kept: deque[tuple[int, str]] = deque(maxlen=LINES_MAX)
        self.count = 0
        self.found = 0
        """The number behind the line that was found last."""

    def add(self, line: str) -> None:
        self.kept.append((self.count, line))
        self.count += 1

    def since(self, number: int) -> list[tuple[int, str]]:
        """Return the lines from a number on that are still there."""
        return list(takewhile(lambda each: each[0] >= number, reversed(self.kept)))[::-1]

    def __str__(self) -> str:
        return "\n".join(line for _, line in self.kept)


class Command:
    r"""A command in a separate process, as a context manager that ends it.

    Of what it writes the last 10,000 lines of each stream are kept, those of more than 8192 bytes
    as several.

    >>> with Command(["python3", "-c", "print('here I am')"]) as command:
    ...     command.says(r"here I (\w+)")[1], command.wait()
    ('am', 0)
    """

    def __init__(
        self,
        command: str | Sequence[str],
        *,
        name: str = "",
        env: Mapping[str, str] | None = None,
        cwd: Path | None = None,
        timeout_s: float = 30.0,
        **texts: str,
    ) -> None:
        """Start it; a text is split as a shell does. InputError if there is no such program.

        `env` is added to the environment of this process. Each of `texts`, as ``endpoint``, stands
        for ``{endpoint}`` in the command, and is in the environment as ``CUBEPATH_ENDPOINT``.
        `timeout_s` is for how long it is waited for, unless a call says otherwise.
        """
        arguments = _filled(check_command(command), texts)
        own = {f"CUBEPATH_{key.upper()}": value for key, value in texts.items()}
        if not arguments:
            raise InputError("command: is empty, expected a program and its arguments")
        self.arguments = arguments
        self.name = name or Path(arguments[0]).name
        self.timeout_s = timeout_s
        self._changed = threading.Condition()
        self._lines = {"out": _Lines(), "err": _Lines()}
        self._cwd = cwd
        self._env = {**os.environ, "PYTHONUNBUFFERED": "1", **own, **(env or {})}
        self._readers: list[threading.Thread] = []
        self._restarting = False
        self.pid = 0
        """The process id of the command itself."""
        self._start()

    def _start(self) -> None:
        self._subreaper, report = new_subreaper(
            self.arguments,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=self._cwd,
            env=self._env,
        )
        try:
            self._begin(report)
        except BaseException:
            self.close()
            raise
        if not self.pid:
            self.close()
            raise InputError(f"command: {short(self.err) or self.arguments[0]}")

    def restart(self, when: Callable[[], bool] = lambda: True) -> None:
        """Start it again, once it has ended and something holds (at most 10 s later).

        If it runs, it is killed. Its lines follow those of before, and who waits for its end waits
        for the new one's.
        """
        self._restarting = True
        try:
            self.close()
            deadline = time.monotonic() + _END_S_MAX
            while not when() and time.monotonic() < deadline:
                time.sleep(_POLL_S)
            self._readers = []
            self._start()
        finally:
            with self._changed:
                self._restarting = False
                self._changed.notify_all()

    def _begin(self, report: int) -> None:
        """Read what it says, and wait for its process id."""
        with os.fdopen(report) as started:
            for kind, stream in (("out", self._subreaper.stdout), ("err", self._subreaper.stderr)):
                reader = threading.Thread(target=self._read, args=(kind, stream), daemon=True)
                reader.start()
                self._readers.append(reader)
            line = started.readline()
        self.pid = int(line) if line else 0

    def _read(self, kind: str, stream: IO[bytes]) -> None:
        with stream:
            while line := stream.readline(LINE_BYTES_MAX):
                with self._changed:
                    self._lines[kind].add(line.decode(errors="replace").rstrip("\n"))
                    self._changed.notify_all()

    @property
    def out(self) -> str:
        """Return what it has written to standard output so far, or the last lines of it."""
        with self._changed:
            return str(self._lines["out"])

    @property
    def err(self) -> str:
        """Return what it has written to standard error so far, or the last lines of it."""
        with self._changed:
            return str(self._lines["err"])

    @property
    def returncode(self) -> int | None:
        """Return its exit code, or minus the signal that ended it; None as long as it runs."""
        return None if self._restarting else self._subreaper.poll()

    def signal(self, number: int = signal.SIGKILL) -> None:
        """Send a signal to it and what it has started in its process group."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, number)

    def says(
        self, pattern: str, timeout_s: float | None = None, *, again: bool = False
    ) -> re.Match[str]:
        """Wait for a line, of either stream, in which a pattern is found; return the match.

        With `again` the line has to come after the one that was found last. CheckError with what it
        printed instead if it ends or the time is over before.
        """
        timeout_s = self.timeout_s if timeout_s is None else timeout_s
        deadline = time.monotonic() + timeout_s
        with self._changed:
            at = {kind: lines.found if again else 0 for kind, lines in self._lines.items()}
            while True:
                for kind, lines in self._lines.items():
                    for number, line in lines.since(at[kind]):
                        found = re.search(pattern, line)
                        if found is not None:
                            lines.found = number + 1
                            return found
                    at[kind] = lines.count
                left = deadline - time.monotonic()
                over = not (self._restarting or any(each.is_alive() for each in self._readers))
                if over or left <= 0:
                    why = (
                        f"ended ({self.returncode})" if over else f"did not within {timeout_s:g} s"
                    )
                    raise CheckError(f"{self.name} says {pattern!r}: it {why}; {self.last_lines}")
                self._changed.wait(min(left, 0.1))

    def until(
        self,
        holds: Callable[[], bool],
        what: str,
        timeout_s: float | None = None,
        why_not: Callable[[], str] = lambda: "",
    ) -> None:
        """Wait until something holds of it; CheckError if it ends or the time is over before."""
        timeout_s = self.timeout_s if timeout_s is None else timeout_s
        deadline = time.monotonic() + timeout_s
        while not holds():
            over = self.returncode is not None
            if over or time.monotonic() > deadline:
                why = "ended before" if over else f"did not within {timeout_s:g} s{why_not()}"
                raise CheckError(f"{self.name} {what}: it {why}; {self.last_lines}")
            time.sleep(_POLL_S)

    @property
    def last_lines(self) -> str:
        """Return its last lines of each stream in one line."""
        with self._changed:
            tails = {
                kind: " | ".join(line for _, line in lines.since(lines.count - _LINES_SHOWN))
                for kind, lines in self._lines.items()
            }
        return "; ".join(f"std{kind}: {_end_of(text) or 'nothing'}" for kind, text in tails.items())

    def wait(self, timeout_s: float | None = None) -> int:
        """Wait for its end; return its exit code. CheckError if it does not end within the time."""
        timeout_s = self.timeout_s if timeout_s is None else timeout_s
        deadline = time.monotonic() + timeout_s
        try:
            while True:
                child = self._subreaper
                code = child.wait(max(0.0, deadline - time.monotonic()))
                with self._changed:
                    left = deadline - time.monotonic()
                    self._changed.wait_for(lambda: not self._restarting, max(0.0, left))
                    if child is self._subreaper:
                        break
        except subprocess.TimeoutExpired:
            raise CheckError(
                f"{self.name} did not end within {timeout_s:g} s; {self.last_lines}"
            ) from None
        for reader in self._readers:
            reader.join(_END_S_MAX)
        return code

    def close(self) -> None:
        """End it, with all that it has started."""
        if self._subreaper.stdin is not None:
            with contextlib.suppress(OSError):
                self._subreaper.stdin.close()
        _ended(self._subreaper, _END_S_MAX)
        for reader in self._readers:
            reader.join(_END_S_MAX)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _filled(arguments: list[str], texts: Mapping[str, str]) -> list[str]:
    """Return the arguments of a command with texts for their names; InputError for a near name."""
    places = {f"{{{key}}}": value for key, value in texts.items()}
    whole = " ".join(arguments)
    if not any(place in whole for place in places):
        for found in re.findall(r"\{\w+\}", whole):
            for near in get_close_matches(found, places, n=1, cutoff=0.8):
                raise InputError(f"command: {found}: expected {near}")
    for place, value in places.items():
        arguments = [text.replace(place, value) for text in arguments]
    return arguments


def _end_of(text: str) -> str:
    """Return a text in one line, of a long one its end, where programs say why they failed."""
    line = " ".join(text.split())
    return line if len(line) <= _SHOWN_MAX else f"...{line[3 - _SHOWN_MAX :]}"


class Joiners:
    """The commands of one run, by their names."""

    def __init__(
        self,
        commands: Mapping[str, CommandLine] | Sequence[CommandLine],
        env: Mapping[str, str] | None,
        timeout_s: float,
    ) -> None:
        """Plan them; unless named they are ``own_0`` and so on. InputError for what is no list."""
        if isinstance(commands, str) or not isinstance(commands, Mapping | Sequence):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"commands={commands}: expected a list, or names with commands")
        numbered = {f"own_{number}": line for number, line in enumerate(commands)}
        self.lines = dict(commands) if isinstance(commands, Mapping) else numbered
        for line in self.lines.values():
            check_command(line)
        if not isinstance(env, Mapping | None):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"env={env!r}: expected names with values")
        self.running: dict[str, Command] = {}
        self._env = dict(env or {})
        self._timeout_s = timeout_s
        self._deadline: float | None = None

    def fit(self, secure: object) -> None:
        """Check that they can join a run with these certificates; InputError if not."""
        if secure is not None:
            raise InputError(
                f"commands with secure={secure}: they join a run without TLS, expected one of both"
            )

    def begin(self) -> None:
        """Let the time begin within which all are there."""
        self._deadline = time.monotonic() + self._timeout_s

    def start(self, way: Callable[[str], str]) -> None:
        """Start all; the way is where the one of a name finds the run."""
        for name, line in self.lines.items():
            self.running[name] = Command(
                line, name=name, env=self._env, timeout_s=self._timeout_s, endpoint=way(name)
            )

    def over(self) -> None:
        """Have it that all are there: who ends from now on, ends in the run."""
        self._deadline = None

    def check(self) -> None:
        """Raise CheckError if one has ended before the run began, or the time is over."""
        if self._deadline is None or not self.lines:
            return
        for name, command in self.running.items():
            code = command.returncode
            if code is not None:
                command.wait()  # until all that it said is read
                raise CheckError(
                    f"{name} ended before it joined, exit code {code}; {command.last_lines}"
                )
        if time.monotonic() > self._deadline:
            processes = [f"{name}: {each.last_lines}" for name, each in self.running.items()]
            outputs = "; ".join(processes) or "none was started"
            raise CheckError(
                f"not within {self._timeout_s:g} s: the commands have joined; {outputs}"
            )


def _ended(child: subprocess.Popen[bytes], patience_s: float) -> None:
    """Wait for the end of a subreaper, and kill it if it does not come."""
    try:
        child.wait(patience_s)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


def lives(pid: int) -> bool:
    """Return whether a process is running; one that has ended and is not yet buried is not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def stderr_of(pid: int) -> str:
    """Return the last line that a process has written to standard error, if it is a file."""
    try:
        path = Path(f"/proc/{pid}/fd/2")
        if not path.is_file():  # to open another would wait for somebody, or write to him
            return ""
        with path.open("rb") as file:
            file.seek(0, os.SEEK_END)
            file.seek(max(0, file.tell() - _STDERR_MAX))
            last = file.read().decode(errors="replace").strip().rpartition("\n")[2]
    except OSError:
        return ""
    return short(f"stderr: {last}") if last else ""
