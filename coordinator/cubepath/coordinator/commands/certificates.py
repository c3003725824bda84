"""Certificates and timetables of ``cubepath shorten``, and how ``cubepath verify`` checks them."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cubepath.coordinator.commands.console import DONE, FAILED, answer, complain
from cubepath.coordinator.commands.durations import add_duration_options, given_durations
from cubepath.coordinator.commands.files import (
    PATH_SUFFIXES,
    Output,
    check_files,
    file_name,
    input_path,
    output_path,
)
from cubepath.coordinator.commands.plan_options import add_plan_options, hints
from cubepath.coordinator.commands.progress import progress_bar
from cubepath.coordinator.plugins import plugin
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted, visible
from cubepath.protocol.core.input_files import InputFile, Source, file_within, opened
from cubepath.protocol.file_forms import FORMS

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.coordinator.shortening.explain import TimedPath
    from cubepath.coordinator.shortening.normal_path import Shortened
    from cubepath.protocol.path_files.certificates import Certificate
    from cubepath.protocol.path_files.moves import CubeName


def add_explain_options(shorten: argparse.ArgumentParser) -> None:
    """Add ``--explain``, ``--certificate``, ``--durations`` and ``--duration``."""
    shorten.add_argument(
        "--explain",
        action="store_true",
        help="say which chain of moves proves that no schedule in the class is shorter",
    )
    shorten.add_argument(
        "--certificate",
        type=output_path,
        metavar="FILE.json",
        help="write the proof, for 'cubepath verify FILE.json --of INPUT'",
    )
    add_duration_options(shorten)


def add_certificate_options(verify: argparse.ArgumentParser) -> None:
    """Add ``--of``, ``--system`` and ``--cubes``."""
    verify.add_argument(
        "--of",
        type=input_path,
        metavar="INPUT",
        help="LOG is a certificate, or a cubes file with one beside it, of the path in INPUT",
    )
    verify.add_argument(
        "--system",
        metavar="SYSTEM",
        help="with --of: the system that the moves of INPUT name; with --recover: that of the run",
    )
    verify.add_argument(
        "--cubes",
        type=input_path,
        metavar="CUBES.jsonl",
        help="with --of: a cubes file that must be the schedule of the certificate",
    )
    add_plan_options(verify)


@dataclass(frozen=True, slots=True)
class Explained:
    """The results of the options: keys for ``--json``, rows and lines for people, a timetable."""

    document: dict[str, Any]
    rows: tuple[tuple[str, object], ...] = ()
    lines: tuple[str, ...] = ()
    timed: TimedPath | None = None


def explain(options: argparse.Namespace, found: Shortened) -> Explained:
    """Do what the options ask for, which may be nothing; write the certificate if they ask for it.

    InputError if a file cannot be read or written; CheckError if the certificate does not hold,
    which would be a bug in this program.
    """
    durations = given_durations(options)
    if not options.explain and options.certificate is None and durations is None:
        return Explained({})
    from cubepath.coordinator.shortening.explain import (  # noqa: PLC0415
        certificate_in_words,
        certified_path,
        timed_path,
    )
    from cubepath.protocol.path_files.certificates import write_certificate  # noqa: PLC0415

    with progress_bar(None, "certificate", ""):
        certificate = certified_path(found)
    document: dict[str, Any] = {}
    rows: list[tuple[str, object]] = []
    lines: list[str] = []
    if options.explain:
        document["certificate"] = _document(certificate)
        lines += ["", *certificate_in_words(found.given, certificate)]
    timed = None
    if durations is not None:
        with progress_bar(None, "timetable", ""):
            timed = timed_path(found.given, certificate, durations)
        document["makespan"] = timed.makespan
        rows.append(("makespan", timed.makespan))
        lines += timed.in_words() if options.explain else []
    if options.certificate is not None:
        with progress_bar(None, "write", ""):
            write_certificate(options.certificate, certificate)
        rows.append(("certificate", options.certificate))
    return Explained(document, tuple(rows), tuple(lines), timed)


def write_schedule(output: Path, found: Shortened, known: Any, told: Explained) -> None:
    """Write what ``-o`` asks for: cubes, as lines or arrays, or a timetable."""
    from cubepath.protocol.path_files.moves import write_cubes  # noqa: PLC0415

    if told.timed is not None:
        from cubepath.protocol.path_files.schedules import write_timetable  # noqa: PLC0415

        write_timetable(output, told.timed.lines())
    elif output.suffix.lower() == ".npz":
        from cubepath.protocol.path_files.npz import write_cubes_npz  # noqa: PLC0415

        write_cubes_npz(output, found.path, found.left)
    else:
        write_cubes(output, found.named if known is None else known.named)


def _document(certificate: Certificate) -> Any:
    import msgspec  # noqa: PLC0415

    return msgspec.to_builtins(certificate)


def check_explain_options(options: argparse.Namespace) -> None:
    """Check that the options fit together; InputError if they do not."""
    timed = options.durations is not None or bool(options.duration)
    given = "--certificate" if options.certificate is not None else "--duration"
    beyond: str | None = plugin("improving")(options)
    if beyond is not None and (options.certificate is not None or timed):
        raise InputError(
            f"{given} is for the homotopy class of the input, which {beyond} may leave:"
            " expected one of the two"
        )
    output: Path | None = options.output
    if timed and output is not None and output.suffix.lower() == ".npz":
        raise InputError(f"{output}: a timetable is JSON Lines, expected another name")
    check_files(
        options,
        [options.input, options.durations],
        Output(output, PATH_SUFFIXES, stream=True),
        Output(options.certificate, (".json",)),
        Output(options.proof, (".proof",)),
    )


def is_of_a_path(options: argparse.Namespace) -> bool:
    """Return whether a certificate is to be verified; InputError if --of is missing."""
    if options.of is not None:
        return True
    for log in options.logs:
        if log.suffix in {".json", ".jsonl"}:
            raise InputError(f"{log}: is checked against its input, expected --of INPUT")
    alone = options.system if options.recover is None else None  # it tells a scene that is lost
    if alone or options.cubes or options.format or options.companions:
        raise InputError("--system, --cubes, --format and --with are for --of INPUT, expected that")
    return False


def verify_certificate(options: argparse.Namespace, given: Source) -> int:
    """Check a file against its path, as ``cubepath verify LOG --of INPUT`` does.

    It is a certificate, a cubes file beside one, or a timetable of vehicles that follow; `given` is
    what to read for it.
    """
    if options.recover is not None:
        raise InputError("--recover is for recordings, expected no --of")
    if len(options.logs) > 1:
        raise InputError(f"--of: found {len(options.logs)} files to check, expected one")
    source: Path = options.logs[0]
    cubes_file: Path | None = options.cubes
    if source.suffix == ".jsonl" and cubes_file is not None:
        raise InputError(f"{source}: a schedule already, expected no --cubes beside it")
    check_files(options, [source, options.of, cubes_file])
    with opened(given) as file:
        if FORMS["following timetable"].holds(file):
            code: int = plugin("verify_following")(options, file)
            return code
        return _verify_certificate(options, file, source, cubes_file)


def _verify_certificate(
    options: argparse.Namespace, file: InputFile, source: Path, cubes_file: Path | None
) -> int:
    from cubepath.coordinator.shortening.path_input import read_input  # noqa: PLC0415
    from cubepath.coordinator.verification.certificate import (  # noqa: PLC0415
        check_numbered,
        compare_cubes,
    )
    from cubepath.protocol.path_files.certificates import (  # noqa: PLC0415
        companion,
        read_certificate,
    )

    proof: Source = file
    cubes: Source | None = cubes_file
    if source.suffix == ".jsonl":
        cubes, source = file, file_within(source.parent, companion(source).name)
        proof = source
    with progress_bar(None, "verify", " moves") as bar:
        certificate = read_certificate(proof)
        path = read_input(options.of, options.system, hints(options), bar.update)
        found = check_numbered(certificate, path.numbered, path.start)
        if cubes is not None:
            read = _cubes(cubes)
            if found["form"] is None:
                found["cubes"] = compare_cubes(certificate, path.numbered, read)
    left = certificate.moves - 2 * len(certificate.cancelled)
    document = {
        "ok": not any(found.values()),
        "checks": [
            {"name": name, "ok": why is None, "detail": why or ""} for name, why in found.items()
        ],
        "moves": len(path.numbered.numbers),
        "reduced_moves": left,
        "cubes": len(certificate.cubes),
    }
    width = max(map(len, found))
    lines = [
        f"{'ok    ' if why is None else 'FAILED'}  {name:<{width}}  {why or ''}".rstrip()
        for name, why in found.items()
    ]
    wrong = [name for name, why in found.items() if why is not None]
    cubes_told = counted(len(certificate.cubes), "cube")
    if not wrong:
        lines.append(
            f"proved: in the class of {file_name(options.of)},"
            f" and none in it has fewer than {cubes_told}"
        )
    answer(options, document, "\n".join(map(visible, lines)))
    if wrong:
        complain(f"{file_name(source)}: checks failed: {', '.join(wrong)}")
    return FAILED if wrong else DONE


def _cubes(path: Source) -> Sequence[tuple[CubeName, ...]]:
    from cubepath.protocol.path_files.moves import read_cubes  # noqa: PLC0415

    return list(read_cubes(path))
