"""Commands of cubepath side by side, and waiting for what comes of them."""

import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from cubepath.coordinator.testing import Command

ENOUGH_S = 60.0


class Running(Command):
    """One command of cubepath."""

    def __init__(
        self, folder: Path, arguments: tuple[str, ...], within: Sequence[str] = ()
    ) -> None:
        """Start it in a folder, which temporary files go to as well; `within` comes before it."""
        super().__init__(
            [*within, sys.executable, "-m", "cubepath.coordinator", *arguments],
            name=arguments[0],
            cwd=folder,
            env={"TMPDIR": str(folder), "CUBEPATH_PROGRESS": "0"},
        )

    def end(self) -> tuple[int, str, list[str]]:
        """Wait for its end; return its exit code, its answer, and its lines on standard error."""
        return self.wait(ENOUGH_S), self.out, self.err.splitlines()


class Commands(ExitStack):
    """Commands that run side by side in a folder, as a context manager that ends them."""

    def __init__(self, folder: Path) -> None:
        """Run in this folder."""
        super().__init__()
        self.folder = folder

    def start(self, *arguments: str) -> Running:
        """Start a command."""
        return self.enter_context(Running(self.folder, arguments))


def soon(holds: Callable[[], bool], what: str = "nothing came of it") -> None:
    """Wait until something holds."""
    deadline = time.monotonic() + ENOUGH_S
    while not holds():
        assert time.monotonic() < deadline, what
        time.sleep(0.02)


def folders(parent: Path) -> list[Path]:
    """Return the folders of private routers in a folder for temporary files."""
    return sorted(parent.glob("cubepath-router-*"))
