"""`cubepath verify A B --same` and `--homotopic`: whether two paths are equal.

A path is a recording, of a run with rounds or without, or whatever `shorten` takes.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from cubepath.coordinator.commands.console import DONE, FAILED, answer, complain
from cubepath.coordinator.commands.files import check_files, file_name
from cubepath.coordinator.commands.plan_options import hints
from cubepath.coordinator.commands.progress import progress_bar
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted


def add_comparing_options(verify: argparse.ArgumentParser) -> None:
    """Add ``--same`` and ``--homotopic``."""
    how = verify.add_mutually_exclusive_group()
    how.add_argument(
        "--same",
        action="store_true",
        help="whether two runs, or files of moves, are equal up to swapping commuting moves",
    )
    how.add_argument(
        "--homotopic",
        action="store_true",
        help="whether two runs, or files of moves, have the same normal cube path",
    )


def compares(options: argparse.Namespace) -> bool:
    """Return whether two paths are to be compared."""
    return bool(options.same or options.homotopic)


def compare(options: argparse.Namespace) -> int:
    """Compare two paths; exit code 1 and one line if they differ."""
    how = "--same" if options.same else "--homotopic"
    paths: list[Path] = options.logs
    if len(paths) != 2:
        raise InputError(f"{how}: found {counted(len(paths), 'path')}, expected two")
    for name in ("of", "cubes", "recover"):
        if getattr(options, name) is not None:
            raise InputError(f"{how}: compares two paths, expected no --{name}")
    check_files(options, paths)
    from cubepath.coordinator.shortening.conversion import difference_of  # noqa: PLC0415

    with progress_bar(None, "compare", " moves") as bar:
        found = difference_of(
            (paths[0], paths[1]),
            options.system,
            hints(options),
            bar.update,
            homotopic=options.homotopic,
        )
    word = "homotopic" if options.homotopic else "same"
    document = {word: found is None, "difference": found}
    answer(options, document, word if found is None else f"not {word}: {found}")
    if found is not None:
        complain(f"{file_name(paths[0])}, {file_name(paths[1])}: not {word}: {found}")
    return DONE if found is None else FAILED
