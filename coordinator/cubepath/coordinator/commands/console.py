"""The output of commands: answers, tables, complaints, exit codes.

Standard output and standard error may be full, closed, or a pipe without a reader.
"""

import _thread
import argparse
import contextlib
import io
import json
import os
import signal
import sys
import threading
import time
import weakref
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, Self, TextIO, cast

from cubepath.protocol.core.errors import CheckError, bounded
from cubepath.protocol.core.formatting import visible
from cubepath.protocol.core.output_files import STANDARD_OUTPUT

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
CLOSED_PIPE = 141
"""The exit code that a shell reports for a program killed by SIGPIPE."""

_AGAIN_S = 0.01
_WAIT_S_MAX = 2.0
"""Seconds that an interrupt waits at most: an import may be that of a user's own file."""

SYSTEM_HELP = "NAME, NAME:key=value,... or a .toml file; see 'cubepath system list' (default hex)"


class Interrupts:
    """Makes SIGTERM and SIGHUP act like SIGINT, and remembers whether a signal came.

    The exception lets half-written files be removed. The flag is needed because a compiler may
    swallow the exception. During an import it waits until that is over, for a while: a module that
    is half imported, or compiled, may not survive it. So it does during a finalizer, out of which
    no exception comes, and while `subprocess` starts a process, which nobody would end. It does
    nothing outside the main thread, and leaves signals alone that already have another handler.
    """

    def __init__(self) -> None:
        self.came = False
        self._before: dict[int, Any] = {}
        self._sending = threading.Lock()
        self._since: float | None = None
        """When the first signal came that waits."""

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
                handler = signal.getsignal(number)
                if handler in (signal.default_int_handler, signal.SIG_DFL):
                    self._before[number] = handler
                    signal.signal(number, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        with self._sending:
            before, self._before = self._before, {}
        for number, handler in before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.came = True
        if _must_wait(frame):
            self._since = self._since or time.monotonic()
            if time.monotonic() < self._since + _WAIT_S_MAX:
                _thread.start_new_thread(self._send_again, (number,))
                return
        self._since = None
        signal.default_int_handler(number, frame)

    def _send_again(self, number: int) -> None:
        """Send a signal to the main thread once more, in a moment."""
        time.sleep(_AGAIN_S)
        with self._sending:
            if self._before:
                signal.pthread_kill(cast("int", threading.main_thread().ident), number)


def _must_wait(frame: FrameType | None) -> bool:
    """Return whether a signal came in an import, a finalizer, or the start of a process."""
    while frame is not None:
        file, name = frame.f_code.co_filename, frame.f_code.co_name
        if file.startswith("<frozen importlib") or file == weakref.__file__:
            return True
        if name == "_execute_child":  # of `subprocess`, which is not imported for this
            return True
        frame = frame.f_back
    return False


def prepare_streams() -> None:
    """Replace closed standard streams; CheckError if standard output is closed.

    What standard output cannot encode is escaped, as on standard error.

    Otherwise the next file that is opened would get the file descriptor of the stream, and receive
    what is written to the stream.
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
    if isinstance(sys.stdout, io.TextIOWrapper):  # a caller may have put something else there
        sys.stdout.reconfigure(errors="backslashreplace")


def is_closed(stream: TextIO | None) -> bool:
    """Return whether a standard stream was closed when Python started, whatever its type says."""
    return stream is None


def silence(stream: TextIO) -> None:
    """Discard the unwritten output of a stream, which Python would try to write again at exit."""
    with contextlib.suppress(OSError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def complain(what: object) -> None:
    """Write one line to standard error, with control characters shown."""
    _note(f"cubepath: {visible(bounded(str(what)))}")


def _note(text: str) -> None:
    """Write a text to standard error, or silence it if it cannot be written to."""
    try:
        print(text, file=sys.stderr, flush=True)
    except OSError:
        silence(sys.stderr)


def say(text: str, end: str = "\n") -> None:
    """Write a text to standard output.

    CheckError if it cannot be written, BrokenPipeError if nobody reads it any more.
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
    """Print the answer of a command: the document with --json, else the text; errors as for `say`.

    Its lines hold no control characters: `table` shows them, and so does `visible`.
    If the output of the command itself goes to standard output, the text goes to standard error.
    """
    if getattr(options, "out", None) == STANDARD_OUTPUT:
        _note(text)
    else:
        say(json.dumps(document) if options.json else text)


def table(rows: Sequence[tuple[str, object]]) -> str:
    """Return names and values in two columns, with control characters shown."""
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {visible(str(value))}" for name, value in rows)


_FIRST_SECONDS, _LATER_SECONDS = 5.0, 30.0
"""Off a terminal, the seconds until the first line, and between later lines."""


_TICK_SECONDS = 0.5
"""How often the time is shown while nothing is counted, as when code is compiled."""


def progress_bar(total: int | None, what: str, unit: str) -> Any:
    """Return a progress bar on standard error: on a terminal a bar, elsewhere `Lines`.

    The time continues while nothing is counted; without a `unit` it is all there is. The
    environment variable ``CUBEPATH_PROGRESS=0`` turns both off.
    """
    stream = sys.stderr
    bar: Any
    if os.environ.get("CUBEPATH_PROGRESS") == "0":
        bar = Lines(stream, total, what, unit)
        bar.close()
        return bar
    if stream.isatty():
        from tqdm import tqdm  # noqa: PLC0415 - a command starts faster without it

        shown = None if unit else "{desc}: {elapsed}"
        bar = tqdm(total=total, desc=what, unit=unit, leave=False, file=stream, bar_format=shown)
    else:
        bar = Lines(stream, total, what, unit)
    threading.Thread(target=_tick, args=(bar,), daemon=True).start()
    return bar


def _tick(bar: Any) -> None:
    """Show the time until the bar is closed."""
    while not bar.disable:
        time.sleep(_TICK_SECONDS)
        bar.refresh()


class Lines:
    """Progress as lines, for logs: none in the first seconds, so a short command says nothing.

    It has the methods of `tqdm` that commands use.
    """

    def __init__(
        self,
        stream: TextIO,
        total: int | None,
        what: str,
        unit: str,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.n = 0
        self.total = total
        self.disable = False
        self._lock = threading.Lock()
        self._stream = stream
        self._what = what
        self._unit = unit
        self._state = ""
        self._clock = clock
        self._begun = clock()
        self._due = self._begun + _FIRST_SECONDS

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def update(self, n: int = 1) -> None:
        """Count, and write a line if one is due."""
        self.n += n
        self.refresh()

    def refresh(self) -> None:
        """Write a line if one is due."""
        with self._lock:
            now = self._clock()
            if self.disable or now < self._due:
                return
            self._due = now + _LATER_SECONDS
            of = "" if self.total is None else f" of {self.total}"
            count = f" {self.n}{of}{self._unit}," if self.n or self.total else ""
            state = f" {self._state}," if self._state else ""
            line = f"cubepath: {self._what}:{count}{state} {now - self._begun:.0f} s"
            try:
                print(line, file=self._stream, flush=True)
            except (OSError, ValueError):  # full, without a reader, or closed
                self.disable = True

    def reset(self, total: int | None = None) -> None:
        """Begin again at zero."""
        self.n, self.total = 0, total

    def set_description(self, desc: str, **_: object) -> None:
        """Set the name of the current work."""
        self._what = desc

    def set_postfix_str(self, s: str, **_: object) -> None:
        """Set the current state, which is part of each line."""
        self._state = s

    def clear(self) -> None:
        """Do nothing: lines need no clearing before an answer."""

    def close(self) -> None:
        """Write no more lines."""
        with self._lock:
            self.disable = True
