"""`cubepath diff A B`: where two runs part, and why."""

from __future__ import annotations

import argparse
import re

from cubepath.coordinator.commands.console import DONE, FAILED, answer
from cubepath.coordinator.commands.files import check_files, input_path
from cubepath.coordinator.commands.progress import progress_bar
from cubepath.coordinator.commands.usage import AddCommand, number

_RANGE = re.compile(r"(\d*)\.\.(\d*)|(\d+)")
_KINDS = ("here", "note", "claim", "verdict", "report", "edges", "cube", "summary")
"""As in `comparison.asking`, which takes too long to load for a line of help."""


def add_commands(command: AddCommand) -> None:
    """Add the command and its options."""
    diff = command("diff", _diff)
    for name in ("a", "b"):
        diff.add_argument(
            name,
            type=input_path,
            metavar=name.upper(),
            help="a recording, or whatever shorten takes, of which the moves are compared",
        )
    diff.add_argument(
        "--rounds",
        type=_rounds,
        default=(1, None),
        metavar="FIRST..LAST",
        help="compare these rounds alone (default: all); either may be left out",
    )
    diff.add_argument(
        "--ignore",
        action="append",
        default=[],
        metavar="NAME",
        help="do not list this parameter, or do not compare messages of this kind:"
        f" {', '.join(_KINDS)}; may be repeated",
    )
    diff.add_argument(
        "--context",
        type=number("a whole number of at least 0", lambda found: found >= 0 and found % 1 == 0),
        default=0,
        metavar="N",
        help="show N messages of the round before and after the first that differs",
    )
    diff.add_argument(
        "--system",
        metavar="SYSTEM",
        help="the system that the moves of a moves file name (default: that of the recording"
        " beside it)",
    )


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
    from cubepath.coordinator.tools.comparison.comparing import diff  # noqa: PLC0415 - loads numpy

    with progress_bar(None, "compare", ""):
        found = diff(
            options.a,
            options.b,
            ignore=options.ignore,
            context=int(options.context),
            rounds=options.rounds,
            system=options.system,
        )
    answer(options, found.document(), str(found))
    return DONE if found.same else FAILED
