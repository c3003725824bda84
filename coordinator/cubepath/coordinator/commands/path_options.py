"""Options of the commands that read paths: a plan's format and files, and how long moves take."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cubepath.coordinator.commands.console import DONE, FAILED, complain
from cubepath.coordinator.commands.files import input_path
from cubepath.protocol.core.errors import InputError

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.coordinator.shortening.normal_path import Shortened
    from cubepath.protocol.file_forms import PlanHints
    from cubepath.protocol.path_files.durations import Durations

_NAMED = re.compile(r"^[^/]*=")
"""A duration by its name, rather than a file; ``./a=b`` is a file."""
INPUT_HELP = (
    "a recording, a moves file (JSON Lines or .npz), a scenario (JSON), or another program's plan;"
    " - is standard input"
)


def add_plan_options(parser: Any) -> None:
    """Add ``--format`` and ``--with``."""
    parser.add_argument(
        "--format",
        metavar="NAME",
        help="format of a plan, if its content does not say or more is needed: mapf-log,"
        " mapf-agents:order=xy or rc, mapf-json:by=step, cgshop2021, cgshop2026:triangulation=K,"
        " plain",
    )
    parser.add_argument(
        "--with",
        dest="companions",
        type=input_path,
        metavar="FILE",
        action="append",
        default=[],
        help="a file that a plan refers to: its map, scenario (with another --with) or instance",
    )


def add_durations(parser: Any) -> None:
    """Add ``--durations``."""
    parser.add_argument(
        "--durations",
        action="append",
        default=[],
        metavar="FILE|NAME=TIME",
        help="how long moves take: a file (TOML or JSON), or NAME=TIME for the moves of a generator"
        " or the move of an id, as edge=1.5 or 7=3/2 (default 1); may be given again; -o then"
        " writes a timetable, a move a line",
    )


def duration_file(options: argparse.Namespace) -> Path | None:
    """Return the file of ``--durations``, None if there is none; InputError if there are two."""
    files = [each for each in options.durations if not _NAMED.search(each)]
    if len(files) > 1:
        raise InputError(f"--durations: found {len(files)} files, expected one")
    if files and files[0] not in ("", "-") and not Path(files[0]).exists():
        expected = "expected a file, or NAME=TIME as in edge=3/2"
        raise InputError(f"--durations {files[0]}: no such file, {expected}")
    try:
        return input_path(files[0]) if files else None
    except argparse.ArgumentTypeError as error:
        raise InputError(f"--durations: {error}") from None


def given_durations(options: argparse.Namespace) -> Durations | None:
    """Return what ``--durations`` says, None if it is not given."""
    if not options.durations:
        return None
    from cubepath.protocol.path_files.durations import Durations, durations_in_words, read_durations  # noqa: PLC0415

    file = duration_file(options)
    found = Durations() if file is None else read_durations(file)
    try:
        return found.with_named(
            durations_in_words([each for each in options.durations if _NAMED.search(each)])
        )
    except InputError as error:
        raise InputError(f"--durations {error}") from None


def hints(options: argparse.Namespace) -> PlanHints:
    """Return the hints that the options give."""
    from cubepath.protocol.file_forms import PlanHints  # noqa: PLC0415

    return PlanHints(options.format, tuple(options.companions))


def solved(options: argparse.Namespace, unsolved: str | None) -> int:
    """Return the exit code of a command that has done its work on a path.

    A plan that does not end as its instance asks is a failed check, with a line on standard error.
    """
    if unsolved is None:
        return DONE
    complain(f"{options.input}: the plan does not solve its instance: {unsolved}")
    return FAILED


def plan_rows(found: Shortened) -> list[tuple[str, object]]:
    """Return the lines of the summary."""
    if found.planner_rounds is None:
        return []
    return [("planner's rounds", found.planner_rounds)]
