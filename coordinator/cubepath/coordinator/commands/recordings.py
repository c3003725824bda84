"""The commands on recordings: ``cubepath verify``, ``cubepath replay`` and ``cubepath info``.

Room: coordinator.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from cubepath.coordinator.commands.certificates import (
    add_certificate_options,
    is_of_a_path,
    verify_certificate,
)
from cubepath.coordinator.commands.comparing import add_comparing_options, compare, compares
from cubepath.coordinator.commands.console import (
    BAD_INPUT,
    DONE,
    FAILED,
    answer,
    complain,
    say,
    table,
)
from cubepath.coordinator.commands.files import (
    Output,
    check_files,
    file_name,
    input_path,
    output_path,
)
from cubepath.coordinator.commands.progress import progress_bar
from cubepath.coordinator.commands.usage import AddCommand, number
from cubepath.protocol.core.control_characters import visible
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.input_files import readable

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.coordinator.verification.findings import Check, Verification
    from cubepath.protocol.recordings.recording import Recording


_Tell: TypeAlias = "Callable[[int], object] | None"
_One: TypeAlias = "Callable[[Path, _Tell], _Told]"
_LOGS_HELP = "a recording, or a folder for the .mcap files in it; - is standard input"


def add_recording_commands(command: AddCommand) -> None:
    """Add the commands and their options."""
    verify = command(
        "verify", _verify, "check a recording, from the start state on; or a certificate"
    )
    verify.add_argument("logs", nargs="+", type=input_path, metavar="LOG", help=_LOGS_HELP)
    add_certificate_options(verify)
    add_comparing_options(verify)
    verify.add_argument(
        "--recover",
        type=output_path,
        metavar="OUT",
        help="write what can be read as a proper recording",
    )

    replay = command(
        "replay", _replay, "put a recording back on zenoh; gather and shorten it again"
    )
    replay.add_argument("log", type=input_path, metavar="LOG")
    replay.add_argument(
        "--rate",
        type=number(
            "a number of at least 0.00001 (about a round a day)", lambda rate: rate >= 1e-5
        ),
        metavar="R",
        help="rounds or levels a second; or times as fast as it was, if log time is the wall clock"
        " (default: as fast as it goes)",
    )
    replay.add_argument(
        "--endpoint", help="where the router listens, as tcp/127.0.0.1:7447 (default: privately)"
    )

    info = command("info", _info, "show what a recording contains")
    info.add_argument("logs", nargs="+", type=input_path, metavar="LOG", help=_LOGS_HELP)


@dataclass(frozen=True, slots=True)
class _Told:
    """The result for one recording: its answer, the complaints, and the exit code."""

    document: dict[str, Any]
    text: str
    code: int = DONE
    complaints: tuple[str, ...] = ()


def _verify(options: argparse.Namespace) -> int:
    if compares(options):
        return compare(options)
    if is_of_a_path(options):
        return verify_certificate(options)
    from cubepath.coordinator.auditing.recording import audit  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    check_files(options, options.logs, Output(options.recover))
    if options.recover is not None:
        return _recover(options)

    def one(path: Path, tell: _Tell) -> _Told:
        recording = read_recording(path)
        return _verified(recording, audit(recording, tell))

    return _each(options, "verify", one)


def _recover(options: argparse.Namespace) -> int:
    """Verify one recording, and write what can be read of it to another."""
    from cubepath.coordinator.auditing.recording import audit  # noqa: PLC0415
    from cubepath.coordinator.verification.recording import recover  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    if len(options.logs) > 1:
        raise InputError(f"--recover: found {len(options.logs)} recordings, expected one")
    if options.recover.is_file():
        raise InputError(f"{options.recover}: exists already, expected a new file")
    with progress_bar(None, "verify", " rounds") as bar:
        recording = read_recording(options.logs[0])
        told = _verified(recording, audit(recording, bar.update))
    try:
        saved = recover(recording, options.recover)
    finally:
        answer(options, told.document, told.text)
    complain(f"{saved.out}: {saved.messages} messages written, {saved.rounds} whole rounds")
    return _complained(told)


def _verified(recording: Recording, found: Verification) -> _Told:
    width = max(len(check.name) for check in found.checks)
    lines = [
        f"{_mark(check)}  {check.name:<{width}}  {check.detail}".rstrip() for check in found.checks
    ]
    what = "levels" if recording.clock == "free" else "rounds"
    lines.append(f"{found.rounds} {what}, {found.moves} moves, {found.cubes} cubes")
    if any(found.missing):
        rounds, messages = found.missing
        lines.append(f"known to be missing: {rounds} of the rounds begun, {messages} messages")
    if found.ok and not found.complete:
        lines.append("complete: false; the run was cut off, and this is fine as far as it goes")
    text = "\n".join(map(visible, lines))
    if found.ok:
        return _Told(found.document(), text)
    wrong = ", ".join(check.name for check in found.checks if not check.ok)
    why = (f"{recording.path}: checks failed: {wrong}",)
    return _Told(found.document(), text, FAILED, why)


def _mark(check: Check) -> str:
    if not check.ok:
        return "FAILED"
    return "ok    " if check.checked else "-     "


def _complained(told: _Told) -> int:
    for each in told.complaints:
        complain(each)
    return told.code


def _each(
    options: argparse.Namespace,
    what: str,
    one: _One,
) -> int:
    """Answer for each recording that is named; return the worst exit code.

    For one file the answer is its document. For several files, or a folder, it is the list of their
    documents, and a file that cannot be read does not stop the others. Each answer is printed
    before the next file is read, so that memory does not grow with their number.
    """
    paths: list[Path] = options.logs
    if len(paths) == 1 and not os.path.isdir(paths[0]):  # noqa: PTH112 - never raises
        with progress_bar(None, what, " rounds") as bar:
            told = one(paths[0], bar.update)
        answer(options, told.document, told.text)
        return _complained(told)
    worst = DONE
    named = [each for path in paths for each in _named(path)]
    with progress_bar(len(named), what, " files") as bar:
        between = "[" if options.json else ""
        try:
            for path, error in named:
                told = _unreadable(error) if error is not None else _tried(path, one)
                bar.clear()
                if options.json:
                    document = {"log": file_name(path), **told.document}
                    say(f"{between}{json.dumps(document)}", end="")
                    between = ",\n"
                elif told.text:
                    say(f"{between}==> {visible(file_name(path))} <==\n{told.text}")
                    between = "\n"
                worst = max(worst, _complained(told))
                bar.update()
        finally:
            if options.json:
                say("]" if between != "[" else "[]")
    return worst


def _named(path: Path) -> list[tuple[Path, CubepathError | None]]:
    """Return the recordings that a path stands for, or the path with its error."""
    try:
        with readable(path):
            if not path.is_dir():
                return [(path, None)]
            files = (each for each in path.iterdir() if each.suffix == ".mcap")
            found = sorted(each for each in files if each.is_file())
    except InputError as error:
        return [(path, error)]
    if not found:
        return [(path, InputError(f"{path}: a folder without .mcap files, expected recordings"))]
    return [(each, None) for each in found]


def _tried(path: Path, one: _One) -> _Told:
    try:
        return one(path, None)
    except CubepathError as error:
        return _unreadable(error)


def _unreadable(error: CubepathError) -> _Told:
    code = BAD_INPUT if isinstance(error, InputError) else FAILED
    return _Told({"unreadable": str(error)}, "", code, (str(error),))


def _replay(options: argparse.Namespace) -> int:
    from cubepath.coordinator.runs.playback import replay  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    with progress_bar(None, "read", ""):
        recording = read_recording(options.log)

    def announce(endpoint: str, run: str) -> None:
        if options.endpoint is not None:
            complain(f"replaying on {endpoint} under cubepath/{run}/**")

    with progress_bar(len(recording.records), "replay", " messages") as bar:
        found = replay(
            recording,
            rate=options.rate,
            endpoint=options.endpoint,
            announce=announce,
            progress=bar.update,
        )
    rows: list[tuple[str, object]] = [
        ("rounds", found.rounds),
        ("moves", found.moves),
        ("reduced moves", found.reduced_moves),
        ("cubes", found.cubes),
        ("largest cube", found.max_cube_dimension),
        ("messages", found.messages),
        ("time", f"{found.seconds:.2f} s"),
        ("result", found.result),
    ]
    if found.same and not found.complete:
        rows.append(("complete", "false; the run was cut off"))
    answer(options, found.document(), table(rows))
    for difference in found.differences:
        complain(f"{recording.path}: {difference}")
    return DONE if found.same else FAILED


def _info(options: argparse.Namespace) -> int:
    from cubepath.coordinator.runs.contents import info, render  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    def one(path: Path, _tell: _Tell) -> _Told:
        found = info(read_recording(path))
        return _Told(found, render(found))

    check_files(options, options.logs)
    return _each(options, "info", one)
