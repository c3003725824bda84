"""Recordings for other tools: ``cubepath log export``."""

from __future__ import annotations

import argparse
from pathlib import Path

from cubepath.coordinator.commands.console import DONE, answer, progress_bar
from cubepath.coordinator.commands.files import (
    Output,
    check_files,
    file_name,
    input_path,
    output_path,
)
from cubepath.coordinator.commands.usage import more_options, number
from cubepath.coordinator.tools.commands.cutting import add_selection_options
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import visible
from cubepath.protocol.core.output_files import STANDARD_OUTPUT

_FORMS = {
    "csv": "a table as CSV",
    "parquet": "a table as Parquet",
    "jsonl": "a table as JSON Lines, an object a line",
    "moves": "a moves file, as 'shorten --convert' writes it",
    "mcap": "the messages as a .mcap file for other tools, with log times that they can show",
    "foxglove": "the same with the robot in three dimensions, as messages of Foxglove",
    "rrd": "the robot as a .rrd file of rerun",
}


def add_log_export(export: argparse.ArgumentParser) -> None:
    """Add the options of ``log export``."""
    export.set_defaults(command=_export)
    export.add_argument("log", type=input_path, metavar="LOG")
    export.add_argument(
        "-o",
        "--out",
        type=output_path,
        default=STANDARD_OUTPUT,
        metavar="OUT",
        help="a file whose suffix says the form: .csv, .parquet, .json, .jsonl, .mcap or .rrd; by"
        " default standard output, as CSV, or with --json as one JSON list",
    )
    export.add_argument(
        "--format",
        choices=_FORMS,
        metavar="FORM",
        help="; ".join(f"{name}: {what}" for name, what in _FORMS.items()),
    )
    export.add_argument(
        "--table",
        choices=("moves", "claims", "messages", "rounds"),
        default="moves",
        help="which table (default moves)",
    )
    add_selection_options(export)
    more = more_options(export)
    more.add_argument(
        "--log-time",
        choices=("round", "level", "wall"),
        help="for .mcap and .rrd: rounds, or without rounds levels (default), or the wall clock",
    )
    more.add_argument(
        "--round-seconds",
        type=number("a number of at least 1e-9", lambda found: found >= 1e-9),
        metavar="S",
        help="how long a round or level lasts on the time line (default 1)",
    )
    more.add_argument(
        "--kinds",
        default="",
        metavar="KIND,...",
        help="take only messages of these kinds, also those that are parts of batches, as claim",
    )


def _export(options: argparse.Namespace) -> int:
    from cubepath.coordinator.tools.exports.exporting import export  # noqa: PLC0415

    out: Path = options.out
    foxglove = options.format == "foxglove"
    form: str | None = None if foxglove else options.format
    if out == STANDARD_OUTPUT and form is None:
        form = "json" if options.json else "csv"
    elif out == STANDARD_OUTPUT and options.json:
        raise InputError(
            f"--json: standard output has the rows of --format {form}, expected a file for them or"
            " no --json"
        )
    inner = argparse.Namespace(**{**vars(options), "json": False})
    check_files(inner, [options.log], Output(out, stream=True))
    with progress_bar(None, "export", ""):
        found = export(
            options.log,
            out,
            form=form,
            table=options.table,
            first=options.first,
            until=options.last,
            topics=options.topics,
            exclude=options.exclude,
            log_time=options.log_time,
            round_seconds=options.round_seconds,
            foxglove=foxglove,
            kinds=[each for each in options.kinds.split(",") if each],
        )
    document = {"what": found.what, "form": found.form, "count": found.count, "output": str(out)}
    answer(options, document, visible(f"{found.count} {found.what} written to {file_name(out)}"))
    return DONE
