"""The commands on recordings: ``cubepath verify`` and ``cubepath info``."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Collection, Sequence
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
)
from cubepath.coordinator.commands.files import (
    Output,
    check_files,
    file_name,
    input_path,
    opened_once,
    output_path,
)
from cubepath.coordinator.commands.progress import progress_bar
from cubepath.coordinator.commands.usage import AddCommand
from cubepath.coordinator.plugins import plugin
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.formatting import counted, visible
from cubepath.protocol.core.input_files import Source, file_within, readable

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.coordinator.verification.findings import Check, Verification
    from cubepath.protocol.core.system import Scene
    from cubepath.protocol.recordings.recording import Recording
    from cubepath.protocol.recordings.remains import Remains


_Tell: TypeAlias = "Callable[[int], object] | None"
_One: TypeAlias = "Callable[[Path, _Tell], _Told]"
_LOGS_HELP = "a recording, or a folder for the .mcap files in it; - is standard input"


def add_commands(command: AddCommand) -> None:
    """Add the commands and their options."""
    verify = command("verify", _verify)
    verify.add_argument("logs", nargs="+", type=input_path, metavar="LOG", help=_LOGS_HELP)
    verify.add_argument(
        "--rule",
        action="append",
        default=[],
        metavar="FILE.py:NAME",
        help="ask the rule in this file again where a recording names a file of that name",
    )
    verify.add_argument(
        "--require",
        action="append",
        default=[],
        metavar="CHECK",
        help="exit code 1 if this check of a recording was not made, such as choices",
    )
    add_certificate_options(verify)
    add_comparing_options(verify)
    plugin("add_proof_options")(verify)
    verify.add_argument(
        "--recover",
        type=output_path,
        metavar="OUT",
        help="write what can be read as a proper recording; exit code 2 only if there is nothing."
        " With --system the scene, if that is lost",
    )

    info = command("info", _info)
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
        _check_alone(options)
        return compare(options)
    with opened_once(options.logs) as sources:
        if plugin("is_of_a_proof")(options, sources):
            _check_alone(options)
            code: int = plugin("verify_proof")(options, sources[0])
            return code
        if is_of_a_path(options):
            _check_alone(options)
            return verify_certificate(options, sources[0])
        return _verify_recordings(options, sources)


def _check_alone(options: argparse.Namespace) -> None:
    """Refuse the options that are for recordings."""
    if options.rule or options.require:
        option = "--rule" if options.rule else "--require"
        raise InputError(f"{option}: expected recordings alone to verify")


def _verify_recordings(options: argparse.Namespace, sources: Sequence[Source]) -> int:
    from cubepath.agents.rules.registry import check_rule_file  # noqa: PLC0415
    from cubepath.coordinator.auditing.recording import audit, unused_rules  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    check_files(options, options.logs, Output(options.recover))
    for rule in options.rule:
        check_rule_file(rule)
    if options.recover is not None:
        return _recover(options, sources[0])
    known = dict(zip(options.logs, sources, strict=True))
    unused = set(options.rule)

    def one(path: Path, tell: _Tell) -> _Told:
        recording = read_recording(known.get(path, path))
        unused.intersection_update(unused_rules(recording, unused))
        if path in options.logs and len(known) == 1:
            _check_used(options, unused)  # before the work
        return _verified(recording, audit(recording, tell, rules=options.rule), options.require)

    code = _each(options, "verify", one)
    _check_used(options, unused)
    return code


def _check_used(options: argparse.Namespace, unused: Collection[str]) -> None:
    """Refuse a rule that no recording names: most likely it is another that you meant."""
    for rule in options.rule:
        if rule in unused:
            file, _, name = rule.rpartition(":")
            raise InputError(
                f"--rule {rule}: no recording names a rule {name} in a file {Path(file).name},"
                " expected one that is named"
            )


def _recover(options: argparse.Namespace, source: Source) -> int:
    """Verify one recording, and write what can be read of it to another.

    The exit code says whether there is anything of it, since that it is damaged is known.
    """
    from cubepath.coordinator.auditing.recording import audit, unused_rules  # noqa: PLC0415
    from cubepath.coordinator.verification.recovery import (  # noqa: PLC0415
        recover,
        with_told_scene,
    )
    from cubepath.protocol.recordings.description import FREE_FORMAT  # noqa: PLC0415
    from cubepath.protocol.recordings.remains import remains_of  # noqa: PLC0415

    if len(options.logs) > 1:
        raise InputError(f"--recover: found {len(options.logs)} recordings, expected one")
    if options.recover.is_file():
        raise InputError(f"{options.recover}: exists already, expected a new file")
    scene = _scene(options)
    with progress_bar(None, "verify", " rounds") as bar:
        remains = remains_of(source)
        remains = remains if scene is None else with_told_scene(remains, scene)
        recording = remains.recording()
        if recording is not None:
            _check_used(options, unused_rules(recording, options.rule))
        told = (
            _alone(remains)
            if recording is None
            else _verified(
                recording,
                audit(recording, bar.update, rules=options.rule),
                options.require,
            )
        )
    try:
        saved = recover(recording or remains, options.recover)
    finally:
        answer(options, told.document, told.text)
    step = "level" if remains.format == FREE_FORMAT else "whole round"
    known = "" if recording is None else f", {counted(saved.rounds, step)}"
    complain(f"{saved.out}: {counted(saved.messages, 'message')} written{known}")
    for each in told.complaints:
        complain(each)
    if scene is not None and "scene is lost" in " ".join(remains.problems):
        _doubt(told, scene.spec)
    return DONE


def _doubt(told: _Told, system: str) -> None:
    """Say which checks fail with a scene that was told: maybe it is another one."""
    checks = told.document.get("checks", ())
    damage = ("readable", "complete")
    wrong = [each["name"] for each in checks if not each["ok"] and each["name"] not in damage]
    if wrong:
        complain(f"with --system {system} {', '.join(wrong)} fail: is the run of another system?")


def _scene(options: argparse.Namespace) -> Scene | None:
    """Return the scene that was told for a recording that has lost its own."""
    if options.system is None:
        return None
    from cubepath.protocol.scenes.specs import scene_from_spec  # noqa: PLC0415

    return scene_from_spec(options.system)


def _alone(remains: Remains) -> _Told:
    """Return what is to be said of messages whose scene is lost."""
    told = remains.parameters.get("system", "SYSTEM")
    why = f"{remains.path}: its scene is lost, so the messages are recovered alone"
    hint = f"the same with --system {told} makes a recording of them"
    document = {"ok": False, "messages": len(remains.records), "problems": [*remains.problems]}
    text = "\n".join(map(visible, remains.problems))
    return _Told(document, text, complaints=(f"{why}; {hint}",))


def _verified(recording: Recording, found: Verification, required: Sequence[str]) -> _Told:
    width = max(len(check.name) for check in found.checks)
    lines = [
        f"{_mark(check)}  {check.name:<{width}}  {check.detail}".rstrip() for check in found.checks
    ]
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
        lines.append(f"complete: false; {because}, and this is fine as far as it goes")
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
        return _Told(found.document(), text, FAILED, why)
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
    return [(each, _outside(path, each)) for each in found]


def _outside(folder: Path, file: Path) -> InputError | None:
    try:
        file_within(folder, file.name)
    except InputError as error:
        return error
    return None


def _tried(path: Path, one: _One) -> _Told:
    try:
        return one(path, None)
    except CubepathError as error:
        return _unreadable(error)


def _unreadable(error: CubepathError) -> _Told:
    code = BAD_INPUT if isinstance(error, InputError) else FAILED
    return _Told({"unreadable": str(error)}, "", code, (str(error),))


def _info(options: argparse.Namespace) -> int:
    from cubepath.coordinator.runs.contents import info, render  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    def one(path: Path, _tell: _Tell) -> _Told:
        found = info(read_recording(path))
        return _Told(found, render(found))

    check_files(options, options.logs)
    return _each(options, "info", one)
