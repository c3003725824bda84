"""Reports on sweeps: tables, plots and a page, from the rows of a folder.

Room: coordinator. The same rows give the same files, byte for byte.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cubepath.coordinator.experiments.page import page_of
from cubepath.coordinator.experiments.plots import plots_of
from cubepath.coordinator.experiments.prices import price_table
from cubepath.coordinator.experiments.rows import Row, natural
from cubepath.coordinator.experiments.sweeping import read_sweep
from cubepath.coordinator.experiments.tables import (
    Table,
    growth_table,
    pairs_table,
    runs_table,
    short_rules,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.output_files import check_output_folder, unwritable, written_whole

PAGE = "report.html"


@dataclass(frozen=True, slots=True)
class Report:
    """A report: its tables, and the files that were written, the page first."""

    runs: int
    tables: tuple[Table, ...]
    files: tuple[Path, ...]

    def document(self) -> dict[str, Any]:
        """Return the keys of ``cubepath report --json``."""
        return {
            "runs": self.runs,
            "tables": {table.title: table.document() for table in self.tables},
            "files": [str(path) for path in self.files],
        }


def write_report(folder: Path | str, out: Path | str | None = None) -> Report:
    """Write the report on a sweep's folder: a page, and each plot as SVG and PNG.

    The files are written to `out`, by default the folder ``report`` in that of the sweep. Returns
    the tables, too. InputError if the folder is no sweep's, has no runs, or cannot be written to.

    >>> results = sweep("hex:n=4..6", rules="chain", seeds=2, out="results")
    >>> report = write_report("results")
    >>> report.runs, report.files[0].name
    (6, 'report.html')
    """
    results = read_sweep(folder)
    if not results.rows:
        raise InputError(f"{folder}: has no finished runs, expected some to report on")
    target = Path(folder) / "report" if out is None else Path(out)
    check_output_folder(target)
    rows = short_rules(results.rows)
    tables = tuple(make(rows) for make in (runs_table, price_table, pairs_table, growth_table))
    plots = plots_of(rows, results.rounds)
    page = page_of(_title(rows), _facts(rows), tables, plots)
    files = {PAGE: page.encode()}
    for plot in plots:
        files |= {f"{plot.name}.svg": plot.svg, f"{plot.name}.png": plot.png}
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(target, error) from None
    for name, data in files.items():
        with written_whole(target / name) as stream:
            stream.write(data)
    return Report(len(results.rows), tables, tuple(target / name for name in files))


def _title(rows: Sequence[Row]) -> str:
    rules = sorted({str(row["rule"]) for row in rows}, key=natural)
    families = sorted({str(row["family"] or row["system"]) for row in rows}, key=natural)
    return f"{', '.join(rules)} on {', '.join(families)}"


def _facts(rows: Sequence[Row]) -> list[tuple[str, object]]:
    seeds = sorted({row["seed"] for row in rows})
    ended = sorted({row["ended"] for row in rows})
    counts = ", ".join(f"{sum(row['ended'] == end for row in rows)} {end}" for end in ended)
    return [
        ("runs", len(rows)),
        ("systems", len({row["system"] for row in rows})),
        ("seeds", f"{len(seeds)}, from {seeds[0]} to {seeds[-1]}"),
        ("cores", ", ".join(sorted({row["core"] for row in rows}))),
        ("ended", counts),
        ("code", ", ".join(sorted({row["code"] for row in rows}))),
    ]
