"""The command ``cubepath replay``: a recording back on zenoh, at full speed or under control."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from cubepath.coordinator.commands.branching import add_branching_options, branch, branches
from cubepath.coordinator.commands.console import DONE, FAILED, answer, complain, table
from cubepath.coordinator.commands.files import input_path
from cubepath.coordinator.commands.keyboard import has_terminal, play_by_keys
from cubepath.coordinator.commands.progress import progress_bar
from cubepath.coordinator.commands.usage import AddCommand, number
from cubepath.protocol.core.errors import InputError

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.coordinator.playback.comparing import ReplayResult
    from cubepath.coordinator.playback.playing import PlayOptions
    from cubepath.protocol.recordings.recording import Recording

_SPOT = "a round or level such as 12, or a time such as 3.5s since the first message"
_rate = number("a number of at least 0.00001 (about a round a day)", lambda rate: rate >= 1e-5)
_seconds = number("0 or more seconds", lambda found: found >= 0)


def add_commands(command: AddCommand) -> None:
    """Add the command and its options."""
    replay = command("replay", _replay)
    replay.add_argument("log", type=input_path, metavar="LOG")
    _add_time(replay)
    _add_choice(replay)
    add_branching_options(replay)
    replay.add_argument(
        "--endpoint", help="where the router listens, as tcp/127.0.0.1:7447 (default: privately)"
    )


def _add_time(replay: argparse.ArgumentParser) -> None:
    replay.add_argument(
        "--rate",
        type=_pace,
        metavar="R",
        help="rounds or levels a second; as 2x (or if log time is the wall clock) times as fast as"
        " it was (default: as fast as it goes)",
    )
    replay.add_argument(
        "--real-time",
        type=_rate,
        nargs="?",
        const=1.0,
        metavar="R",
        help="as fast as it was by the publish times, or R times as fast",
    )
    replay.add_argument(
        "--max-gap",
        type=_seconds,
        metavar="S",
        help="with --real-time or --rate: cut longer gaps between two messages to S seconds",
    )
    replay.add_argument(
        "--from",
        dest="begin",
        type=_spot,
        metavar="WHERE",
        help=f"begin there: {_SPOT}; with --what-if the first round of the rule",
    )
    replay.add_argument(
        "--until", type=_spot, metavar="WHERE", help="end after that round, level or time"
    )
    replay.add_argument("--loop", action="store_true", help="begin again at the end")
    replay.add_argument(
        "--start-paused", action="store_true", help="put nothing before a key or an order comes"
    )
    replay.add_argument(
        "--delay", type=_seconds, default=0.0, metavar="S", help="seconds before the first message"
    )
    replay.add_argument(
        "--wait-for-subscribers",
        action="store_true",
        help="wait until another session subscribes to a part of the run",
    )
    replay.add_argument(
        "--wait-time",
        type=_seconds,
        metavar="S",
        help="wait for one no longer than so many seconds (default 60)",
    )
    replay.add_argument(
        "--no-keyboard", action="store_true", help="read no keys, even if there is a terminal"
    )


def _add_choice(replay: argparse.ArgumentParser) -> None:
    replay.add_argument(
        "--topics",
        action="append",
        default=[],
        metavar="GLOB",
        help="play topics such as 'reports/*' or 'edges', can be given several times (default: what"
        " modules and keepers said)",
    )
    replay.add_argument(
        "--exclude",
        action="append",
        default=[],
        metavar="GLOB",
        help="leave topics out, can be given several times",
    )
    replay.add_argument(
        "--remap",
        action="append",
        default=[],
        metavar="FROM=TO",
        help="put a topic, or all that begin so, on another key, can be given several times",
    )
    replay.add_argument("--run", metavar="ID", help="the run id in the keys (default: a new one)")


def _pace(text: str) -> str:
    """Check a rate, such as 10, 2x or max."""
    from cubepath.coordinator.playback.timeline import read_pace  # noqa: PLC0415

    return _checked(text, read_pace)


def _spot(text: str) -> str:
    from cubepath.coordinator.playback.timeline import read_spot  # noqa: PLC0415

    return _checked(text, read_spot)


def _checked(text: str, read: Callable[[str], object]) -> str:
    try:
        read(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(
            str(error).partition(": ")[2] + f", found {text!r}"
        ) from None
    return text


def _replay(options: argparse.Namespace) -> int:
    if branches(options):
        return branch(options)
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    if options.rate is not None and options.real_time is not None:
        raise InputError("--rate and --real-time: expected one of the two")
    if options.max_gap is not None and options.rate is None and options.real_time is None:
        raise InputError("--max-gap: expected --real-time or --rate with it")
    if options.wait_time is not None and not options.wait_for_subscribers:
        raise InputError("--wait-time: expected --wait-for-subscribers with it")
    with progress_bar(None, "read", ""):
        recording = read_recording(options.log)
    found = _played(options, recording)
    answer(options, found.document(), table(_rows(found)))
    lacking = () if found.lacking is None else (found.lacking,)
    for line in (*recording.problems, *lacking, *found.differences):
        complain(f"{recording.path}: {line}")
    return DONE if found.agrees else FAILED


def _given(options: argparse.Namespace) -> PlayOptions:
    rate = options.rate if options.real_time is None else f"{options.real_time!r}x"
    given: PlayOptions = {
        "rate": rate,
        "begin": options.begin,
        "until": options.until,
        "loop": options.loop,
        "paused": options.start_paused,
        "delay_s": options.delay,
        "max_gap_s": options.max_gap,
        "wait_for_subscribers": options.wait_for_subscribers,
        "topics": options.topics,
        "exclude": options.exclude,
        "remap": options.remap,
        "run": options.run,
        "endpoint": options.endpoint,
    }
    if options.wait_time is not None:
        given["wait_s"] = options.wait_time
    return given


def _played(options: argparse.Namespace, recording: Recording) -> ReplayResult:
    """Play it under the keys of a terminal if it takes time, and else to its end."""
    given = _given(options)
    takes_time = options.loop or options.start_paused or given.get("rate") not in (None, "max")

    def announce(endpoint: str, run: str) -> None:
        if takes_time or any((options.endpoint, options.run, options.wait_for_subscribers)):
            complain(f"replaying on {endpoint} under cubepath/{run}/**")

    if takes_time and not options.no_keyboard and has_terminal():
        from cubepath.coordinator.playback.player import Player  # noqa: PLC0415

        with Player(recording, hold=False, **given) as player:
            announce(player.endpoint, player.run)
            step = "level" if recording.clock == "free" else "round"
            play_by_keys(player, options.begin or "0", step)
            return player.wait()
    from cubepath.coordinator.playback.player import replay  # noqa: PLC0415

    with progress_bar(len(recording.records), "replay", " messages") as bar:
        given["progress"] = bar.update
        return replay(recording, announce=announce, **given)


def _rows(found: ReplayResult) -> list[tuple[str, Any]]:
    rows: list[tuple[str, Any]] = []
    if found.after or found.rounds_compared > found.rounds:
        step = found.steps[:-1]
        rows.append(("gathered", f"from {step} {found.after + 1} on; the numbers are of that part"))
    rows += [
        (found.steps, found.rounds),
        ("moves", found.moves),
        ("reduced moves", found.reduced_moves),
        ("cubes", found.cubes),
        ("largest cube", found.max_cube_dimension),
        ("messages", found.messages),
    ]
    if found.left_out:
        rows.append(
            ("not played", ", ".join(f"{count} {kind}" for kind, count in found.left_out.items()))
        )
    rows += [("time", f"{found.seconds:.2f} s"), ("result", found.result)]
    if found.same and not found.has_end:
        rows.append(("complete", "false; the run was cut off"))
    return rows
