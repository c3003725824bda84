"""The command ``cubepath run``: a new run, or one that continues from a recording."""

import argparse
import contextlib
import sys
from collections.abc import Generator
from typing import Any

from cubepath.coordinator.commands import console, usage
from cubepath.coordinator.commands.files import (
    Output,
    check_files,
    file_name,
    input_path,
    output_path,
)
from cubepath.coordinator.plugins import plugin
from cubepath.coordinator.progress import showing_run
from cubepath.coordinator.runs.options import RunOptions
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.core.options import option_fields
from cubepath.protocol.core.output_files import STANDARD_OUTPUT

_CONTINUED = ("modules", "seed", "max_rounds", "processes", "patience", "log")
"""The options of a run that continues from a round, apart from its rules."""
_PLAN = ("system", "speeds", *(name for name in option_fields(RunOptions) if name != "resume"))
"""The options that are fields of a plan, apart from its rule."""


def add_run(run: argparse.ArgumentParser) -> None:
    """Add the options of ``run``."""
    run.set_defaults(command=_run)
    run.add_argument("system", nargs="?", metavar="SYSTEM", help=console.SYSTEM_HELP)
    run.add_argument(
        "--rule",
        dest="rules",
        action="append",
        metavar="RULE",
        help="rule of the modules, a name or FILE.py:NAME (default: the one that reaches the goal);"
        " with --round given again for each file of a rule on record",
    )
    files = {"schedule": input_path, "log": output_path}
    names = ("seed", "clock", "processes", "max_rounds", "schedule", "log")
    usage.add_fields(run, RunOptions, *names, types=files)
    run.add_argument(
        "--from",
        dest="parent",
        type=input_path,
        metavar="LOG",
        help="continue from a recording: in rounds from --round on, with another --rule; without"
        " rounds a run that was cut off or failed, where its keepers' logs end",
    )
    run.add_argument(
        "--round",
        type=usage.whole(1),
        metavar="N",
        help="with --from: the first round of the rule; before it modules choose as on record",
    )
    more = usage.more_options(run)
    plugin("add_live_options")(run, more)
    _add_more(more)


def _add_more(more: Any) -> None:
    more.add_argument(
        "--modules",
        type=usage.module_numbers,
        metavar="0-7,9",
        help="with --round: the modules that follow the rule (default all); the others begin anew"
        " with the rule on record",
    )
    usage.add_fields(more, RunOptions, "repair", "hesitate", "keepers")
    more.add_argument(
        "--speed",
        type=_speed,
        dest="speeds",
        action="append",
        metavar="MODULE=F",
        help="with the free clock: delay each action of MODULE by F * 10 ms (default: none)",
    )
    usage.add_fields(more, RunOptions, "jitter", "on_crash", "log_time")
    usage.add_fields(more, RunOptions, "listen", "connect", "secure", "wait_for", "patience")


def _speed(text: str) -> tuple[int, float]:
    module, found, factor = text.partition("=")
    with contextlib.suppress(ValueError):
        if found and module.isascii() and module.isdigit():
            return int(module), float(factor)
    raise argparse.ArgumentTypeError(f"expected MODULE=FACTOR as 3=100, found {text!r}")


def _run(options: argparse.Namespace) -> int:
    if options.round is not None or options.modules is not None:
        return _continue(options)
    from cubepath.coordinator.runs.plan import Plan  # noqa: PLC0415 - only what a command needs
    from cubepath.coordinator.runs.run import Run  # noqa: PLC0415

    check_files(options, [options.schedule, options.parent])
    _check_log(options)
    rule, *others = options.rules or [None]
    if others:
        raise InputError(f"--rule: found {len(options.rules)} rules, expected one without --round")
    fields = usage.given(options, _PLAN)
    if "speeds" in fields:
        fields["speeds"] = dict(fields["speeds"])
    plan = Plan(rule=rule, resume=options.parent, **fields)
    free = options.clock == "free" or options.parent is not None
    with console.progress_bar(None, "run", " moves" if free else " rounds") as bar:

        def say(line: str) -> None:
            bar.clear()
            console.complain(line)

        # Without other processes, a rule that prints would print into the answer.
        with contextlib.redirect_stdout(sys.stderr):
            running = Run(plan, watch=showing_run(bar, free=free), say=say)
            if options.parent is None and not running.scene.can_begin():
                say(f"{running.scene.spec}: no module can move at the start")
            with plugin("watched")(options, running, say):
                outcome = running.play_from_the_start()
    console.answer(options, outcome.document(), console.table(outcome_rows(outcome)))
    return _ended(outcome)


def outcome_rows(outcome: Any) -> list[tuple[str, object]]:
    """Return what is printed of the outcome of a run: names and values."""
    free = outcome.keepers is not None
    rows: list[tuple[str, object]] = [
        ("system", f"{outcome.system}, rule {outcome.rule}, seed {outcome.seed}"),
        ("modules", f"{outcome.modules} in {outcome.processes or 'no other'} processes"),
        *([("keepers", outcome.keepers)] if free else []),
        ("levels" if free else "rounds", outcome.rounds),
        *_counts(outcome),
        ("time", f"{outcome.seconds:.2f} s"),
        ("messages", outcome.messages),
        *([("refused", outcome.refused)] if outcome.refused else []),
        *(
            [("held back", f"{outcome.held_back_seconds:.1f} s, for the record to keep up")]
            if outcome.held_back_seconds
            else []
        ),
        *(("died", f"{crash.name}: {crash.how}") for crash in outcome.crashes),
        ("log", outcome.log),
    ]
    if outcome.schedule_cubes is not None:
        stopped = outcome.schedule_stopped
        how = "" if stopped is None else f", stopped at round {stopped.round}: {stopped.reason}"
        rows.insert(1, ("schedule", f"{counted(outcome.schedule_cubes, 'cube')}{how}"))
    return rows


def _check_log(options: argparse.Namespace) -> None:
    if options.log == STANDARD_OUTPUT:
        raise InputError("standard output: has the answer, expected a file for the recording")


def _counts(outcome: Any) -> list[tuple[str, object]]:
    return [
        ("moves", outcome.moves),
        ("reduced moves", outcome.reduced_moves),
        ("cubes", outcome.cubes),
        ("largest cube", outcome.max_cube_dimension),
        ("goal", "reached" if outcome.goal_reached else "not reached"),
    ]


def _ended(outcome: Any) -> int:
    if outcome.error is not None:
        console.complain(outcome.error)
    return {"failed": console.FAILED, "interrupted": console.INTERRUPTED}.get(
        outcome.ended, console.DONE
    )


def _continue(options: argparse.Namespace) -> int:
    """Go on from a round of a recording with another rule."""
    from cubepath.coordinator.runs.continuing import what_if  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    option = "--modules" if options.round is None else "--round"
    if options.parent is None:
        raise InputError(f"{option}: expected --from LOG with it")
    if options.round is None:
        raise InputError(f"{option}: expected --round with it, the first round of the rule")
    if not options.rules:
        raise InputError("--round: expected --rule with it, the rule from there on")
    for key in (*_PLAN, "live", "paused", "rate"):
        value = getattr(options, key)
        if key not in _CONTINUED and value is not None and value is not False:
            name = {"system": "SYSTEM", "speeds": "--speed"}.get(key)
            raise InputError(f"{name or '--' + key.replace('_', '-')}: not with --round")
    check_files(options, [options.parent], Output(options.log))
    with console.progress_bar(None, "read", ""):
        recording = read_recording(options.parent)
    rule, *others = options.rules
    with watched_rounds() as watched:
        try:
            outcome = what_if(
                recording,
                rule,
                from_round=options.round,
                rules=others,
                **usage.given(options, _CONTINUED),
                **watched,
            )
        except InputError as error:
            raise with_damage(error, recording) from None
    known = recording.parameters
    taken = min(options.round - 1, outcome.rounds)
    before = known.get("what_if", known.get("rule"))
    rows: list[tuple[str, object]] = [
        ("system", outcome.system),
        ("parent", f"{file_name(options.parent)}, rule {before}: {taken} of its rounds"),
        ("what if", f"rule {rule} from round {options.round} on"),
        ("rounds", outcome.rounds),
        *_counts(outcome),
        ("log", outcome.log),
    ]
    document = {
        **outcome.document(),
        "parent": file_name(options.parent),
        "from_round": options.round,
        "what_if": rule,
    }
    console.answer(options, document, console.table(rows))
    return _ended(outcome)


@contextlib.contextmanager
def watched_rounds() -> Generator[dict[str, Any]]:
    """Show how a run continues from a recording, and yield the arguments that let it be watched."""
    with console.progress_bar(None, "run", " rounds") as bar:

        def say(line: str) -> None:
            bar.clear()
            console.complain(line)

        # Without other processes, a rule that prints would print into the answer.
        with contextlib.redirect_stdout(sys.stderr):
            yield {"watch": lambda _: bar.update(1), "say": say}


def with_damage(error: InputError, recording: Any) -> InputError:
    """Return an error with the damage of the recording, which may be why it cannot be used."""
    return InputError("; ".join([str(error), *recording.problems]))
