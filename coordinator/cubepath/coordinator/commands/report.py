"""The command that tells what came of a sweep: ``cubepath report``."""

from __future__ import annotations

import argparse
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING

from cubepath.coordinator.commands.console import DONE, answer
from cubepath.coordinator.commands.progress import progress_bar
from cubepath.protocol.core.formatting import counted, visible

if TYPE_CHECKING:  # a command starts faster without it
    from cubepath.coordinator.experiments.tables import ReportTable

_WIDE = 100
"""The letters in a line of a table's note."""


def add_report(report: argparse.ArgumentParser) -> None:
    """Add the options of ``report``."""
    report.set_defaults(command=_report)
    report.add_argument("folder", type=Path, metavar="DIR", help="the folder of 'cubepath sweep'")
    report.add_argument(
        "-o", "--out", type=Path, metavar="OUT", help="folder for the files (default: DIR/report)"
    )


def _report(options: argparse.Namespace) -> int:
    from cubepath.coordinator.experiments.report import write_report  # noqa: PLC0415

    with progress_bar(None, "report", ""):
        report = write_report(options.folder, options.out)
    lines = [line for table in report.tables for line in _lines(table)]
    if report.older:
        lines.append(
            f"left out: {counted(report.older, 'run')} of earlier versions of a scene or rule"
        )
    lines += [f"written to {path}" for path in report.files[:1]]
    answer(options, report.document(), "\n".join(map(visible, lines)))
    return DONE


def _lines(table: ReportTable) -> list[str]:
    """Return a table in columns, and what these are; nothing without rows."""
    if not table.rows:
        return []
    # What is empty throughout tells nothing.
    texts = [list(table.columns), *table.texts()]
    kept = [n for n in range(len(table.columns)) if any(row[n] for row in texts[1:])]
    widths = {n: max(len(row[n]) for row in texts) for n in kept}
    rows = ["  ".join(f"{row[n]:<{widths[n]}}" for n in kept).rstrip() for row in texts]
    return [f"{table.title}:", *rows, *wrap(table.note, _WIDE), ""]
