"""The options that say how long moves take: ``--durations`` and ``--duration``."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from cubepath.coordinator.commands.files import input_path
from cubepath.protocol.core.errors import InputError

if TYPE_CHECKING:  # a command starts faster without it
    from cubepath.protocol.path_files.durations import Durations


def add_duration_options(shorten: argparse.ArgumentParser) -> None:
    """Add ``--durations`` and ``--duration``."""
    shorten.add_argument(
        "--durations",
        type=input_path,
        metavar="FILE",
        help="how long moves take (TOML or JSON); -o then writes a timetable, a move a line",
    )
    shorten.add_argument(
        "--duration",
        action="append",
        default=[],
        metavar="NAME=TIME",
        help="how long the moves of a generator, or the move of an id, take: 2, 1.5, 3/2"
        " (default 1); may be given again",
    )


def given_durations(options: argparse.Namespace) -> Durations | None:
    """Return what ``--durations`` and ``--duration`` say, None if there is neither."""
    if options.durations is None and not options.duration:
        return None
    from cubepath.protocol.path_files.durations import (  # noqa: PLC0415
        Durations,
        durations_in_words,
        read_durations,
    )

    found = Durations() if options.durations is None else read_durations(options.durations)
    try:
        return found.with_named(durations_in_words(options.duration))
    except InputError as error:
        raise InputError(f"--duration {error}") from None
