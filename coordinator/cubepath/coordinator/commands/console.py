"""What every command says and how: answers, tables, progress bars, complaints, exit codes.

Standard output and standard error may be full, closed, or a pipe that nobody reads any more.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import Any, Self, TextIO

from cubepath.protocol.core.errors import CheckError

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
CLOSED_PIPE = 141
"""As a shell tells it of a program that SIGPIPE has ended."""

SYSTEM_HELP = "NAME, NAME:key=value,... or a .toml file; see 'cubepath systems' (default hex)"


class Interrupts:
    """Remembers whether the user interrupted, for a compiler may swallow the exception.

    Outside the main thread, or where somebody handles SIGINT already, it does nothing.
    """

    def __init__(self) -> None:
        """Begin with none."""
        self.came = False
        self._installed = False

    def __enter__(self) -> Self:
        here = threading.current_thread() is threading.main_thread()
        if here and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, self._note)
            self._installed = True
        return self

    def __exit__(self, *_: object) -> None:
        if self._installed:
            signal.signal(signal.SIGINT, signal.default_int_handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.came = True
        signal.default_int_handler(number, frame)


def prepare_streams() -> None:
    """Make standard streams that are closed harmless; CheckError where standard output is.

    Otherwise the next file that is opened would take the number of the stream, and get what
    somebody writes there.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # takes the lowest number
    if is_closed(sys.stderr):
        sys.stderr = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - until the end
    if is_closed(sys.stdout):
        raise CheckError("standard output: closed, expected a place for the answer")


def is_closed(stream: TextIO | None) -> bool:
    """Tell whether a standard stream was closed when Python began, whatever its type says."""
    return stream is None


def silence(stream: TextIO) -> None:
    """Send what is still to be written to a stream nowhere: Python would try it again at exit."""
    with contextlib.suppress(OSError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def complain(what: object) -> None:
    """Say something in one line on standard error; where that takes nothing, nothing is said."""
    try:
        print(f"cubepath: {what}", file=sys.stderr, flush=True)
    except OSError:
        silence(sys.stderr)


def say(text: str, end: str = "\n") -> None:
    """Write a text to standard output.

    CheckError where it cannot be written, BrokenPipeError where nobody reads it any more.
    """
    try:
        print(text, end=end, flush=True)
    except BrokenPipeError:
        silence(sys.stdout)
        raise
    except OSError as error:
        silence(sys.stdout)
        raise CheckError(f"standard output: {error.strerror or error}") from None


def answer(options: argparse.Namespace, document: object, text: str) -> None:
    """Print the answer of a command: the document with --json, else the text; errors of `say`."""
    say(json.dumps(document) if options.json else text)


def table(rows: Sequence[tuple[str, object]]) -> str:
    """Return names and values in two columns."""
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {value}" for name, value in rows)


def progress_bar(total: int | None, what: str, unit: str) -> Any:
    """Return a progress bar on standard error; none where that is not a terminal."""
    from tqdm import tqdm  # noqa: PLC0415 - a command starts faster without it

    return tqdm(total=total, desc=what, unit=unit, disable=None, leave=False, file=sys.stderr)
