"""The command ``cubepath shorten``: a path shortened, proved and timed, or in another form."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cubepath.coordinator.commands import files
from cubepath.coordinator.commands.console import answer, progress_bar, table
from cubepath.coordinator.commands.path_options import (
    INPUT_HELP,
    add_durations,
    add_plan_options,
    duration_file,
    given_durations,
    hints,
    plan_rows,
    solved,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import visible

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.coordinator.shortening.explain import TimedPath
    from cubepath.coordinator.shortening.normal_path import Shortened
    from cubepath.protocol.path_files.certificates import Certificate
    from cubepath.protocol.path_files.moves import CubeName


def add_shorten(shorten: argparse.ArgumentParser) -> None:
    """Add the options of ``shorten``."""
    shorten.set_defaults(command=_shorten)
    add_path_options(shorten)
    add_plan_options(shorten)
    shorten.add_argument(
        "--explain",
        action="store_true",
        help="say which chain of moves proves that no schedule in the class is shorter",
    )
    shorten.add_argument(
        "--certificate",
        type=files.output_path,
        metavar="FILE.json",
        help="write the proof, for 'cubepath verify FILE.json --of INPUT'",
    )
    add_durations(shorten)
    shorten.add_argument(
        "--convert",
        action="store_true",
        help="shorten nothing: write the moves or cubes of INPUT as they are to the file of -o, in"
        " the form of its name",
    )


def add_path_options(parser: argparse.ArgumentParser) -> None:
    """Add INPUT, ``--out`` and ``--system``."""
    parser.add_argument("input", type=files.input_path, metavar="INPUT", help=INPUT_HELP)
    files.add_out(
        parser,
        "CUBES.jsonl",
        "write the cubes to this file: JSON Lines (.jsonl), or the binary form (.npz); - is"
        " standard output, and the summary goes to standard error",
    )
    parser.add_argument(
        "--system", metavar="SYSTEM", help="the system that the moves of a moves file name"
    )


def _shorten(options: argparse.Namespace) -> int:
    if options.convert:
        return _convert(options)
    out: Path | None = options.out
    if options.durations and out is not None and out.suffix.lower() == ".npz":
        raise InputError(f"{out}: a timetable is JSON Lines, expected another name")
    files.check_files(
        options,
        [options.input, duration_file(options)],
        files.Output(out, files.PATH_SUFFIXES, stream=True),
        files.Output(options.certificate, (".json",)),
    )
    found = shortened_input(options)
    certified = _certified(options, found)
    if out is not None:
        with progress_bar(None, "write", ""):
            if certified.timed is None:
                write_schedule(out, found, lambda: found.named)
            else:
                from cubepath.protocol.path_files.durations import write_timetable  # noqa: PLC0415

                write_timetable(out, certified.timed.lines())
    return answer_shortened(options, found, certified)


def shortened_input(options: argparse.Namespace) -> Shortened:
    """Return the input, shortened in its homotopy class."""
    from cubepath.coordinator.shortening.normal_path import shortened  # noqa: PLC0415
    from cubepath.coordinator.shortening.path_input import read_input  # noqa: PLC0415

    with progress_bar(None, "shorten", " moves") as bar:
        return shortened(read_input(options.input, options.system, hints(options), bar.update))


@dataclass(frozen=True, slots=True)
class MoreResults:
    """What a command adds to the answer on a path: keys for ``--json``, rows and lines."""

    document: dict[str, Any]
    rows: tuple[tuple[str, object], ...] = ()
    lines: tuple[str, ...] = ()
    timed: TimedPath | None = None


def answer_shortened(options: argparse.Namespace, found: Shortened, more: MoreResults) -> int:
    """Answer with the counts of a path and `more`; return the exit code."""
    document = found.document() | more.document
    document["seconds"] = round(document["seconds"], 3)
    rows: list[tuple[str, object]] = [
        ("moves", found.moves),
        ("reduced moves", found.reduced_moves),
        ("cubes", found.cubes),
        ("largest cube", found.max_cube_dimension),
        *plan_rows(found),
        *more.rows,
        ("time", f"{document['seconds']:.2f} s"),
    ]
    if options.out is not None:
        rows.append(("written to", files.file_name(options.out)))
    answer(options, document, "\n".join([table(rows), *map(visible, more.lines)]))
    return solved(options, found.given.unsolved)


def write_schedule(
    out: Path, found: Shortened, named: Callable[[], Sequence[tuple[CubeName, ...]]]
) -> None:
    """Write the cubes of a path: those of its class as arrays, or `named` as lines."""
    if out.suffix.lower() == ".npz":
        from cubepath.protocol.path_files.npz import write_cubes_npz  # noqa: PLC0415

        write_cubes_npz(out, found.path, found.left)
    else:
        from cubepath.protocol.path_files.moves import write_cubes  # noqa: PLC0415

        write_cubes(out, named())


def explained(found: Shortened, certificate: Certificate) -> MoreResults:
    """Return what ``--explain`` adds to an answer."""
    import msgspec  # noqa: PLC0415

    from cubepath.coordinator.shortening.explain import certificate_in_words  # noqa: PLC0415

    return MoreResults(
        {"certificate": msgspec.to_builtins(certificate)},
        lines=("", *certificate_in_words(found.given, certificate)),
    )


def _certified(options: argparse.Namespace, found: Shortened) -> MoreResults:
    """Return what the options add to the answer, which may be nothing; write the certificate.

    InputError if a file cannot be read or written; CheckError if the certificate does not hold,
    which would be a bug in this program.
    """
    durations = given_durations(options)
    if not options.explain and options.certificate is None and durations is None:
        return MoreResults({})
    from cubepath.coordinator.shortening.explain import certified_path, timed_path  # noqa: PLC0415

    with progress_bar(None, "certificate", ""):
        certificate = certified_path(found)
    explanation = explained(found, certificate) if options.explain else MoreResults({})
    document, rows, lines = (
        dict(explanation.document),
        list(explanation.rows),
        list(explanation.lines),
    )
    timed = None
    if durations is not None:
        with progress_bar(None, "timetable", ""):
            timed = timed_path(found.given, certificate, durations)
        document["makespan"] = timed.makespan
        rows.append(("makespan", timed.makespan))
        lines += timed.in_words() if options.explain else []
    if options.certificate is not None:
        from cubepath.protocol.path_files.certificates import write_certificate  # noqa: PLC0415

        with progress_bar(None, "write", ""):
            write_certificate(options.certificate, certificate)
        rows.append(("certificate", options.certificate))
    return MoreResults(document, tuple(rows), tuple(lines), timed)


def _convert(options: argparse.Namespace) -> int:
    from cubepath.coordinator.shortening.conversion import convert  # noqa: PLC0415

    for name in ("explain", "certificate", "durations"):
        if getattr(options, name):
            raise InputError(f"--{name}: not with --convert, which shortens nothing")
    if options.out is None:
        raise InputError("--convert: expected -o FILE with it, a .jsonl or .npz file, or -")
    files.check_files(
        options, [options.input], files.Output(options.out, files.PATH_SUFFIXES, stream=True)
    )
    with progress_bar(None, "convert", " moves") as bar:
        found = convert(
            options.input,
            options.out,
            system=options.system,
            progress=bar.update,
            hints=hints(options),
        )
    document = {"what": found.what, "count": found.count, "output": str(options.out)}
    written = visible(files.file_name(options.out))
    answer(options, document, f"{found.count} {found.what} written to {written}")
    return solved(options, found.unsolved)
