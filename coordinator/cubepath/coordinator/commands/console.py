"""What every command says and how: answers, tables, progress bars, complaints, exit codes."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import threading
from collections.abc import Sequence
from types import FrameType
from typing import Self

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

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


def complain(what: object) -> None:
    """Say something in one line on standard error."""
    print(f"cubepath: {what}", file=sys.stderr)


def answer(options: argparse.Namespace, document: object, text: str) -> None:
    """Print the answer of a command: the document with --json, else the text."""
    print(json.dumps(document) if options.json else text)


def table(rows: Sequence[tuple[str, object]]) -> str:
    """Return names and values in two columns."""
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {value}" for name, value in rows)
