"""The commands on recordings: ``cubepath verify``, ``cubepath replay`` and ``cubepath info``.

Room: coordinator.
"""

from __future__ import annotations

import argparse

from cubepath.coordinator.commands.certificates import (
    add_certificate_options,
    is_of_a_path,
    verify_certificate,
)
from cubepath.coordinator.commands.console import (
    DONE,
    FAILED,
    answer,
    complain,
    progress_bar,
    table,
)
from cubepath.coordinator.commands.files import Output, check_files, input_path, output_path
from cubepath.coordinator.commands.usage import AddCommand, number
from cubepath.protocol.core.errors import InputError


def add_recording_commands(command: AddCommand) -> None:
    """Add the commands and their options."""
    verify = command(
        "verify", _verify, "check a recording, from the start state on; or a certificate"
    )
    verify.add_argument("log", type=input_path, metavar="LOG")
    add_certificate_options(verify)
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
        type=number("a number above 0", lambda rate: rate > 0),
        metavar="R",
        help="rounds a second (default: as fast as it goes)",
    )
    replay.add_argument(
        "--endpoint", help="where the router listens, as tcp/127.0.0.1:7447 (default: a free port)"
    )

    info = command("info", _info, "say what a recording holds")
    info.add_argument("log", type=input_path, metavar="LOG")


def _verify(options: argparse.Namespace) -> int:
    if is_of_a_path(options):
        return verify_certificate(options)
    from cubepath.coordinator.verification.recording import recover, verify  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    check_files(options, [options.log], Output(options.recover))
    if options.recover is not None and options.recover.is_file():
        raise InputError(f"{options.recover}: exists already, expected a new file")
    recording = read_recording(options.log)
    with progress_bar(None, "verify", " rounds") as bar:
        found = verify(recording, bar.update)
    width = max(len(check.name) for check in found.checks)
    lines = [
        f"{'ok    ' if check.ok else 'FAILED'}  {check.name:<{width}}  {check.detail}".rstrip()
        for check in found.checks
    ]
    lines.append(f"{found.rounds} rounds, {found.moves} moves, {found.cubes} cubes")
    saved = None
    try:
        if options.recover is not None:
            saved = recover(recording, options.recover)
    finally:
        answer(options, found.document(), "\n".join(lines))
    if saved is not None:
        complain(f"{saved.out}: {saved.messages} messages written, {saved.rounds} whole rounds")
    if not found.ok:
        wrong = ", ".join(check.name for check in found.checks if not check.ok)
        complain(f"{options.log}: checks failed: {wrong}")
    return DONE if found.ok else FAILED


def _replay(options: argparse.Namespace) -> int:
    from cubepath.coordinator.runs.playback import replay  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

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
    answer(options, found.document(), table(rows))
    for difference in found.differences:
        complain(f"{options.log}: {difference}")
    return DONE if found.same else FAILED


def _info(options: argparse.Namespace) -> int:
    from cubepath.coordinator.runs.contents import info, render  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    found = info(read_recording(options.log))
    answer(options, found, render(found))
    return DONE
