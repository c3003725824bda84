"""The command that records a live run from outside: ``cubepath log record``."""

from __future__ import annotations

import argparse
import contextlib
import os
import select
import signal
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING

from cubepath.coordinator.commands.console import DONE, FAILED, INTERRUPTED, answer, complain, table
from cubepath.coordinator.commands.files import Output, check_files, output_path
from cubepath.coordinator.commands.usage import add_fields, more_options, number
from cubepath.coordinator.runs.options import RunOptions
from cubepath.protocol.core.errors import InputError

if TYPE_CHECKING:  # a command starts faster without it
    from cubepath.coordinator.tools.recorder.recorder import Recorder

_LOOK_S = 0.2
_above_0 = number("a number above 0", lambda each: each > 0)


def add_log_record(record: argparse.ArgumentParser) -> None:
    """Add the options of ``log record``."""
    record.set_defaults(command=_record)
    record.add_argument(
        "--connect",
        required=True,
        metavar="ENDPOINT",
        help="where the run can be listened to: as it says itself, or that of its router",
    )
    record.add_argument("--run", metavar="RUN", help="which run, if there are several")
    record.add_argument(
        "-o",
        "--out",
        type=output_path,
        metavar="LOG.mcap",
        help="recording to write (default: a new file in logs/)",
    )
    record.add_argument(
        "--topics",
        action="append",
        default=[],
        metavar="GLOB",
        help="record these alone, as 'bundle/*' or 'ready'; may be given several times",
    )
    record.add_argument(
        "--exclude", action="append", default=[], metavar="GLOB", help="leave these topics out"
    )
    record.add_argument(
        "--size",
        type=_above_0,
        metavar="MB",
        help="start a new file, LOG-001.mcap and so on, every MB megabytes (10^6 bytes)",
    )
    record.add_argument(
        "--seconds", type=_above_0, metavar="S", help="start a new file every S seconds"
    )
    record.add_argument(
        "--snapshot",
        type=_above_0,
        metavar="S",
        help="keep the last S seconds in memory, and write them to LOG-000.mcap and so on whenever"
        " asked: by SIGUSR1, the key Enter, or a zenoh query",
    )
    record.add_argument("--timeout", type=_above_0, metavar="S", help="leave after S seconds")
    more = more_options(record)
    more.add_argument(
        "--max-cache",
        type=_above_0,
        default=100.0,
        metavar="MB",
        help="let at most MB megabytes wait to be written, or be kept (default 100)",
    )
    add_fields(more, RunOptions, "secure")
    more.add_argument(
        "--patience",
        type=_above_0,
        default=10.0,
        metavar="SECONDS",
        help="give up when no run is there for this long (default 10)",
    )


def _record(options: argparse.Namespace) -> int:
    from cubepath.coordinator.tools.recorder.recorder import record  # noqa: PLC0415

    check_files(options, [], Output(options.out, (".mcap",)))
    if options.out is not None and options.out.is_file():
        raise InputError(f"{options.out}: exists already, expected a new file")
    for given, name in ((options.size, "size"), (options.seconds, "seconds")):
        if options.snapshot is not None and given is not None:
            raise InputError(f"--snapshot: each snapshot is one file, expected no --{name}")
    interrupted = False
    with (
        _signalled(lambda *_: complain("no run yet: there is nothing to write")),
        record(
            options.connect,
            options.out,
            run=options.run,
            topics=options.topics,
            exclude=options.exclude,
            split_megabytes=options.size,
            split_seconds=options.seconds,
            snapshot_seconds=options.snapshot,
            memory_megabytes=options.max_cache,
            secure=options.secure,
            patience_s=options.patience,
            say=complain,
        ) as recorder,
    ):
        complain(f"recording run {recorder.run}")
        try:
            with _asking(recorder, snapshots=options.snapshot is not None) as look:
                _wait(recorder, options.timeout, look)
        except KeyboardInterrupt:
            interrupted = True
    answer(options, _document(recorder), table(_rows(recorder)))
    if recorder.ended == "run gone":
        complain(f"run {recorder.run} is gone, and has not said how it ended")
    if interrupted:
        complain("interrupted")
        return INTERRUPTED
    return FAILED if recorder.ended == "router gone" else DONE


def _wait(recorder: Recorder, duration_s: float | None, look: Callable[[], None]) -> None:
    until = None if duration_s is None else time.monotonic() + duration_s
    while not recorder.wait(_LOOK_S if until is None else min(_LOOK_S, _left(until))):
        if until is not None and time.monotonic() >= until:
            return
        look()


def _left(until: float) -> float:
    return max(0.0, until - time.monotonic())


@contextmanager
def _asking(recorder: Recorder, *, snapshots: bool) -> Generator[Callable[[], None]]:
    """Have SIGUSR1 ask for a snapshot; yield what looks whether the keyboard does."""

    def ask(_number: int, _frame: FrameType | None) -> None:
        recorder.request_snapshot()

    typed = snapshots and sys.stdin is not None and sys.stdin.isatty()

    def look() -> None:
        if typed and select.select([0], [], [], 0)[0]:
            with contextlib.suppress(OSError):
                os.read(0, 1 << 10)
            recorder.request_snapshot()

    with _signalled(ask):
        yield look


@contextmanager
def _signalled(handler: Callable[[int, FrameType | None], object]) -> Generator[None]:
    """Handle SIGUSR1, which would end the command by itself, before its file is closed."""
    before = signal.signal(signal.SIGUSR1, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGUSR1, before)


def _document(recorder: Recorder) -> dict[str, object]:
    return {
        "run": recorder.run,
        "logs": [str(path) for path in recorder.logs],
        "messages": recorder.messages,
        "ended": recorder.ended,
        "lost": recorder.lost,
        "cut_off": recorder.cut_off,
    }


def _rows(recorder: Recorder) -> list[tuple[str, object]]:
    lost = recorder.lost
    told = ", ".join(f"{count} of {each}" for each, count in lost.items())
    return [
        ("run", recorder.run),
        ("messages", recorder.messages),
        ("ended", recorder.ended),
        ("lost", told or "nothing that is known of"),
        *([("cut off", f"{recorder.cut_off} times")] if recorder.cut_off else []),
        *(("log", path) for path in recorder.logs),
    ]
