"""The commands ``cubepath log info`` and ``cubepath log recover``; tools have the others."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from cubepath.coordinator.commands import recordings
from cubepath.coordinator.commands.console import DONE, answer, complain, progress_bar
from cubepath.coordinator.commands.files import Output, add_out, check_files, input_path
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted, visible
from cubepath.protocol.recordings.description import FREE_FORMAT, KEYS_FORMAT

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.protocol.core.system import Scene
    from cubepath.protocol.recordings.recording import Recording


def add_log_info(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``log info``."""
    parser.set_defaults(command=_info)
    parser.add_argument(
        "logs", nargs="+", type=input_path, metavar="LOG", help=recordings.LOGS_HELP
    )


def _info(options: argparse.Namespace) -> int:
    from cubepath.coordinator.runs.contents import info, render  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    def one(path: Path, _tell: recordings.Progress) -> recordings.RecordingAnswer:
        found = info(read_recording(path))
        return recordings.RecordingAnswer(found, render(found))

    check_files(options, options.logs)
    return recordings.answer_each(options, "info", one)


def add_log_recover(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``log recover``."""
    parser.set_defaults(command=_recover)
    parser.add_argument("source", type=input_path, metavar="LOG", help="a damaged recording")
    add_out(
        parser, "OUT", "the new recording; exit code 2 only if nothing can be read", required=True
    )
    parser.add_argument("--system", metavar="SYSTEM", help="the system of the run, if it is lost")
    recordings.add_rule_files(parser, "the recording")


def _recover(options: argparse.Namespace) -> int:
    """Verify one recording, and write what can be read of it to another.

    The exit code says whether there is anything of it, since that it is damaged is known.
    """
    from cubepath.agents.rules.registry import check_rule_file  # noqa: PLC0415
    from cubepath.coordinator.auditing.rule_audit import audit, unused_rules  # noqa: PLC0415
    from cubepath.coordinator.verification.recovery import recover, with_told_scene  # noqa: PLC0415
    from cubepath.protocol.recordings.remains import remains_of  # noqa: PLC0415

    check_files(options, [options.source], Output(options.out))
    for rule in options.rule:
        check_rule_file(rule)
    if options.out.is_file():
        raise InputError(f"{options.out}: exists already, expected a new file")
    scene = _scene(options)
    with progress_bar(None, "verify", " rounds") as bar:
        remains = remains_of(options.source)
        remains = remains if scene is None else with_told_scene(remains, scene)
        of_run = remains.stored_scene is not None
        if of_run:
            recordings.check_used(options.rule, unused_rules(remains, options.rule))
        reply = (
            recordings.verified(remains, audit(remains, bar.update, rules=options.rule))
            if of_run
            else _alone(remains)
        )
    try:
        saved = recover(remains, options.out)
    finally:
        answer(options, reply.document, reply.text)
    step = "level" if remains.format == FREE_FORMAT else "whole round"
    known = f", {counted(saved.rounds, step)}" if of_run else ""
    complain(f"{saved.out}: {counted(saved.messages, 'message')} written{known}")
    for each in reply.complaints:
        complain(each)
    if scene is not None and "scene is lost" in " ".join(remains.problems):
        _doubt(reply, scene.spec)
    return DONE


def _doubt(reply: recordings.RecordingAnswer, system: str) -> None:
    """Say which checks fail with a scene that you supplied: maybe it is another one."""
    checks = reply.document.get("checks", ())
    damage = ("readable", "complete")
    wrong = [each["name"] for each in checks if not each["ok"] and each["name"] not in damage]
    if wrong:
        complain(f"with --system {system} {', '.join(wrong)} fail: is the run of another system?")


def _scene(options: argparse.Namespace) -> Scene | None:
    """Return the scene that you supplied for a recording that has lost its scene."""
    if options.system is None:
        return None
    from cubepath.protocol.scenes.specs import scene_from_spec  # noqa: PLC0415

    return scene_from_spec(options.system)


def _alone(remains: Recording) -> recordings.RecordingAnswer:
    """Return what to report about messages on any keys, or about those whose scene is lost."""
    document = {
        "ok": not remains.problems,
        "messages": len(remains.records),
        "problems": [*remains.problems],
    }
    text = "\n".join(map(visible, remains.problems))
    if remains.format == KEYS_FORMAT:
        return recordings.RecordingAnswer(document, text)
    system = remains.parameters.get("system", "SYSTEM")
    why = f"{remains.path}: its scene is lost, so the messages are recovered alone"
    hint = f"the same with --system {system} makes a recording of them"
    return recordings.RecordingAnswer(document, text, complaints=(f"{why}; {hint}",))
