"""Recordings in, recordings out: ``cubepath log filter``, ``log split`` and ``log merge``."""

from __future__ import annotations

import argparse
from pathlib import Path

from cubepath.coordinator.commands.console import DONE, answer, progress_bar
from cubepath.coordinator.commands.files import Output, check_files, input_path, output_path
from cubepath.coordinator.commands.usage import number, whole
from cubepath.protocol.core.formatting import counted, visible
from cubepath.protocol.core.output_files import check_output_folder


def add_log_filter(kept: argparse.ArgumentParser) -> None:
    """Add the options of ``log filter``."""
    kept.set_defaults(command=_filter)
    kept.add_argument("log", type=input_path, metavar="LOG")
    kept.add_argument(
        "-o", "--out", type=output_path, required=True, metavar="OUT", help="a new .mcap file"
    )
    add_selection_options(kept)


def add_log_split(split: argparse.ArgumentParser) -> None:
    """Add the options of ``log split``."""
    split.set_defaults(command=_split)
    split.add_argument("log", type=input_path, metavar="LOG")
    split.add_argument(
        "-o",
        "--out",
        type=output_path,
        required=True,
        metavar="DIR",
        help="the folder for the parts, LOG-000.mcap and so on; it is made if need be",
    )
    ways = split.add_mutually_exclusive_group(required=True)
    ways.add_argument(
        "--parts", type=whole(1), metavar="K", help="K parts with about as many messages each"
    )
    ways.add_argument(
        "--rounds", type=whole(1), metavar="N", help="N rounds in a part; without rounds levels"
    )
    seconds = number("a number above 0", lambda found: found > 0)
    ways.add_argument(
        "--seconds", type=seconds, metavar="S", help="S seconds of the wall clock in a part"
    )


def add_log_merge(merge: argparse.ArgumentParser) -> None:
    """Add the options of ``log merge``."""
    merge.set_defaults(command=_merge)
    merge.add_argument("logs", nargs="+", type=input_path, metavar="LOG")
    merge.add_argument(
        "-o", "--out", type=output_path, required=True, metavar="OUT", help="a new .mcap file"
    )


def add_selection_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say which messages of a recording are taken."""
    for name, what in (("topics", "take only"), ("exclude", "leave out")):
        parser.add_argument(
            f"--{name}",
            action="append",
            default=[],
            metavar="GLOB",
            help=f"{what} messages whose topic KIND/SENDER, or whose kind, this matches, as"
            " 'report*' or '*/process_3'; may be given again",
        )
    for name, what in (("from", "first"), ("until", "last")):
        parser.add_argument(
            f"--{name}",
            dest=what,
            type=whole(0),
            metavar="ROUND",
            help=f"the {what} round; without rounds the {what} log time, as a level",
        )


def _filter(options: argparse.Namespace) -> int:
    from cubepath.protocol.recordings.cutting import filter_recording  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_undamaged  # noqa: PLC0415

    check_files(options, [options.log], Output(options.out, (".mcap",)))
    with progress_bar(None, "filter", ""):
        recording = read_undamaged(options.log)
        count = filter_recording(
            recording,
            options.out,
            topics=options.topics,
            exclude=options.exclude,
            first=options.first,
            until=options.last,
        )
    of = len(recording.records)
    document = {"messages": count, "of": of, "output": str(options.out)}
    answer(
        options, document, visible(f"{count} of {counted(of, 'message')} written to {options.out}")
    )
    return DONE


def _split(options: argparse.Namespace) -> int:
    from cubepath.protocol.recordings.cutting import split_recording  # noqa: PLC0415

    folder: Path = options.out
    check_files(options, [options.log])
    check_output_folder(folder)
    with progress_bar(None, "split", ""):
        made = split_recording(
            options.log, folder, parts=options.parts, rounds=options.rounds, seconds=options.seconds
        )
    first, *others = made
    last = f" to {others[-1].name}" if others else ""
    text = f"{'1 part' if len(made) == 1 else f'{len(made)} parts'} written: {first}{last}"
    answer(options, {"parts": [str(path) for path in made]}, visible(text))
    return DONE


def _merge(options: argparse.Namespace) -> int:
    from cubepath.protocol.recordings.cutting import merge_recordings  # noqa: PLC0415

    check_files(options, options.logs, Output(options.out, (".mcap",)))
    with progress_bar(None, "merge", ""):
        count = merge_recordings(options.logs, options.out)
    document = {"messages": count, "recordings": len(options.logs), "output": str(options.out)}
    of = counted(len(options.logs), "recording")
    text = f"{counted(count, 'message')} of {of} written to {options.out}"
    answer(options, document, visible(text))
    return DONE
