"""Reports on sweeps: tables, plots and a page, from the rows of a folder.

The same rows give the same files, byte for byte. The page is one HTML file with its tables and
plots inside, for light and dark; it loads nothing.
"""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from html import escape
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.experiments.folder import arrow, parts_of, read_mark, unreadable
from cubepath.coordinator.experiments.plots import INK, MEASURES, Plot, plots_of
from cubepath.coordinator.experiments.rows import Row, natural
from cubepath.coordinator.experiments.sweeping import read_sweep
from cubepath.coordinator.experiments.tables import (
    ReportTable,
    groups,
    growth_table,
    pairs_table,
    price_table,
    runs_table,
    short_names,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.core.input_files import file_within
from cubepath.protocol.core.output_files import check_output_folder, unwritable, written_whole
from cubepath.protocol.displays import Displayed

_STYLE = """
:root { color-scheme: light dark;
  --ink: #1b1f24; --page: #ffffff; --rule: #d0d4da; --soft: #f3f5f7; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e8eb; --page: #15181c; --rule: #3a4048; --soft: #1e2329; }
}
body { margin: 2rem auto; padding: 0 1.2rem; max-width: 75rem; color: var(--ink);
  background: var(--page); font: 15px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2.2rem; }
.note { max-width: 50rem; } .wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 13px; }
th, td { padding: .25rem .6rem; text-align: left; border-bottom: 1px solid var(--rule);
  white-space: nowrap; }
th { background: var(--soft); position: sticky; top: 0; }
@media print { .wide { overflow: visible; } th, td { white-space: normal; padding: .15rem .3rem; }
  table { font-size: 9px; } }
td.number, th.number { text-align: right; }
figure { margin: 1.2rem 0; } figure svg { max-width: 100%; height: auto; color: var(--ink); }
svg text { font-family: system-ui, "DejaVu Sans", sans-serif !important; }
"""


def page_of(
    title: str,
    facts: Sequence[tuple[str, object]],
    tables: Iterable[ReportTable],
    plots: Iterable[Plot],
) -> str:
    """Return the page as HTML."""
    rows_html = "".join(
        f"<tr><th>{escape(name)}</th><td>{escape(str(each))}</td></tr>" for name, each in facts
    )
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{escape(title)}</h1><table>{rows_html}</table>",
        *map(_figure, plots),
        *map(table_html, tables),
        "</body></html>",
    ]
    return "\n".join(parts) + "\n"


def _figure(plot: Plot) -> str:
    text = plot.svg().decode()
    svg = text[text.index("<svg") :].replace(INK, "currentColor")
    # Behind the data is the page itself.
    svg = re.sub(r'(<g id="patch_1">\s*<path [^>]*style=")fill: #ffffff', r"\1fill: none", svg)
    svg = svg.replace("fill: #ffffff", "fill: none")
    # Names are of the whole page, and each plot begins to count anew.
    svg = re.sub(r'(id="|href="#|url\(#)', rf"\g<1>{plot.name}-", svg)
    head, _, rest = svg.partition(">")
    return f'<figure>{head} role="img" aria-label="{escape(plot.title)}">{rest}</figure>'


def table_html(table: ReportTable) -> str:
    """Return a table as HTML, with its title and note; empty if it has no rows."""
    if not table.rows:
        return ""
    texts = table.texts()
    numbers = [
        all(not isinstance(row[place], str) or not row[place] for row in table.rows)
        for place in range(len(table.columns))
    ]
    kinds = [' class="number"' if number else "" for number in numbers]
    head = "".join(
        f"<th{kind}>{escape(name)}</th>" for kind, name in zip(kinds, table.columns, strict=True)
    )
    body = "\n".join(
        "<tr>"
        + "".join(f"<td{kind}>{escape(text)}</td>" for kind, text in zip(kinds, row, strict=True))
        + "</tr>"
        for row in texts
    )
    return (
        f'<h2>{escape(table.title)}</h2><p class="note">{escape(table.note)}</p>'
        f'<div class="wide"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>\n{body}\n</tbody></table></div>"
    )


PAGE = "report.html"


@dataclass(frozen=True, slots=True)
class SweepReport(Displayed):
    """A report: its tables, and the files that were written, the page first.

    `older` counts the runs of the folder that are in no table, as their scene or rule has changed
    since.
    """

    runs: int
    older: int
    tables: tuple[ReportTable, ...]
    files: tuple[Path, ...]

    def document(self) -> dict[str, Any]:
        """Return the keys of ``cubepath report --json``."""
        return {
            "runs": self.runs,
            "older": self.older,
            "tables": {table.title: table.document() for table in self.tables},
            "files": [str(path) for path in self.files],
        }


def write_report(
    folder: Path | str,
    out: Path | str | None = None,
    *,
    pool: Sequence[str] | None = None,
    columns: Sequence[str] = (),
    axes: Sequence[str] = (),
    size: Sequence[float] = (),
    pdf: bool = False,
) -> SweepReport:
    """Write the report on a sweep's folder: a page, and each plot as SVG and PNG.

    The files are written to `out`, by default the folder ``report`` in that of the sweep. Returns
    the tables, too. Of a system or rule whose file has changed between runs the last version is
    taken, and the others are counted as `older`. InputError if the folder is no sweep's, has no
    runs, or cannot be written to.

    Scenes that differ in the keys of `pool` alone, as ``seed``, are runs of one setting; None takes
    what the sweep's file says. With `columns`, the tables that have them are shown without others.
    With two `axes`, the one plot is that of these columns, across and up. `size` is the width and
    the height of a plot in inches. With `pdf`, plots are written as PDF too, without their titles.

    >>> results = sweep("hex:n=4..6", rules="chain", seeds=2, out="results")
    >>> report = write_report("results")
    >>> report.runs, report.files[0].name
    (6, 'report.html')
    """
    if len(axes) not in {0, 2} or not {*axes} <= {*MEASURES}:
        known = ", ".join(MEASURES)
        raise InputError(f"axes: found {','.join(axes)!r}, expected two of {known}")
    if len(size) not in {0, 2} or not all(1 <= each <= 100 for each in size):
        raise InputError(f"size: found {[*size]}, expected two of 1 to 100 inches")
    results = read_sweep(folder)
    if not results.rows:
        raise InputError(f"{folder}: has no finished runs, expected some to report on")
    target = file_within(Path(folder), "report") if out is None else Path(out)
    check_output_folder(target)
    versions, notes = read_mark(Path(folder))
    last = _of_last_versions(results.rows, versions)
    older = len(results.rows) - len(last)
    rows = short_names(last, notes.pool if pool is None else pool)
    others = [make(rows) for make in (price_table, pairs_table, growth_table)]
    tables = runs_table(rows, notes.published), *others
    tables = _with_columns(tables, columns) if columns else tables
    left = distances(Path(folder), {row["id"] for row in rows})
    plots = plots_of(rows, left, axes, size, notes.published)
    page = page_of(_title(rows), run_facts(rows, older), tables, plots)
    files = {PAGE: page.encode()}
    for plot in plots:
        files |= {f"{plot.name}.svg": plot.svg(), f"{plot.name}.png": plot.png()}
        files |= {f"{plot.name}.pdf": plot.pdf()} if pdf else {}
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(target, error) from None
    for name, data in files.items():
        with written_whole(file_within(target, name)) as stream:
            stream.write(data)
    return SweepReport(len(rows), older, tables, tuple(target / name for name in files))


def _with_columns(tables: Sequence[ReportTable], names: Sequence[str]) -> tuple[ReportTable, ...]:
    """Return the tables that have these columns, without others; InputError if none has them."""
    found = []
    for table in tables:
        if {*names} <= {*table.columns}:
            rows = [dict(zip(table.columns, row, strict=True)) for row in table.rows]
            kept = tuple(tuple(row[name] for name in names) for row in rows)
            found.append(replace(table, columns=tuple(names), rows=kept))
    if not found:
        held = "; ".join(f"{table.title}: {', '.join(table.columns)}" for table in tables)
        raise InputError(f"columns: no table has {', '.join(names)}, expected those of one: {held}")
    return tuple(found)


def distances(folder: Path, ids: Collection[str]) -> dict[str, NDArray[np.int64]]:
    """Return for runs of a folder how far the goal is after each round, shape (rounds,).

    It is the `distance`, or what is `missing` where that is not known; runs without either are left
    out. Columns are read as they are, since there may be millions of rounds. InputError if a file
    cannot be read.
    """
    pa, compute = arrow(), import_module("pyarrow.compute")
    found: dict[str, NDArray[np.int64]] = {}
    for part in parts_of(folder):
        path = folder / "rounds" / part.name
        try:
            table = pa.parquet.read_table(path, columns=["id", "round", "missing", "distance"])
        except (OSError, pa.ArrowException) as error:
            raise unreadable(path, error) from None
        left = compute.coalesce(table["distance"], table["missing"])
        known = compute.is_valid(left)
        names = table["id"].filter(known).combine_chunks().dictionary_encode()
        runs, rounds, left = (
            np.asarray(each)
            for each in (names.indices, table["round"].filter(known), left.filter(known))
        )
        order = np.lexsort((rounds, runs))
        ends = np.cumsum(np.bincount(runs, minlength=len(names.dictionary)))[:-1]
        each = np.split(left[order], ends)
        found |= {
            run: values
            for run, values in zip(names.dictionary.to_pylist(), each, strict=False)
            if run in ids
        }
    return found


def _of_last_versions(rows: Sequence[Row], versions: Sequence[str]) -> list[Row]:
    """Return the rows of the last version of each scene, and there of each rule.

    `versions` are those of the folder in the order in which they were last swept, each the version
    of the code and the hashes of what the scene and the rule's file held.
    """
    places = {tuple(version.split(" ")): n for n, version in enumerate(versions)}
    configurations = {row["id"]: json.loads(row["configuration"]) for row in rows}

    def place(row: Row) -> int:
        of = configurations[row["id"]]
        return places.get((row["code"], of["scene"], of["source"]), -1)

    kept = set[str]()
    for several in groups(rows, ["system"]).values():
        scene = configurations[max(several, key=place)["id"]]["scene"]
        there = [row for row in several if configurations[row["id"]]["scene"] == scene]
        for mine in groups(there, ["rule"]).values():
            source = configurations[max(mine, key=place)["id"]]["source"]
            kept |= {row["id"] for row in mine if configurations[row["id"]]["source"] == source}
    return [row for row in rows if row["id"] in kept]


def _title(rows: Sequence[Row]) -> str:
    rules = sorted({str(row["rule"]) for row in rows}, key=natural)
    families = sorted({str(row["family"] or row["system"]) for row in rows}, key=natural)
    return f"{', '.join(rules)} on {', '.join(families)}"


def run_facts(rows: Sequence[Row], older: int = 0) -> list[tuple[str, object]]:
    """Return what the head of a report says of its runs, of which there is at least one."""
    seeds = sorted({row["seed"] for row in rows})
    ended = sorted({row["ended"] for row in rows})
    counts = ", ".join(f"{sum(row['ended'] == end for row in rows)} {end}" for end in ended)
    before = (
        [("left out", f"{counted(older, 'run')} of earlier versions of a scene or rule")]
        if older
        else []
    )
    return [
        ("runs", len(rows)),
        *before,
        ("systems", len({row["system"] for row in rows})),
        ("seeds", f"{len(seeds)}, from {seeds[0]} to {seeds[-1]}"),
        ("cores", ", ".join(sorted({row["core"] for row in rows}))),
        ("ended", counts),
        ("code", ", ".join(sorted({row["code"] for row in rows}))),
    ]
