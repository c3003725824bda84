"""The command ``cubepath verify``: recordings, certificates and timetables; proofs by a plug-in."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cubepath.coordinator.commands.console import DONE, FAILED, answer, complain, progress_bar
from cubepath.coordinator.commands.files import check_files, file_name, input_path, opened_once
from cubepath.coordinator.commands.path_options import add_plan_options, hints
from cubepath.coordinator.commands.recordings import (
    LOGS_HELP,
    Progress,
    RecordingAnswer,
    add_rule_files,
    answer_each,
    check_lines,
    check_used,
    verified,
)
from cubepath.coordinator.plugins import plugin
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted, visible
from cubepath.protocol.core.input_files import InputFile, Source, file_within, opened

if TYPE_CHECKING:  # a command starts faster without it
    from cubepath.protocol.path_files.moves import CubeName


def add_verify(verify: argparse.ArgumentParser) -> None:
    """Add the options of ``verify``."""
    verify.set_defaults(command=_verify)
    verify.add_argument("logs", nargs="+", type=input_path, metavar="LOG", help=LOGS_HELP)
    add_rule_files(verify, "a recording")
    verify.add_argument(
        "--require",
        action="append",
        default=[],
        metavar="CHECK",
        help="exit code 1 if this check of a recording was not made, such as choices",
    )
    verify.add_argument(
        "--of",
        type=input_path,
        metavar="INPUT",
        help="LOG is a certificate, or a cubes file next to one, of the path in INPUT",
    )
    verify.add_argument(
        "--system", metavar="SYSTEM", help="with --of: the system that the moves of INPUT name"
    )
    verify.add_argument(
        "--cubes",
        type=input_path,
        metavar="CUBES.jsonl",
        help="with --of: a cubes file that must be the schedule of the certificate",
    )
    add_plan_options(verify)
    plugin("add_proof_options")(verify)


def _verify(options: argparse.Namespace) -> int:
    with opened_once(options.logs) as sources:
        if plugin("is_of_a_proof")(options, sources):
            _check_alone(options)
            code: int = plugin("verify_proof")(options, sources[0])
            return code
        if _is_of_a_path(options):
            _check_alone(options)
            return _verify_of_a_path(options, sources[0])
        return _verify_recordings(options, sources)


def _check_alone(options: argparse.Namespace) -> None:
    """Refuse the options that are for recordings."""
    if options.rule or options.require:
        option = "--rule" if options.rule else "--require"
        raise InputError(f"{option}: expected recordings alone to verify")


def _verify_recordings(options: argparse.Namespace, sources: Sequence[Source]) -> int:
    from cubepath.agents.rules.registry import check_rule_file  # noqa: PLC0415
    from cubepath.coordinator.auditing.rule_audit import audit, unused_rules  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    check_files(options, options.logs)
    for rule in options.rule:
        check_rule_file(rule)
    known = dict(zip(options.logs, sources, strict=True))
    unused = set(options.rule)

    def one(path: Path, tell: Progress) -> RecordingAnswer:
        recording = read_recording(known.get(path, path))
        unused.intersection_update(unused_rules(recording, unused))
        if path in options.logs and len(known) == 1:
            check_used(options.rule, unused)  # before the work
        return verified(recording, audit(recording, tell, rules=options.rule), options.require)

    code = answer_each(options, "verify", one)
    check_used(options.rule, unused)
    return code


def _is_of_a_path(options: argparse.Namespace) -> bool:
    """Return whether a certificate is to be verified; InputError if --of is missing."""
    if options.of is not None:
        return True
    for log in options.logs:
        if log.suffix in {".json", ".jsonl"}:
            raise InputError(f"{log}: is checked against its input, expected --of INPUT")
    if options.system or options.cubes or options.format or options.companions:
        raise InputError("--system, --cubes, --format and --with are for --of INPUT, expected that")
    return False


def _verify_of_a_path(options: argparse.Namespace, given: Source) -> int:
    """Check a file against its path, as ``cubepath verify LOG --of INPUT`` does.

    It is a certificate, a cubes file beside one, or a timetable of vehicles that follow; `given` is
    what to read for it.
    """
    from cubepath.protocol.file_forms import FORMS  # noqa: PLC0415

    if len(options.logs) > 1:
        raise InputError(f"--of: found {len(options.logs)} files to check, expected one")
    source: Path = options.logs[0]
    cubes_file: Path | None = options.cubes
    if source.suffix == ".jsonl" and cubes_file is not None:
        raise InputError(f"{source}: a schedule already, expected no --cubes")
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
    from cubepath.coordinator.verification.certificate import check_certificate, compare_cubes  # noqa: PLC0415
    from cubepath.protocol.path_files.certificates import companion, read_certificate  # noqa: PLC0415

    proof: Source = file
    cubes: Source | None = cubes_file
    if source.suffix == ".jsonl":
        cubes, source = file, file_within(source.parent, companion(source).name)
        proof = source
        if not source.exists():
            raise InputError(
                f"{source}: no certificate next to the cubes file, expected that of"
                " 'shorten --certificate'; for what 'improve' writes, its --proof"
            )
    with progress_bar(None, "verify", " moves") as bar:
        certificate = read_certificate(proof)
        path = read_input(options.of, options.system, hints(options), bar.update)
        found = check_certificate(certificate, path.actions, path.start)
        if cubes is not None:
            read = _cubes(cubes)
            if found["form"] is None:
                found["cubes"] = compare_cubes(certificate, path.numbered, read)
    return answer_checks(
        options,
        file_name(source),
        found,
        {
            "moves": len(path.numbered.numbers),
            "reduced_moves": certificate.moves - 2 * len(certificate.cancelled),
            "cubes": len(certificate.cubes),
        },
        f"proved: in the class of {file_name(options.of)}, and none in it has fewer than"
        f" {counted(len(certificate.cubes), 'cube')}",
    )


def answer_checks(
    options: argparse.Namespace,
    name: str,
    found: Mapping[str, str | None],
    more: dict[str, Any],
    proved: str,
) -> int:
    """Answer with the checks of a file, by name with why each fails; return the exit code."""
    wrong = [check for check, why in found.items() if why is not None]
    document = {
        "ok": not wrong,
        "checks": [
            {"name": check, "ok": why is None, "detail": why or ""} for check, why in found.items()
        ],
    }
    lines = check_lines(
        ("ok" if why is None else "FAILED", check, why or "") for check, why in found.items()
    )
    lines += [] if wrong else [proved]
    answer(options, document | more, "\n".join(map(visible, lines)))
    if wrong:
        complain(f"{name}: checks failed: {', '.join(wrong)}")
    return FAILED if wrong else DONE


def _cubes(path: Source) -> Sequence[tuple[CubeName, ...]]:
    from cubepath.protocol.path_files.moves import read_cubes  # noqa: PLC0415

    return list(read_cubes(path))
