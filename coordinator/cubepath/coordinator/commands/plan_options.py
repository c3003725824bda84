"""The options for plans of other programs: their format, and the files that belong to them."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from cubepath.coordinator.commands.console import DONE, FAILED, complain
from cubepath.coordinator.commands.files import input_path

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.coordinator.shortening.normal_path import Shortened
    from cubepath.protocol.file_forms import PlanHints

INPUT_HELP = (
    "a recording, a moves file (JSON Lines or .npz), a scenario (JSON), or another program's plan;"
    " - is standard input"
)


def add_plan_options(parser: argparse.ArgumentParser) -> None:
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
