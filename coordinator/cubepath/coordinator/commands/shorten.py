"""The commands ``cubepath shorten`` and ``cubepath convert``: a path in other forms."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from cubepath.coordinator.commands.certificates import (
    add_explain_options,
    check_explain_options,
    explain,
    write_schedule,
)
from cubepath.coordinator.commands.console import answer, table
from cubepath.coordinator.commands.files import (
    PATH_SUFFIXES,
    Output,
    check_files,
    file_name,
    input_path,
    output_path,
)
from cubepath.coordinator.commands.plan_options import (
    INPUT_HELP,
    add_plan_options,
    hints,
    plan_rows,
    solved,
)
from cubepath.coordinator.commands.progress import progress_bar
from cubepath.coordinator.commands.usage import AddCommand
from cubepath.coordinator.plugins import plugin
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import visible


def add_commands(command: AddCommand) -> None:
    """Add ``shorten`` and ``convert``."""
    shorten = command("shorten", _shorten)
    shorten.add_argument("input", type=input_path, metavar="INPUT", help=INPUT_HELP)
    shorten.add_argument(
        "-o",
        "--output",
        type=output_path,
        metavar="CUBES.jsonl",
        help="write the cubes to this file: JSON Lines (.jsonl), or the binary form (.npz); - is"
        " standard output, and the summary goes to standard error",
    )
    shorten.add_argument(
        "--system", metavar="SYSTEM", help="the system that the moves of a moves file name"
    )
    add_plan_options(shorten)
    plugin("add_beyond_options")(shorten)
    add_explain_options(shorten)
    plugin("add_following_options")(shorten)

    convert = command("convert", _convert)
    convert.add_argument(
        "input",
        type=input_path,
        metavar="INPUT",
        help=f"{INPUT_HELP}; or cubes as .npz",
    )
    convert.add_argument(
        "output",
        type=output_path,
        metavar="OUTPUT",
        help="a file whose name ends in .jsonl or .npz; - for JSON Lines on standard output",
    )
    convert.add_argument(
        "--system", metavar="SYSTEM", help="the system that the moves of a moves file name"
    )
    add_plan_options(convert)


def _shorten(options: argparse.Namespace) -> int:
    if options.following is not None:
        code: int = plugin("shorten_following")(options)
        return code
    from cubepath.coordinator.shortening.normal_path import shorten  # noqa: PLC0415

    check_explain_options(options)
    output: Path | None = options.output
    beyond: str | None = plugin("improving")(options)
    if output is not None and output.suffix.lower() == ".npz" and beyond is not None:
        raise InputError(
            f"{output}: holds moves of the input alone, expected a .jsonl file with {beyond}"
        )
    with progress_bar(None, "shorten", " moves") as bar:
        found = shorten(
            options.input, system=options.system, progress=bar.update, hints=hints(options)
        )
    began = time.perf_counter()
    known = plugin("look_beyond")(options, found)
    seconds = found.seconds + (0 if known is None else time.perf_counter() - began)
    told = explain(options, found)
    if output is not None:
        with progress_bar(None, "write", ""):
            write_schedule(output, found, known, told)
    rows: list[tuple[str, object]] = [
        ("moves", found.moves),
        ("reduced moves", found.reduced_moves),
        ("cubes", found.cubes),
        ("largest cube", found.max_cube_dimension),
        *plan_rows(found),
        *plugin("beyond_rows")(known, options.proof),
        *told.rows,
        ("time", f"{seconds:.2f} s"),
    ]
    if options.output is not None:
        rows.append(("written to", file_name(options.output)))
    document = found.document() | {"seconds": round(seconds, 3)}
    document |= ({} if known is None else known.document()) | told.document
    answer(options, document, "\n".join([table(rows), *map(visible, told.lines)]))
    return solved(options, found.given.unsolved)


def _convert(options: argparse.Namespace) -> int:
    from cubepath.coordinator.shortening.conversion import convert  # noqa: PLC0415

    check_files(options, [options.input], Output(options.output, PATH_SUFFIXES, stream=True))
    with progress_bar(None, "convert", " moves") as bar:
        found = convert(
            options.input,
            options.output,
            system=options.system,
            progress=bar.update,
            hints=hints(options),
        )
    document = {"what": found.what, "count": found.count, "output": str(options.output)}
    written = visible(file_name(options.output))
    answer(options, document, f"{found.count} {found.what} written to {written}")
    return solved(options, found.unsolved)
