"""Commands of cubepath in processes of their own, told by what they write to standard error."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from types import TracebackType
from typing import Self

ENOUGH_S = 60.0


class Commands:
    """Commands that run side by side in a folder, as a context manager that ends them."""

    def __init__(self, folder: Path) -> None:
        """Run in this folder, which temporary files go to as well."""
        self.folder = folder
        self._running: list[Command] = []

    def start(self, *arguments: str) -> Command:
        """Start a command."""
        self._running.append(Command(self.folder, arguments))
        return self._running[-1]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for command in self._running:
            if command.child.poll() is None:
                command.child.kill()
            command.end()


class Command:
    """One command."""

    def __init__(self, folder: Path, arguments: tuple[str, ...]) -> None:
        """Start it."""
        self.child = subprocess.Popen(
            [sys.executable, "-m", "cubepath.coordinator", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=folder,
            env={**os.environ, "TMPDIR": str(folder), "CUBEPATH_PROGRESS": "0"},
            process_group=0,
        )
        self._lines: SimpleQueue[str | None] = SimpleQueue()
        self.errors: list[str] = []
        Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.child.stderr is not None
        for line in self.child.stderr:
            self._lines.put(line.strip())
        self._lines.put(None)

    def says(self, pattern: str) -> re.Match[str]:
        """Wait for a line on standard error in which the pattern is found."""
        deadline = time.monotonic() + ENOUGH_S
        while True:
            try:
                line = self._lines.get(timeout=max(0.0, deadline - time.monotonic()))
            except Empty:
                line = None
            assert line is not None, (pattern, self.errors)
            self.errors.append(line)
            found = re.search(pattern, line)
            if found is not None:
                return found

    def end(self) -> tuple[int, str, list[str]]:
        """Wait for its end; return its exit code, its answer, and its lines on standard error."""
        code = self.child.wait(ENOUGH_S)
        assert self.child.stdout is not None
        assert self.child.stderr is not None
        answer = "" if self.child.stdout.closed else self.child.stdout.read()
        while not self._lines.empty() or not self.child.stderr.closed:
            line = self._lines.get(timeout=ENOUGH_S)
            if line is None:
                self.child.stderr.close()
                self._lines.put(None)
                break
            self.errors.append(line)
        self.child.stdout.close()
        return code, answer, self.errors


def soon(holds: Callable[[], bool], what: str = "nothing came of it") -> None:
    """Wait until something holds."""
    deadline = time.monotonic() + ENOUGH_S
    while not holds():
        assert time.monotonic() < deadline, what
        time.sleep(0.02)


def folders(parent: Path) -> list[Path]:
    """Return the folders of private routers in a folder for temporary files."""
    return sorted(parent.glob("cubepath-router-*"))
