"""`cubepath replay LOG --what-if RULE --from ROUND`, and `cubepath replay LOG --live MODULES`."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Generator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cubepath.coordinator.commands.console import (
    DONE,
    FAILED,
    INTERRUPTED,
    answer,
    complain,
    table,
)
from cubepath.coordinator.commands.files import Output, check_files, file_name, output_path
from cubepath.coordinator.commands.progress import progress_bar
from cubepath.coordinator.commands.usage import module_numbers, number, whole
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted, visible

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.coordinator.runs.live import LiveReplay
    from cubepath.coordinator.runs.outcome import Outcome
    from cubepath.protocol.recordings.recording import Recording

_ALL = "all"
_WHAT_IF = ("modules", "seed", "max_rounds")
_LIVE = ("listen", "connect", "secure", "wait_for")
_BOTH = ("rule", "processes", "patience", "output")
_PLAYER = (
    *("rate", "real_time", "max_gap", "until", "loop", "start_paused", "delay"),
    *("wait_for_subscribers", "wait_time", "topics", "exclude", "remap", "run", "endpoint"),
)
"""Options of the player, which plays a recording as it is."""


def add_branching_options(replay: argparse.ArgumentParser) -> None:
    """Add the options of a run that goes on from a recording, and of live modules."""
    what_if = replay.add_argument_group(
        "what if", "a new run, whose modules choose as on record up to a round"
    )
    what_if.add_argument(
        "--what-if",
        metavar="RULE",
        help="modules follow this rule from the round of --from on, a name or FILE.py:NAME",
    )
    what_if.add_argument(
        "--modules",
        type=module_numbers,
        metavar="0-7,9",
        help="the modules that follow it (default all); the others begin anew with the rule on"
        " record",
    )
    what_if.add_argument(
        "--seed",
        type=whole(0),
        help="seed of all that is random from there on (default: the one on record)",
    )
    what_if.add_argument(
        "--max-rounds",
        type=whole(0),
        metavar="N",
        help="end after N rounds, those on record among them (default: as on record)",
    )
    live = replay.add_argument_group(
        "live modules", "the others as on record, up to the first divergence"
    )
    live.add_argument(
        "--live",
        type=_live,
        metavar="0-7,9",
        help="the modules that are live, or all: real ones, in processes",
    )
    live.add_argument(
        "--listen",
        metavar="ENDPOINT",
        help="let others join with live modules at tcp/HOST:PORT or tls/HOST:PORT",
    )
    live.add_argument(
        "--connect", metavar="ENDPOINT", help="use the router that listens there, and start none"
    )
    live.add_argument(
        "--secure",
        type=Path,
        metavar="DIR",
        help="use TLS with the certificates of a folder; see 'cubepath certificates'",
    )
    live.add_argument(
        "--wait-for",
        type=whole(1),
        metavar="N",
        help="wait until N processes have joined; live modules that they leave follow the rule",
    )
    both = replay.add_argument_group("the new run of either")
    both.add_argument(
        "--processes",
        type=whole(0),
        metavar="N",
        help="processes to spread the modules over; 0 keeps them all here (default 4)",
    )
    both.add_argument(
        "--rule",
        help="the rule of live modules, a name or FILE.py:NAME (default: the one on record); with"
        " --what-if the file of the rule that the other modules follow on record",
    )
    both.add_argument(
        "--patience",
        type=number("a number of seconds above 0 and below 3600", lambda each: 0 < each < 3600),
        metavar="SECONDS",
        help="end if nothing comes of a phase for so long (default 60)",
    )
    both.add_argument(
        "-o",
        "--output",
        type=output_path,
        metavar="RECORDING",
        help="record the run here (default: a new file in logs; of live modules, nowhere)",
    )


def _live(text: str) -> tuple[int, ...] | str:
    return _ALL if text == _ALL else module_numbers(text)


def branches(options: argparse.Namespace) -> bool:
    """Return whether a recording is to be gone on from; InputError for options without it."""
    chosen = [key for key in ("what_if", "live") if getattr(options, key) is not None]
    if len(chosen) == 2:
        raise InputError("--what-if, --live: expected one of them")
    for keys, needed in ((_WHAT_IF, ["what_if"]), (_LIVE, ["live"]), (_BOTH, ["what_if", "live"])):
        for key in keys:
            if getattr(options, key) is not None and not set(chosen) & set(needed):
                named = " or ".join(map(_option, needed))
                raise InputError(f"{_option(key)}: expected {named} beside it")
    if not chosen:
        return False
    for key in _PLAYER if options.what_if is not None else (*_PLAYER, "begin"):
        if getattr(options, key):  # what is not given is None, 0 or empty
            raise InputError(f"{_option(key)}: not with {_option(chosen[0])}")
    if options.what_if is not None:
        _first_round(options)
    return True


def _first_round(options: argparse.Namespace) -> int:
    """Return the first round of the rule; InputError if it is not given, or is none."""
    begin: str | None = options.begin
    if begin is None:
        raise InputError("--what-if: expected also --from, the first round of the rule")
    if not begin.isdecimal() or int(begin) < 1:
        raise InputError(f"--from {begin}: expected a round from 1 on, with --what-if")
    return int(begin)


def _option(key: str) -> str:
    return "--" + {"begin": "from"}.get(key, key).replace("_", "-")


def branch(options: argparse.Namespace) -> int:
    """Go on from a recording."""
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    check_files(options, [options.log], Output(options.output))
    with progress_bar(None, "read", ""):
        recording = read_recording(options.log)
    keys = [*_BOTH, *(_WHAT_IF if options.what_if is not None else _LIVE)]
    given = {key: getattr(options, key) for key in keys if getattr(options, key) is not None}
    if "output" in given:
        given["log"] = given.pop("output")
    try:
        if options.what_if is not None:
            return _what_if(options, recording, given)
        return _play_live(options, recording, given)
    except InputError as error:
        # What is damaged may be why the recording cannot be gone on from.
        raise InputError("; ".join([str(error), *recording.problems])) from None


@contextlib.contextmanager
def _watched() -> Generator[dict[str, Any]]:
    """Show how a run goes on, and give what it is to be watched by."""
    with progress_bar(None, "run", " rounds") as bar:

        def say(line: str) -> None:
            bar.clear()
            complain(line)

        # Without other processes, a rule that prints would print into the answer.
        with contextlib.redirect_stdout(sys.stderr):
            yield {"watch": lambda _: bar.update(1), "say": say}


def _what_if(options: argparse.Namespace, recording: Recording, given: dict[str, Any]) -> int:
    from cubepath.coordinator.runs.continuing import what_if  # noqa: PLC0415

    first = _first_round(options)
    if "rule" in given:
        given["rules"] = [given.pop("rule")]
    with _watched() as watched:
        outcome = what_if(recording, options.what_if, from_round=first, **given, **watched)
    told = recording.parameters
    taken = min(first - 1, outcome.rounds)
    rule = told.get("what_if", told.get("rule"))
    rows: list[tuple[str, object]] = [
        ("system", outcome.system),
        ("parent", f"{file_name(options.log)}, rule {rule}: {taken} of its rounds"),
        ("what if", f"rule {options.what_if} from round {first} on"),
        ("rounds", outcome.rounds),
        ("moves", outcome.moves),
        ("reduced moves", outcome.reduced_moves),
        ("cubes", outcome.cubes),
        ("largest cube", outcome.max_cube_dimension),
        ("goal", "reached" if outcome.goal_reached else "not reached"),
        ("log", outcome.log),
    ]
    document = {
        **outcome.document(),
        "parent": file_name(options.log),
        "from_round": first,
        "what_if": options.what_if,
    }
    answer(options, document, table(rows))
    return _ended(outcome)


def _ended(outcome: Outcome) -> int:
    if outcome.error is not None:
        complain(outcome.error)
    return {"failed": FAILED, "interrupted": INTERRUPTED}.get(outcome.ended, DONE)


def _play_live(options: argparse.Namespace, recording: Recording, given: dict[str, Any]) -> int:
    from cubepath.coordinator.runs.live import replay_live  # noqa: PLC0415

    live = None if options.live == _ALL else options.live
    with _watched() as watched:
        found = replay_live(recording, live, **given, **watched)
    answer(options, found.document(), "\n".join(map(visible, _told(found).splitlines())))
    if found.divergence is not None:
        complain(f"{recording.path}: {str(found.divergence).splitlines()[0]}")
    return DONE if found.same else FAILED


def _told(found: LiveReplay) -> str:
    rounds = f"{found.rounds} of {counted(found.recorded_rounds, 'round')}"
    if found.divergence is None:
        return f"the same for {rounds}"
    return f"the same for {rounds}, then\n{found.divergence}"
