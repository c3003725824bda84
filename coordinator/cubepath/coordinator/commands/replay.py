"""The command ``cubepath replay``: a recording back on zenoh, at full speed or under control.

With ``--modules`` some of its modules are real ones.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from cubepath.coordinator.commands import console, usage
from cubepath.coordinator.commands.files import Output, check_files, input_path, output_path
from cubepath.coordinator.commands.keyboard import has_terminal, play_by_keys
from cubepath.coordinator.commands.run import watched_rounds, with_damage
from cubepath.coordinator.runs.options import RunOptions
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted, visible
from cubepath.protocol.recordings.description import KEYS

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.coordinator.playback.replay_comparison import ReplayResult
    from cubepath.coordinator.runs.live import LiveReplay
    from cubepath.protocol.recordings.recording import Recording

_SPOT = "a round or level such as 12, or a time such as 3.5s since the first message"
_ALL = "all"
_LIVE = ("listen", "connect", "secure", "wait_for", "processes", "rule", "patience", "log")
"""The options of live modules, of which ``--listen`` is for all replays."""
_PLAYER = (
    *("rate", "max_gap_s", "begin", "until", "loop", "paused", "wait_for_subscribers"),
    *("topics", "exclude", "remap", "run"),
)
"""Options of the player, which plays a recording as it is."""
_OF_KEYS = (
    *("log", "run", "endpoint", "messages", "left_out", "seconds", "complete", "problems"),
    "heard",
)
"""What is told of messages on any keys, which have nothing to compare them with."""
_WAIT_S = 60.0
_seconds = usage.number("0 or more seconds", lambda found: found >= 0)


def add_replay(replay: argparse.ArgumentParser) -> None:
    """Add the options of ``replay``."""
    replay.set_defaults(command=_replay)
    replay.add_argument("parent", type=input_path, metavar="LOG")
    replay.add_argument(
        "--rate",
        type=_pace,
        metavar="R",
        help="rounds or levels a second; as 2x (or if log time is the wall clock) times as fast as"
        " it was (default: as fast as possible)",
    )
    replay.add_argument(
        "--from", dest="begin", type=_spot, metavar="WHERE", help=f"begin there: {_SPOT}"
    )
    replay.add_argument(
        "--until", type=_spot, metavar="WHERE", help="end after that round, level or time"
    )
    replay.add_argument("--loop", action="store_true", help="begin again at the end")
    replay.add_argument(
        "--paused", action="store_true", help="start paused until a key or a command"
    )
    usage.add_topics(replay, "what modules and keepers said")
    replay.add_argument(
        "--listen",
        metavar="ENDPOINT",
        help="where the router listens, as tcp/127.0.0.1:7447 (default: privately)",
    )
    replay.add_argument(
        "--modules",
        type=_modules,
        metavar="0-7,9",
        help="let these modules, or all, be real ones in processes, and the others as on record, up"
        " to the first divergence",
    )
    replay.add_argument(
        "--log", type=output_path, help="with --modules: record the new run here (default: nowhere)"
    )
    _add_more(usage.more_options(replay))
    _add_live(replay.add_argument_group("more options, with --modules"))


def _add_more(more: Any) -> None:
    more.add_argument(
        "--max-gap",
        dest="max_gap_s",
        type=_seconds,
        metavar="S",
        help="with --rate: cut longer gaps between two messages to S seconds",
    )
    more.add_argument(
        "--remap",
        action="append",
        default=[],
        metavar="FROM=TO",
        help="put a topic, or all that begin so, on another key, can be given several times",
    )
    more.add_argument("--run", metavar="ID", help="the run id in the keys (default: a new one)")
    usage.add_fields(more, RunOptions, "connect")
    more.add_argument(
        "--wait-for-subscribers",
        type=_seconds,
        nargs="?",
        const=_WAIT_S,
        metavar="S",
        help="wait until another session subscribes to a part of the run, for S seconds at most"
        f" (default {_WAIT_S:g})",
    )


def _add_live(live: Any) -> None:
    live.add_argument("--rule", help="a name or FILE.py:NAME (default: the one on record)")
    usage.add_fields(live, RunOptions, "processes", "secure", "wait_for", "patience")


def _modules(text: str) -> tuple[int, ...] | str:
    return _ALL if text == _ALL else usage.module_numbers(text)


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
    if options.modules is not None:
        return _play_live(options)
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    for key in _LIVE[1:]:
        if key != "connect" and getattr(options, key) is not None:
            raise InputError(f"--{key.replace('_', '-')}: expected --modules with it")
    if options.max_gap_s is not None and options.rate is None:
        raise InputError("--max-gap: expected --rate with it")
    with console.progress_bar(None, "read", ""):
        recording = read_recording(options.parent)
    found = _played(options, recording)
    document, rows = found.document(), _rows(found)
    if recording.of_keys:
        document = {key: document[key] for key in _OF_KEYS}
        rows = [row for row in rows if row[0] in ("messages", "not played", "time")]
    console.answer(options, document, console.table(rows))
    lacking = () if found.lacking is None else (found.lacking,)
    unheard = () if found.heard else ("nobody subscribed to what was put",)
    for line in (*recording.problems, *lacking, *found.differences, *unheard):
        console.complain(f"{recording.path}: {line}")
    return console.DONE if found.agrees else console.FAILED


def _play_live(options: argparse.Namespace) -> int:
    """Let some modules be real ones, until one does something else than in the recording."""
    from cubepath.coordinator.runs.live import replay_live  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    for key in _PLAYER:
        if getattr(options, key):  # what is not given is None, 0 or empty
            option = {"begin": "from", "max_gap_s": "max-gap"}.get(key, key)
            raise InputError(f"--{option.replace('_', '-')}: not with --modules")
    check_files(options, [options.parent], Output(options.log))
    with console.progress_bar(None, "read", ""):
        recording = read_recording(options.parent)
    live = None if options.modules == _ALL else options.modules
    with watched_rounds() as watched:
        try:
            found = replay_live(recording, live, **usage.given(options, _LIVE), **watched)
        except InputError as error:
            raise with_damage(error, recording) from None
    console.answer(
        options, found.document(), "\n".join(map(visible, _live_text(found).splitlines()))
    )
    if found.divergence is not None:
        console.complain(f"{recording.path}: {str(found.divergence).splitlines()[0]}")
    return console.DONE if found.same else console.FAILED


def _live_text(found: LiveReplay) -> str:
    rounds = f"{found.rounds} of {counted(found.recorded_rounds, 'round')}"
    if found.divergence is None:
        return f"the same for {rounds}"
    return f"the same for {rounds}, then\n{found.divergence}"


def _played(options: argparse.Namespace, recording: Recording) -> ReplayResult:
    """Play it under the keys of a terminal if it takes time, and else to its end."""
    asked: Any = {name: getattr(options, name) for name in _PLAYER} | {"endpoint": options.listen}
    asked["connect"] = options.connect
    takes_time = options.loop or options.paused or asked.get("rate") not in (None, "max")

    def announce(endpoint: str, run: str) -> None:
        if takes_time or any(
            (options.listen, options.run, options.wait_for_subscribers is not None)
        ):
            keys = recording.parameters.get(KEYS, "") if recording.of_keys else ""
            console.complain(f"replaying on {endpoint} under {keys or f'cubepath/{run}/**'}")

    if takes_time and has_terminal():
        from cubepath.coordinator.playback.player import Player  # noqa: PLC0415

        with Player(recording, hold=False, **asked) as player:
            announce(player.endpoint, player.run)
            step = "level" if recording.clock == "free" else "round"
            start = options.begin or ("0s" if recording.of_keys else "0")
            play_by_keys(player, start, "" if recording.of_keys else step)
            return player.wait()
    from cubepath.coordinator.playback.player import replay  # noqa: PLC0415

    with console.progress_bar(len(recording.records), "replay", " messages") as bar:
        asked["progress"] = bar.update
        return replay(recording, announce=announce, **asked)


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
