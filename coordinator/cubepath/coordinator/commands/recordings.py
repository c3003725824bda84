"""The recordings that a command verifies or shows: answers and exit codes for one or several."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from cubepath.coordinator.commands import console
from cubepath.coordinator.commands.files import file_name
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.formatting import counted, visible
from cubepath.protocol.core.input_files import file_within, readable

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.coordinator.verification.findings import Check, Verification
    from cubepath.protocol.recordings.recording import Recording

Progress: TypeAlias = "Callable[[int], object] | None"
LOGS_HELP = "a recording, or a folder for the .mcap files in it; - is standard input"


def add_rule_files(parser: argparse.ArgumentParser, where: str) -> None:
    """Add ``--rule``, the files of rules that are asked again."""
    parser.add_argument(
        "--rule",
        action="append",
        default=[],
        metavar="FILE.py:NAME",
        help=f"ask the rule in this file again where {where} names a file of that name",
    )


@dataclass(frozen=True, slots=True)
class RecordingAnswer:
    """The result for one recording: its answer, the complaints, and the exit code."""

    document: dict[str, Any]
    text: str
    code: int = console.DONE
    complaints: tuple[str, ...] = ()


def _complained(reply: RecordingAnswer) -> int:
    for each in reply.complaints:
        console.complain(each)
    return reply.code


def answer_each(
    options: argparse.Namespace, what: str, one: Callable[[Path, Progress], RecordingAnswer]
) -> int:
    """Answer for each recording that is named; return the worst exit code.

    For one file the answer is its document. For several files, or a folder, it is the list of their
    documents, and a file that cannot be read does not stop the others. Each answer is printed
    before the next file is read, so that memory does not grow with their number.
    """
    paths: list[Path] = options.logs
    if len(paths) == 1 and not os.path.isdir(paths[0]):  # noqa: PTH112 - never raises
        with console.progress_bar(None, what, " rounds") as bar:
            reply = one(paths[0], bar.update)
        console.answer(options, reply.document, reply.text)
        return _complained(reply)
    worst = console.DONE
    named = [each for path in paths for each in _named(path)]
    with console.progress_bar(len(named), what, " files") as bar:
        between = "[" if options.json else ""
        try:
            for path, error in named:
                reply = _unreadable(error) if error is not None else _tried(path, one)
                bar.clear()
                if options.json:
                    document = {"log": file_name(path), **reply.document}
                    console.say(f"{between}{json.dumps(document)}", end="")
                    between = ",\n"
                elif reply.text:
                    console.say(f"{between}==> {visible(file_name(path))} <==\n{reply.text}")
                    between = "\n"
                worst = max(worst, _complained(reply))
                bar.update()
        finally:
            if options.json:
                console.say("]" if between != "[" else "[]")
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
    return [(each, _outside(path, each)) for each in found]


def _outside(folder: Path, file: Path) -> InputError | None:
    try:
        file_within(folder, file.name)
    except InputError as error:
        return error
    return None


def _tried(path: Path, one: Callable[[Path, Progress], RecordingAnswer]) -> RecordingAnswer:
    try:
        return one(path, None)
    except CubepathError as error:
        return _unreadable(error)


def _unreadable(error: CubepathError) -> RecordingAnswer:
    code = console.BAD_INPUT if isinstance(error, InputError) else console.FAILED
    return RecordingAnswer({"unreadable": str(error)}, "", code, (str(error),))


def verified(
    recording: Recording, found: Verification, required: Sequence[str] = ()
) -> RecordingAnswer:
    """Return the answer on a recording that was verified; `required` names checks to be made."""
    lines = check_lines((_mark(check), check.name, check.detail) for check in found.checks)
    what = "level" if recording.clock == "free" else "round"
    counts = (found.rounds, what), (found.moves, "move"), (found.cubes, "cube")
    lines.append(", ".join(counted(*each) for each in counts))
    if any(found.missing):
        rounds, messages = found.missing
        lines.append(
            f"known to be missing: {rounds} of the rounds begun, {counted(messages, 'message')}"
        )
    if found.ok and not found.complete:
        from cubepath.coordinator.verification.partial import why_partial  # noqa: PLC0415

        cut = "messages are missing" if found.missing.messages else "the run was cut off"
        because = why_partial(recording) or cut
        lines.append(f"complete: false; {because}, and this part is fine")
    lines += [
        f"choices {check.detail}"
        for check in found.checks
        if check.name == "choices" and check.ok and not check.checked
    ]
    text = "\n".join(map(visible, lines))
    made = {check.name: check.checked for check in found.checks}
    for name in required:
        if name not in made:
            expected = ", ".join(made)
            raise InputError(f"--require {name}: no such check, expected one of {expected}")
    missing = [name for name in required if not made[name]]
    if found.ok and missing:
        why = (f"{recording.path}: checks required and not made: {', '.join(missing)}",)
        return RecordingAnswer(found.document(), text, console.FAILED, why)
    if found.ok:
        return RecordingAnswer(found.document(), text)
    wrong = ", ".join(check.name for check in found.checks if not check.ok)
    why = (f"{recording.path}: checks failed: {wrong}",)
    return RecordingAnswer(found.document(), text, console.FAILED, why)


def _mark(check: Check) -> str:
    if not check.ok:
        return "FAILED"
    return "ok" if check.checked else "-"


def check_lines(checks: Iterable[tuple[str, str, str]]) -> list[str]:
    """Return a line for each check: how it came out, its name, and why."""
    rows = list(checks)
    width = max(len(name) for _, name, _ in rows)
    return [f"{mark:<6}  {name:<{width}}  {why}".rstrip() for mark, name, why in rows]


def check_used(rules: Sequence[str], unused: Collection[str]) -> None:
    """Refuse a rule that no recording names: most likely it is another that you meant."""
    for rule in rules:
        if rule in unused:
            from cubepath.agents.rules.rule import RuleName  # noqa: PLC0415 - loads numpy

            file, name, _ = RuleName.of(rule)
            raise InputError(
                f"--rule {rule}: no recording names a rule {name} in a file {Path(file).name},"
                " expected one that is named"
            )
