"""The commands ``cubepath log export``, ``filter``, ``split``, ``merge`` and ``record``."""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import re
import select
import signal
import sys
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from cubepath.coordinator.commands import console, files
from cubepath.coordinator.commands.usage import (
    above_0,
    add_fields,
    add_topics,
    more_options,
    number,
    whole,
)
from cubepath.coordinator.runs.options import RunOptions
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted, visible
from cubepath.protocol.core.output_files import STANDARD_OUTPUT, check_output_folder

if TYPE_CHECKING:
    from cubepath.coordinator.tools.recorder.recorder import Recorder
    from cubepath.protocol.recordings.recording import Recording

_MB = 1_000_000
_LOG_TIME = re.compile(r"(\d{1,20}(?:\.\d+)?|\.\d+)(s)|\d{1,20}", re.ASCII)


def add_log_filter(kept: argparse.ArgumentParser) -> None:
    """Add the options of ``log filter``."""
    kept.set_defaults(command=_filter)
    kept.add_argument("log", type=files.input_path, metavar="LOG")
    files.add_out(kept, "OUT", "a new .mcap file", required=True)
    add_selection_options(kept)


def add_log_split(split: argparse.ArgumentParser) -> None:
    """Add the options of ``log split``."""
    split.set_defaults(command=_split)
    split.add_argument("log", type=files.input_path, metavar="LOG")
    files.add_out(
        split,
        "DIR",
        "the folder for the parts, LOG-000.mcap and so on; it is made if need be",
        required=True,
    )
    ways = split.add_mutually_exclusive_group(required=True)
    ways.add_argument(
        "--parts", type=whole(1), metavar="K", help="K parts with about as many messages each"
    )
    ways.add_argument(
        "--rounds", type=whole(1), metavar="N", help="N rounds in a part; without rounds levels"
    )
    ways.add_argument(
        "--seconds", type=above_0, metavar="S", help="S seconds of the wall clock in a part"
    )
    ways.add_argument(
        "--size",
        type=above_0,
        metavar="MB",
        help="at most MB megabytes (10^6 bytes) in a part, as a file",
    )


def add_log_merge(merge: argparse.ArgumentParser) -> None:
    """Add the options of ``log merge``."""
    merge.set_defaults(command=_merge)
    merge.add_argument("logs", nargs="+", type=files.input_path, metavar="LOG")
    files.add_out(merge, "OUT", "a new .mcap file", required=True)


def add_selection_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say which messages of a recording are taken."""
    add_topics(parser)
    for name, what in (("from", "first"), ("until", "last")):
        parser.add_argument(
            f"--{name}",
            dest=what,
            type=_log_time,
            metavar="ROUND",
            help=f"the {what} round; without rounds the {what} log time, as a level; on any keys"
            " also seconds since the first message, as 1.5s",
        )


def _log_time(text: str) -> int | float:
    """Return a log time, which has 64 bits; as a float what is in seconds."""
    found = _LOG_TIME.fullmatch(text)
    if found is None or (found[2] is None and int(text) >= 1 << 64):
        raise argparse.ArgumentTypeError(
            f"expected a log time such as 12, or seconds such as 1.5s, found {text!r}"
        )
    return int(text) if found[2] is None else float(found[1])


def _within(recording: Recording, asked: float | None) -> int | None:
    """Return a log time of a recording; seconds are counted from its first message."""
    # Log times on any keys are nanoseconds since 1970.
    if recording.of_keys and isinstance(asked, int) and asked < 10**9:
        raise InputError(
            f"{asked}: messages on any keys have no rounds, expected a time such as {asked}s"
        )
    if not isinstance(asked, float):
        return asked
    if not recording.of_keys:
        raise InputError(f"{asked:g}s: a run has no such log times, expected a round or level")
    return next((each.round for each in recording.records), 0) + round(asked * 1e9)


def _filter(options: argparse.Namespace) -> int:
    from cubepath.protocol.recordings.cutting import filter_recording  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_undamaged  # noqa: PLC0415

    files.check_files(options, [options.log], files.Output(options.out, (".mcap",)))
    with console.progress_bar(None, "filter", ""):
        recording = read_undamaged(options.log)
        count = filter_recording(
            recording,
            options.out,
            topics=options.topics,
            exclude=options.exclude,
            first=_within(recording, options.first),
            until=_within(recording, options.last),
        )
    of = len(recording.records)
    document = {"messages": count, "of": of, "output": str(options.out)}
    console.answer(
        options, document, visible(f"{count} of {counted(of, 'message')} written to {options.out}")
    )
    return console.DONE


def _split(options: argparse.Namespace) -> int:
    from cubepath.protocol.recordings.cutting import split_recording  # noqa: PLC0415

    folder: Path = options.out
    files.check_files(options, [options.log])
    check_output_folder(folder)
    with console.progress_bar(None, "split", ""):
        made = split_recording(
            options.log,
            folder,
            parts=options.parts,
            rounds=options.rounds,
            seconds=options.seconds,
            size=None if options.size is None else max(1, int(options.size * _MB)),
        )
    first, *others = made
    last = f" to {others[-1].name}" if others else ""
    text = f"{'1 part' if len(made) == 1 else f'{len(made)} parts'} written: {first}{last}"
    console.answer(options, {"parts": [str(path) for path in made]}, visible(text))
    return console.DONE


def _merge(options: argparse.Namespace) -> int:
    from cubepath.protocol.recordings.cutting import merge_recordings  # noqa: PLC0415

    files.check_files(options, options.logs, files.Output(options.out, (".mcap",)))
    with console.progress_bar(None, "merge", ""):
        count = merge_recordings(options.logs, options.out)
    document = {"messages": count, "recordings": len(options.logs), "output": str(options.out)}
    of = counted(len(options.logs), "recording")
    text = f"{counted(count, 'message')} of {of} written to {options.out}"
    console.answer(options, document, visible(text))
    return console.DONE


_FORMS = {
    "csv": "a table as CSV",
    "parquet": "a table as Parquet",
    "jsonl": "a table as JSON Lines, an object a line",
    "moves": "a moves file, as 'shorten --convert' writes it",
    "mcap": "the messages as a .mcap file for other tools, with log times that they can show",
    "foxglove": "the same with the robot in three dimensions, as messages of Foxglove",
    "rrd": "the robot as a .rrd file of rerun",
}


def add_log_export(export: argparse.ArgumentParser) -> None:
    """Add the options of ``log export``."""
    export.set_defaults(command=_export)
    export.add_argument("log", type=files.input_path, metavar="LOG")
    files.add_out(
        export,
        "OUT",
        "a file whose suffix says the form: .csv, .parquet, .json, .jsonl, .mcap or .rrd; by"
        " default standard output, as CSV, or with --json as one JSON list",
        default=STANDARD_OUTPUT,
    )
    export.add_argument(
        "--format",
        choices=_FORMS,
        metavar="FORM",
        help="; ".join(f"{name}: {what}" for name, what in _FORMS.items()),
    )
    export.add_argument(
        "--table",
        choices=("moves", "claims", "messages", "rounds"),
        help="which table (default moves; on any keys messages)",
    )
    add_selection_options(export)
    more = more_options(export)
    more.add_argument(
        "--log-time",
        choices=("round", "level", "wall"),
        help="for .mcap and .rrd: rounds, or without rounds levels (default), or the wall clock",
    )
    more.add_argument(
        "--round-seconds",
        type=number("a number of at least 1e-9", lambda found: found >= 1e-9),
        metavar="S",
        help="how long a round or level lasts on the time line (default 1)",
    )
    more.add_argument(
        "--kinds",
        default="",
        metavar="KIND,...",
        help="take only messages of these kinds, also those that are parts of batches, as claim",
    )


def _export(options: argparse.Namespace) -> int:
    from cubepath.coordinator.tools.exports.exporting import export  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_undamaged  # noqa: PLC0415

    out: Path = options.out
    foxglove = options.format == "foxglove"
    form: str | None = None if foxglove else options.format
    if out == STANDARD_OUTPUT and form is None:
        form = "json" if options.json else "csv"
    elif out == STANDARD_OUTPUT and options.json:
        raise InputError(
            f"--json: standard output has the rows of --format {form}, expected a file for them or"
            " no --json"
        )
    inner = argparse.Namespace(**{**vars(options), "json": False})
    files.check_files(inner, [options.log], files.Output(out, stream=True))
    with console.progress_bar(None, "export", ""):
        recording = read_undamaged(options.log)
        found = export(
            recording,
            out,
            form=form,
            table=options.table,
            first=_within(recording, options.first),
            until=_within(recording, options.last),
            topics=options.topics,
            exclude=options.exclude,
            log_time=options.log_time,
            round_seconds=options.round_seconds,
            foxglove=foxglove,
            kinds=[each for each in options.kinds.split(",") if each],
        )
    document = {"what": found.what, "form": found.form, "count": found.count, "output": str(out)}
    console.answer(
        options, document, visible(f"{found.count} {found.what} written to {files.file_name(out)}")
    )
    return console.DONE


_LOOK_S = 0.2


def add_log_record(record: argparse.ArgumentParser) -> None:
    """Add the options of ``log record``."""
    record.set_defaults(command=_record)
    record.add_argument(
        "--connect",
        required=True,
        metavar="ENDPOINT",
        help="where the run, or your router, can be listened to: as a run says itself, or as"
        " tcp/HOST:PORT; of linked routers, all to try, separated by commas",
    )
    record.add_argument("--run", metavar="RUN", help="which run, if there are several")
    record.add_argument(
        "--keys",
        action="append",
        default=[],
        metavar="KEYS",
        help="no run: the messages of any zenoh programs on these keys, a key expression such as"
        " 'robot/**', until interrupted",
    )
    files.add_out(record, "LOG.mcap", "recording to write (default: a new file in logs/)")
    add_topics(record)
    record.add_argument(
        "--size",
        type=above_0,
        metavar="MB",
        help="start a new file, LOG-001.mcap and so on, every MB megabytes (10^6 bytes)",
    )
    record.add_argument(
        "--seconds", type=above_0, metavar="S", help="start a new file every S seconds"
    )
    record.add_argument(
        "--snapshot",
        type=above_0,
        metavar="S",
        help="keep the last S seconds in memory, and write them to LOG-000.mcap and so on whenever"
        " asked: by SIGUSR1, the key Enter, or a zenoh query",
    )
    record.add_argument("--timeout", type=above_0, metavar="S", help="leave after S seconds")
    more = more_options(record)
    more.add_argument(
        "--max-cache",
        type=above_0,
        default=100.0,
        metavar="MB",
        help="let at most MB megabytes wait to be written, or be kept (default 100)",
    )
    add_fields(more, RunOptions, "secure")
    more.add_argument(
        "--patience",
        type=above_0,
        default=10.0,
        metavar="SECONDS",
        help="give up when no run or router is there for this long (default 10)",
    )


def _only(keys: Sequence[str]) -> str | None:
    if len(keys) > 1:
        raise InputError(
            f"--keys: found {len(keys)}, expected one that takes them all, as 'robot/**', with"
            " --topics for each"
        )
    return keys[0] if keys else None


def _record(options: argparse.Namespace) -> int:
    from cubepath.coordinator.tools.recorder.recorder import Recorder  # noqa: PLC0415

    files.check_files(options, [], files.Output(options.out, (".mcap",)))
    if options.out is not None and options.out.is_file():
        raise InputError(f"{options.out}: exists already, expected a new file")
    for given, name in ((options.size, "size"), (options.seconds, "seconds")):
        if options.snapshot is not None and given is not None:
            raise InputError(f"--snapshot: each snapshot is one file, expected no --{name}")
    keys = _only(options.keys)
    interrupted = False
    recorders: list[Recorder] = []

    def ask(*_: object) -> None:
        if recorders:
            recorders[0].request_snapshot()
        else:
            console.complain("no run yet: there is nothing to write")

    with (
        _signalled(ask),
        Recorder(
            options.connect,
            options.out,
            run=options.run,
            keys=keys,
            topics=options.topics,
            exclude=options.exclude,
            split_megabytes=options.size,
            split_seconds=options.seconds,
            snapshot_seconds=options.snapshot,
            memory_megabytes=options.max_cache,
            secure=options.secure,
            patience_s=options.patience,
            say=console.complain,
        ) as recorder,
    ):
        recorders.append(recorder)
        console.complain(f"recording {keys or f'run {recorder.run}'}")
        typed = options.snapshot is not None and sys.stdin is not None and sys.stdin.isatty()
        try:
            _wait(recorder, options.timeout, typed=typed)
        except KeyboardInterrupt:
            interrupted = True
    console.answer(options, _document(recorder), console.table(_rows(recorder)))
    _complain_of(recorder, keys)
    if interrupted and keys is None:
        console.complain("interrupted")
        return console.INTERRUPTED
    if interrupted:  # as a recorder of any keys ends
        options.interrupts.came = False
    return console.FAILED if recorder.ended == "router gone" else console.DONE


def _complain_of(recorder: Recorder, keys: str | None) -> None:
    if keys is not None and not recorder.messages:
        console.complain(f"no message came on {keys}")
    if recorder.ended == "run gone":
        console.complain(f"run {recorder.run} is gone, and has not said how it ended")


def _wait(recorder: Recorder, duration_s: float | None, *, typed: bool) -> None:
    """Wait until the recorder has ended, or for this long; Enter asks for a snapshot if `typed`."""
    until = math.inf if duration_s is None else time.monotonic() + duration_s
    while (left := until - time.monotonic()) > 0 and not recorder.wait(min(_LOOK_S, left)):
        if typed and select.select([0], [], [], 0)[0]:
            with contextlib.suppress(OSError):
                os.read(0, 1 << 10)
            recorder.request_snapshot()


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
        **({"run": recorder.run} if recorder.run else {}),
        "logs": [str(path) for path in recorder.logs],
        "messages": recorder.messages,
        "ended": recorder.ended,
        "lost": recorder.lost,
        "cut_off": recorder.cut_off,
    }


def _rows(recorder: Recorder) -> list[tuple[str, object]]:
    lost = recorder.lost
    losses = ", ".join(f"{count} of {each}" for each, count in lost.items())
    return [
        *([("run", recorder.run)] if recorder.run else []),
        ("messages", recorder.messages),
        ("ended", recorder.ended),
        ("lost", losses or "none detected"),
        *([("cut off", f"{recorder.cut_off} times")] if recorder.cut_off else []),
        *(("log", path) for path in recorder.logs),
    ]
