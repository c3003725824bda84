"""The command ``cubepath sweep``: many runs, and a folder of their results."""

from __future__ import annotations

import argparse
import re
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from cubepath.coordinator.commands.console import (
    DONE,
    FAILED,
    INTERRUPTED,
    Lines,
    answer,
    complain,
    progress_bar,
    table,
)
from cubepath.coordinator.commands.files import add_out, check_files
from cubepath.coordinator.commands.usage import add_fields, given, more_options, whole
from cubepath.coordinator.experiments.options import SweepOptions
from cubepath.protocol.core.errors import OptionError
from cubepath.protocol.core.formatting import counted, visible
from cubepath.protocol.core.options import option_fields

if TYPE_CHECKING:  # a command starts faster without it
    from cubepath.coordinator.experiments.spec import Expansion

_TOLD_MAX = 5
"""The most lines that are printed of a kind; the document has all."""


def add_sweep(sweep: argparse.ArgumentParser) -> None:
    """Add the options of ``sweep``."""
    sweep.set_defaults(command=_sweep)
    sweep.add_argument(
        "systems",
        nargs="+",
        metavar="SYSTEM",
        help="systems as for 'cubepath run', with ranges and lists in their keys, as in"
        " hex:n=4..40 or agv:graph=K5,C8,n=2; 'standard' for the standard set; or one SPEC.toml"
        " with all of a sweep, or one of instances-1, movingai-1 and pogema-1",
    )
    sweep.add_argument(
        "--rule",
        action="append",
        metavar="RULE,...",
        help="rules, names or FILE.py:NAME (default: the one that reaches the goal)",
    )
    sweep.add_argument(
        "--seeds", metavar="N", help="N seeds from 0 on; or A..B, or a list as 3,7, (default 10)"
    )
    sweep.add_argument(
        "--clock", action="append", metavar="CLOCK,...", help="lockstep, free (default lockstep)"
    )
    sweep.add_argument(
        "--hesitate",
        metavar="P,...",
        help="each module skips a round with this probability (default 0)",
    )
    sweep.add_argument(
        "--faults",
        action="append",
        metavar="KEY=RATE,...",
        help="what goes wrong, at these rates: loss, delay (of delay_ms), duplicate, crash, slow"
        " (by slow_factor), each with one value or several, or none; may be given several times",
    )
    add_fields(sweep, SweepOptions, "max_rounds")
    add_out(
        sweep,
        "DIR",
        "folder for the results; finished runs in it are skipped (default: one in logs/sweeps"
        " that is named by the first SYSTEM)",
        folder=True,
    )
    sweep.add_argument(
        "--log", action="store_true", help="keep a recording of each run with messages"
    )
    sweep.add_argument(
        "--jobs", type=whole(1), metavar="N", help="processes (default: one for each core)"
    )
    sweep.add_argument("--dry-run", action="store_true", help="list what would be played")
    more = more_options(sweep)
    names = ("core", "timeout_s", "processes", "keepers", "optimum", "improve")
    add_fields(more, SweepOptions, *names)
    more.add_argument(
        "--data", metavar="DIR", help="folder of the files that the systems name, as POGEMA's maps"
    )
    more.add_argument(
        "--connect", metavar="ADDRESS", help="play on a dask cluster, by its scheduler's address"
    )


def _sweep(options: argparse.Namespace) -> int:
    from cubepath.coordinator.experiments.spec import expand, sweep_of  # noqa: PLC0415

    check_files(options, [])
    expansion = expand(sweep_of(options.systems, _given(options)))
    for line in _few(expansion.left_out):
        complain(f"left out: {line}")
    if options.dry_run:
        return _dry_run(options, expansion)
    return _play(options, expansion)


def _given(options: argparse.Namespace) -> dict[str, object]:
    """Return the options that were given, as they would stand in a file."""
    named = {
        "rules": _split(options.rule),
        "clocks": _split(options.clock),
        "hesitate": None
        if options.hesitate is None
        else [_share(text) for text in options.hesitate.split(",")],
        "faults": options.faults,
        "seeds": options.seeds,
        "data": options.data,
    }
    given_lists = {key: value for key, value in named.items() if value is not None}
    return given_lists | given(options, option_fields(SweepOptions))


def _split(several: Iterable[str] | None) -> list[str] | None:
    """Return names separated by commas; one before KEY=VALUE belongs to the name before it."""
    if several is None:
        return None
    return [each for text in several for each in re.split(r",(?!\w+=)", text)]


def _share(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise OptionError(f"hesitate: expected numbers as 0,0.5, found {text!r}") from None


def _few(lines: Sequence[str]) -> list[str]:
    more = len(lines) - _TOLD_MAX
    return [*lines[:_TOLD_MAX], *([f"and {more} more"] if more > 0 else [])]


def _dry_run(options: argparse.Namespace, expansion: Expansion) -> int:
    settings = [
        (
            setting.label,
            setting.rule,
            setting.clock,
            setting.hesitate,
            setting.faults.text(),
            setting.core,
        )
        for setting in expansion.settings
    ]
    names = ("system", "rule", "clock", "hesitate", "faults", "core")
    document = {
        "runs": expansion.runs,
        "settings": [
            {**dict(zip(names, key, strict=True)), "seeds": list(expansion.seeds)}
            for key in settings
        ],
        "left_out": list(expansion.left_out),
    }
    lines = [
        f"{system}, rule {rule}, {clock}, hesitate {hesitate:g}, faults {faults}, {core}:"
        f" {counted(len(expansion.seeds), 'run')}"
        for system, rule, clock, hesitate, faults, core in settings
    ]
    answer(options, document, "\n".join(map(visible, [*lines, counted(expansion.runs, "run")])))
    return DONE


def _folder(options: argparse.Namespace) -> Path:
    if options.out is not None:
        out: Path = options.out
        return out
    first = options.systems[0]
    name = Path(first if first.endswith(".toml") else first.partition(":")[0]).name
    return Path("logs") / "sweeps" / name.removesuffix(".toml")


def _play(options: argparse.Namespace, expansion: Expansion) -> int:
    from cubepath.coordinator.experiments.sweeping import play_sweep  # noqa: PLC0415
    from cubepath.coordinator.experiments.workers import cores  # noqa: PLC0415

    folder, began = _folder(options), time.monotonic()
    interrupted, known = False, 0
    ended, failures = Counter[str](), list[dict[str, Any]]()
    with progress_bar(expansion.runs, "sweep", " runs") as bar:

        def begin(before: int) -> None:
            nonlocal known
            known = before
            bar.total = expansion.runs - before
            bar.refresh()

        def watch(runs: Sequence[Any]) -> None:
            ended.update(each.run["ended"] for each in runs)
            failures.extend(each.run for each in runs if each.failed)
            notes = [f"{len(failures)} failures"] if failures else []
            done = bar.n + len(runs)
            if isinstance(bar, Lines):  # a bar on a terminal says so itself
                seconds = (time.monotonic() - began) * (bar.total - done) / done
                notes.append(f"about {seconds:.0f} s left")
            bar.set_postfix_str(", ".join(notes), refresh=False)
            bar.update(len(runs))
            if options.interrupts.came:  # where Python runs a finalizer, the exception is dropped
                raise KeyboardInterrupt

        try:
            found = play_sweep(
                expansion,
                folder,
                jobs=options.jobs or cores(),
                cluster=options.connect,
                record=options.log,
                watch=watch,
                begin=begin,
                apart=expansion.foreign,
            )
            ended, failures = Counter(row["ended"] for row in found.rows), found.failures
        except KeyboardInterrupt:
            # There may be millions of rows, and an interrupt does not wait for them.
            interrupted = True
            ended += Counter({"before": known})
    seconds = time.monotonic() - began
    counts = dict(sorted(ended.items()))
    document = {
        "folder": str(folder),
        "runs": expansion.runs,
        "finished": ended.total(),
        "known": known,
        "failures": len(failures),
        "ended": counts,
        "left_out": list(expansion.left_out),
        "failed": [
            {key: row[key] for key in ("system", "rule", "seed", "ended", "reason", "id")}
            for row in failures
        ],
        "seconds": round(seconds, 3),
    }
    text = table(
        [
            ("runs", expansion.runs),
            ("finished", f"{ended.total()}, of which {known} before"),
            ("ended", ", ".join(f"{count} {name}" for name, count in counts.items()) or "none"),
            ("failures", len(failures)),
            ("time", f"{seconds:.2f} s"),
            ("results", folder),
        ]
    )
    answer(options, document, text)
    for line in _few([_failure(row) for row in failures]):
        complain(line)
    if interrupted:
        complain("interrupted")
        return INTERRUPTED
    return FAILED if failures else DONE


def _failure(row: Mapping[str, Any]) -> str:
    return "{system}, rule {rule}, seed {seed}: {ended}: {reason}".format_map(row)


if TYPE_CHECKING:  # a command starts faster without it
    from cubepath.coordinator.experiments.tables import ReportTable

_WIDE = 100
"""The letters in a line of a table's note."""


def add_report(report: argparse.ArgumentParser) -> None:
    """Add the options of ``report``."""
    report.set_defaults(command=_report)
    report.add_argument("folder", type=Path, metavar="DIR", help="the folder of 'cubepath sweep'")
    add_out(report, "OUT", "folder for the files (default: DIR/report)", folder=True)

    for name, what in (
        ("pool", "count scenes that differ only in these keys, as seed, as one"),
        ("columns", "show the tables that have these columns, without others"),
    ):
        report.add_argument(f"--{name}", type=_names, metavar="NAME,...", help=what)
    what = "draw one plot, of these columns, as modules and costs"
    report.add_argument("--axes", nargs=2, metavar=("X", "Y"), help=what)
    what = "width and height of each plot in inches"
    report.add_argument("--size", nargs=2, type=float, metavar=("W", "H"), help=what)
    report.add_argument("--pdf", action="store_true", help="write plots as PDF too, without titles")


def _report(options: argparse.Namespace) -> int:
    from cubepath.coordinator.experiments.report import write_report  # noqa: PLC0415

    shown = given(options, ("pool", "columns", "axes", "size", "pdf"))
    with progress_bar(None, "report", ""):
        report = write_report(options.folder, options.out, **shown)
    lines = [line for table in report.tables for line in _table_lines(table)]
    if report.older:
        lines.append(
            f"left out: {counted(report.older, 'run')} of earlier versions of a scene or rule"
        )
    lines += [f"written to {path}" for path in report.files[:1]]
    answer(options, report.document(), "\n".join(map(visible, lines)))
    return DONE


def _names(text: str) -> tuple[str, ...]:
    return tuple(text.split(","))


def _table_lines(table: ReportTable) -> list[str]:
    """Return a table in columns, and what these are; nothing without rows."""
    if not table.rows:
        return []
    # What is empty throughout tells nothing.
    texts = [list(table.columns), *table.texts()]
    kept = [n for n in range(len(table.columns)) if any(row[n] for row in texts[1:])]
    widths = {n: max(len(row[n]) for row in texts) for n in kept}
    rows = ["  ".join(f"{row[n]:<{widths[n]}}" for n in kept).rstrip() for row in texts]
    return [f"{table.title}:", *rows, *wrap(table.note, _WIDE), ""]
