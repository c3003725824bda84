"""Where the command begins: an interrupt is one line from the first moment on."""

import gc
import os
import signal
import subprocess
import sys
import threading
import weakref
from collections.abc import Iterator, Sequence
from types import ModuleType

import pytest

from cubepath.coordinator.commands.console import Interrupts
from cubepath.coordinator.commands.entry import entry
from processes.command_line import GOLDEN

MAIN = "cubepath.coordinator.commands.main"


@pytest.fixture(autouse=True)
def _safe_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the environment as it was: a command changes that of its process."""
    monkeypatch.setenv("PYTHONSAFEPATH", "1")


class Interrupting:
    """Stands before all that finds modules, and is interrupted while the command is imported."""

    def find_spec(
        self, name: str, _path: Sequence[str] | None, _target: ModuleType | None = None
    ) -> None:
        """Raise KeyboardInterrupt where the command is looked for."""
        if name == MAIN:
            raise KeyboardInterrupt


def test_an_interrupt_before_the_command_begins_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With exit code 130, and nothing on standard output."""
    monkeypatch.delitem(sys.modules, MAIN, raising=False)
    monkeypatch.setattr(sys, "meta_path", [Interrupting(), *sys.meta_path])
    assert entry() == 130
    assert capsys.readouterr() == ("", "cubepath: interrupted\n")


class Signalling:
    """Stands there too, and sends a signal in the middle of an import."""

    def __init__(self, module: str, number: signal.Signals) -> None:
        self._module = module
        self._number = number
        self.went_on = False

    def find_spec(
        self, name: str, _path: Sequence[str] | None, _target: ModuleType | None = None
    ) -> None:
        """Send the signal where the module is looked for."""
        if name == self._module and not self.went_on:
            signal.raise_signal(self._number)
            self.went_on = True


@pytest.fixture
def no_collection() -> Iterator[None]:
    """Collect no garbage: libraries of tests have callbacks there, which an interrupt may hit."""
    gc.disable()
    yield
    gc.enable()


@pytest.mark.usefixtures("no_collection")
@pytest.mark.parametrize(
    ("module", "number"),
    [
        (MAIN, signal.SIGINT),
        ("cubepath.coordinator.runs.contents", signal.SIGINT),
        ("cubepath.coordinator.runs.contents", signal.SIGTERM),
    ],
)
def test_an_interrupt_waits_for_the_end_of_an_import(
    module: str,
    number: signal.Signals,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Of the command, or of what it needs: then it is one line, with exit code 130."""
    signalling = Signalling(module, number)
    monkeypatch.delitem(sys.modules, module, raising=False)
    monkeypatch.setattr(sys, "meta_path", [signalling, *sys.meta_path])
    recording = str(GOLDEN / "hex-5.mcap")
    code = entry(
        ["replay", recording, "--rate", "1"] if module == MAIN else ["log", "info", recording]
    )
    assert (code, signalling.went_on) == (130, True)
    assert capsys.readouterr().err == "cubepath: interrupted\n"


def test_an_interrupt_in_a_finalizer_is_raised_after_it() -> None:
    """Python prints an exception that a finalizer raises, and goes on without it."""
    with Interrupts(), pytest.raises(KeyboardInterrupt):
        dying = threading.Event()
        weakref.finalize(dying, signal.raise_signal, signal.SIGINT)
        del dying
        threading.Event().wait(10)


def test_an_interrupt_while_a_process_starts_is_raised_when_it_has(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Otherwise nobody would know the process, and nobody end it."""
    read = os.read

    def interrupted(file: int, size: int) -> bytes:
        """Send a signal where a start waits for the program to begin."""
        monkeypatch.undo()
        signal.raise_signal(signal.SIGINT)
        return read(file, size)

    process = None
    with Interrupts(), pytest.raises(KeyboardInterrupt):
        monkeypatch.setattr(os, "read", interrupted)
        process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
        process.wait(10)
    assert process is not None
    process.communicate(b"\n", timeout=10)
    assert process.returncode == 0
