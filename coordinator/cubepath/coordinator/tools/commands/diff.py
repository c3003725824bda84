"""The command ``cubepath diff A B``: where two runs part, and why; or whether two paths are equal.

A path is a recording, of a run with rounds or without, or anything that `shorten` reads.
"""

import argparse
import re

from cubepath.coordinator.commands.console import DONE, FAILED, answer, complain, progress_bar
from cubepath.coordinator.commands.files import check_files, file_name, input_path
from cubepath.coordinator.commands.path_options import add_plan_options, hints
from cubepath.coordinator.commands.usage import more_options
from cubepath.protocol.core.errors import InputError

_RANGE = re.compile(r"(\d*)\.\.(\d*)|(\d+)")


def add_diff(diff: argparse.ArgumentParser) -> None:
    """Add the options of ``diff``."""
    diff.set_defaults(command=_diff)
    for name in ("a", "b"):
        diff.add_argument(
            name,
            type=input_path,
            metavar=name.upper(),
            help="a recording, or whatever shorten takes, of which the moves are compared",
        )
    how = diff.add_mutually_exclusive_group()
    how.add_argument(
        "--same",
        action="store_true",
        help="whether the two are equal up to swapping commuting moves",
    )
    how.add_argument(
        "--homotopic", action="store_true", help="whether the two have the same normal cube path"
    )
    diff.add_argument(
        "--rounds",
        type=_rounds,
        metavar="FIRST..LAST",
        help="compare these rounds alone (default: all); either may be left out",
    )
    diff.add_argument(
        "--system",
        metavar="SYSTEM",
        help="the system that the moves of a moves file name (default: that of the recording"
        " beside it)",
    )
    add_plan_options(more_options(diff))


def _rounds(text: str) -> tuple[int, int | None]:
    found = _RANGE.fullmatch(text)
    if found is None or text == "..":
        raise argparse.ArgumentTypeError(
            f"expected FIRST..LAST as 3..9, 3.. or ..9, found {text!r}"
        )
    first, last, one = found.groups()
    if one is not None:
        return int(one), int(one)
    return int(first or 1), int(last) if last else None


def _diff(options: argparse.Namespace) -> int:
    check_files(options, [options.a, options.b])
    if options.same or options.homotopic:
        return _equal(options)
    from cubepath.coordinator.tools.comparison.run_comparison import diff  # noqa: PLC0415 - loads numpy

    with progress_bar(None, "compare", ""):
        found = diff(
            options.a,
            options.b,
            rounds=options.rounds or (1, None),
            system=options.system,
            hints=hints(options),
        )
    answer(options, found.document(), str(found))
    return DONE if found.same else FAILED


def _equal(options: argparse.Namespace) -> int:
    """Say whether two paths are equal; exit code 1 and one line if they differ."""
    how = "--same" if options.same else "--homotopic"
    if options.rounds:
        raise InputError(f"{how}: compares two paths, expected no --rounds")
    from cubepath.coordinator.shortening.conversion import difference_of  # noqa: PLC0415

    with progress_bar(None, "compare", " moves") as bar:
        found = difference_of(
            (options.a, options.b),
            options.system,
            hints(options),
            bar.update,
            homotopic=options.homotopic,
        )
    word = "homotopic" if options.homotopic else "same"
    document = {word: found is None, "difference": found}
    answer(options, document, word if found is None else f"not {word}: {found}")
    if found is not None:
        complain(f"{file_name(options.a)}, {file_name(options.b)}: not {word}: {found}")
    return DONE if found is None else FAILED
