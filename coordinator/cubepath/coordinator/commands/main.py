"""The command line: ``cubepath run | shorten | verify | replay | info | view | complex | ...``.

Room: coordinator. Standard output carries the answer, standard error all else; exit code 0 done,
1 a check failed, 2 bad input or usage, 130 interrupted with the recording closed.
"""

from __future__ import annotations

import argparse
import contextlib
import logging
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from cubepath.coordinator.commands.certificates import (
    add_certificate_options,
    add_explain_options,
    check_explain_options,
    explain,
    is_of_a_path,
    verify_certificate,
    write_schedule,
)
from cubepath.coordinator.commands.complexes import add_complex_commands
from cubepath.coordinator.commands.console import (
    BAD_INPUT,
    DONE,
    FAILED,
    INTERRUPTED,
    SYSTEM_HELP,
    Interrupts,
    answer,
    complain,
    progress_bar,
    table,
)
from cubepath.coordinator.commands.pictures import add_view_command
from cubepath.coordinator.commands.plan_options import (
    INPUT_HELP,
    add_plan_options,
    hints,
    plan_rows,
)
from cubepath.coordinator.commands.search_options import (
    add_beyond_options,
    beyond_rows,
    look_beyond,
)
from cubepath.protocol.core.errors import CubepathError, InputError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code."""
    options = _parser().parse_args(arguments)
    # Where matplotlib keeps its caches when it cannot keep them at home is no answer to anybody.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    with Interrupts() as interrupts:
        code = _guarded(options, interrupts)
    if interrupts.came and code != INTERRUPTED:
        complain("interrupted")
        return INTERRUPTED
    return code


def _guarded(options: argparse.Namespace, interrupts: Interrupts) -> int:
    """Carry out the command; turn what goes wrong into a line and an exit code."""
    command: Callable[[argparse.Namespace], int] = options.command
    try:
        code = command(options)
        print(end="", flush=True)
    except InputError as error:
        complain(error)
        return BAD_INPUT
    except CubepathError as error:
        complain(error)
        return FAILED
    except OSError as error:
        # Nobody takes our output: keep the interpreter from complaining about it once more.
        if not isinstance(error, BrokenPipeError):
            complain(f"standard output: {error.strerror or error}")
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except KeyboardInterrupt:
        complain("interrupted")
        return INTERRUPTED
    except Exception:
        # An interrupt in the middle of compiling comes out as something else.
        if interrupts.came:
            return FAILED
        raise
    else:
        return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="cubepath",
        description="Modules of a metamorphic robot reconfigure by messages over zenoh; their path"
        " is shortened to the fastest parallel schedule in its homotopy class.",
    )
    parser.add_argument("--version", action="version", version=_version())
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(
        name: str, function: Callable[[argparse.Namespace], int], summary: str
    ) -> argparse.ArgumentParser:
        added = commands.add_parser(name, help=summary, description=summary)
        added.set_defaults(command=function)
        added.add_argument("--json", action="store_true", help="answer with one JSON document")
        return added

    run = command("run", _run, "run modules in processes, record them, shorten their path")
    run.add_argument("system", nargs="?", metavar="SYSTEM", help=SYSTEM_HELP)
    run.add_argument("--rule", help="rule of the modules (default: the one that reaches the goal)")
    run.add_argument("--seed", type=int, default=0, help="seed of every random choice (default 0)")
    run.add_argument(
        "--hesitate",
        type=float,
        default=0.0,
        metavar="P",
        help="each module skips a round with this probability (default 0)",
    )
    run.add_argument(
        "--processes",
        type=int,
        default=4,
        metavar="N",
        help="processes to spread the modules over; 0 keeps them all here (default 4)",
    )
    run.add_argument(
        "--max-rounds",
        type=int,
        metavar="N",
        help="end after N rounds (default 1000; with a schedule one a cube, 1000 more to repair)",
    )
    run.add_argument(
        "--schedule",
        type=Path,
        metavar="CUBES",
        help="carry out a cubes file or the schedule of a recording, one cube a round; SYSTEM can"
        " then be another scene than that of the recording",
    )
    run.add_argument(
        "--repair",
        action="store_true",
        help="where a cube of the schedule no longer applies, go on with the rule from there",
    )
    run.add_argument("--log", type=Path, help="recording to write (default: a new file in logs/)")

    shorten = command("shorten", _shorten, "shorten a path to its normal cube path")
    shorten.add_argument("input", type=Path, metavar="INPUT", help=INPUT_HELP)
    shorten.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="CUBES.jsonl",
        help="write the cubes to this file: JSON Lines, or the binary form where it ends in .npz",
    )
    shorten.add_argument(
        "--system", metavar="SYSTEM", help="the system that the moves of a moves file name"
    )
    add_plan_options(shorten)
    add_beyond_options(shorten)
    add_explain_options(shorten)

    convert = command("convert", _convert, "write a path in another form: JSON Lines or .npz")
    convert.add_argument(
        "input",
        type=Path,
        metavar="INPUT",
        help=f"{INPUT_HELP}; or cubes as .npz",
    )
    convert.add_argument(
        "output", type=Path, metavar="OUTPUT", help="JSON Lines, or .npz where it ends so"
    )
    convert.add_argument(
        "--system", metavar="SYSTEM", help="the system that the moves of a moves file name"
    )
    add_plan_options(convert)

    verify = command(
        "verify", _verify, "check a recording, from the start state on; or a certificate"
    )
    verify.add_argument("log", type=Path, metavar="LOG")
    add_certificate_options(verify)
    verify.add_argument(
        "--recover", type=Path, metavar="OUT", help="write what can be read as a proper recording"
    )

    replay = command(
        "replay", _replay, "put a recording back on zenoh; gather and shorten it again"
    )
    replay.add_argument("log", type=Path, metavar="LOG")
    replay.add_argument(
        "--rate", type=float, metavar="R", help="rounds a second (default: as fast as it goes)"
    )
    replay.add_argument(
        "--endpoint", help="where the router listens, as tcp/127.0.0.1:7447 (default: a free port)"
    )

    info = command("info", _info, "say what a recording holds")
    info.add_argument("log", type=Path, metavar="LOG")

    add_view_command(command)
    add_complex_commands(command)
    command("systems", _systems, "list the systems with their keys and defaults")
    command("rules", _rules, "list the rules and the systems that they are for")
    return parser


def _version() -> str:
    from importlib.metadata import version  # noqa: PLC0415 - only for --version

    return f"cubepath {version('cubepath')}"


def _run(options: argparse.Namespace) -> int:
    from cubepath.coordinator.runs.launch import Plan, run  # noqa: PLC0415 - only what a command needs

    plan = Plan(
        system=options.system,
        rule=options.rule,
        seed=options.seed,
        hesitate=options.hesitate,
        processes=options.processes,
        max_rounds=options.max_rounds,
        log=options.log,
        schedule=options.schedule,
        repair=options.repair,
    )
    with progress_bar(None, "run", " rounds") as bar:

        def watch(gatherer: Any) -> None:
            heap = gatherer.heap
            bar.set_postfix(moves=heap.moves, cubes=heap.cubes, refresh=False)
            bar.update()

        # With no other processes a rule that prints would print into the answer.
        with contextlib.redirect_stdout(sys.stderr):
            outcome = run(plan, watch)
    rows: list[tuple[str, object]] = [
        ("system", f"{outcome.system}, rule {outcome.rule}, seed {outcome.seed}"),
        ("modules", f"{outcome.modules} in {outcome.processes or 'no other'} processes"),
        ("rounds", outcome.rounds),
        ("moves", outcome.moves),
        ("reduced moves", outcome.reduced_moves),
        ("cubes", outcome.cubes),
        ("largest cube", outcome.max_cube_dimension),
        ("goal", "reached" if outcome.goal_reached else "not reached"),
        ("time", f"{outcome.seconds:.2f} s"),
        ("messages", outcome.messages),
        ("log", outcome.log),
    ]
    if outcome.schedule_cubes is not None:
        stopped = outcome.schedule_stopped
        how = "" if stopped is None else f", stopped at round {stopped.round}: {stopped.reason}"
        rows.insert(1, ("schedule", f"{outcome.schedule_cubes} cubes{how}"))
    answer(options, outcome.document(), table(rows))
    if outcome.error is not None:
        complain(outcome.error)
    return {"failed": FAILED, "interrupted": INTERRUPTED}.get(outcome.ended, DONE)


def _systems(options: argparse.Namespace) -> int:
    from cubepath.protocol.scenes.registry import all_families  # noqa: PLC0415

    document = [
        {
            "name": family.name,
            "summary": family.summary,
            "rule": family.rule,
            "keys": {
                key: {"default": default, "summary": summary}
                for key, (default, summary) in family.keys.items()
            },
        }
        for family in all_families().values()
    ]
    lines = []
    for family in all_families().values():
        rule = f" (rule {family.rule})" if family.rule else ""
        lines.append(f"{family.name}: {family.summary}{rule}")
        for key, (default, summary) in family.keys.items():
            lines.append(f"    {key}={default:<6} {summary}")
    answer(options, document, "\n".join(lines))
    return DONE


def _rules(options: argparse.Namespace) -> int:
    from cubepath.agents.rules.registry import rules  # noqa: PLC0415
    from cubepath.protocol.scenes.registry import all_families  # noqa: PLC0415
    from cubepath.protocol.scenes.specs import scene_from_spec  # noqa: PLC0415

    systems = {name: scene_from_spec(name).system for name in all_families()}
    systems = {name: system for name, system in systems.items() if system.local}
    document = [
        {
            "name": rule.name,
            "summary": rule.summary,
            "source": rule.source,
            "systems": [name for name, system in systems.items() if rule.fits(system)],
        }
        for rule in rules().values()
    ]
    lines = [
        f"{rule['name']}: {rule['summary']}\n"
        f"    for {', '.join(rule['systems'])}\n"
        f"    source: {rule['source']}"
        for rule in document
    ]
    answer(options, document, "\n".join(lines))
    return DONE


def _shorten(options: argparse.Namespace) -> int:
    from cubepath.coordinator.shortening.normal_path import shorten  # noqa: PLC0415

    check_explain_options(options)
    output: Path | None = options.output
    read = [options.input, *map(Path, filter(None, [options.system]))]
    for source in read:
        if output is not None and output.exists() and source.exists() and output.samefile(source):
            what = "is the input" if source == options.input else "holds the system"
            raise InputError(f"{output}: {what}, expected another file for the cubes")
    if output is not None and output.suffix == ".npz" and options.improve is not None:
        raise InputError(
            f"{output}: holds moves of the input alone, expected a .jsonl file with --improve"
        )
    with progress_bar(None, "shorten", " moves") as bar:
        found = shorten(
            options.input, system=options.system, progress=bar.update, hints=hints(options)
        )
    known = look_beyond(options, found)
    told = explain(options, found)
    if output is not None:
        write_schedule(output, found, known, told)
    rows: list[tuple[str, object]] = [
        ("moves", found.moves),
        ("reduced moves", found.reduced_moves),
        ("cubes", found.cubes),
        ("largest cube", found.max_cube_dimension),
        *plan_rows(found),
        *beyond_rows(known),
        *told.rows,
        ("time", f"{found.seconds:.2f} s"),
    ]
    if options.output is not None:
        rows.append(("written to", options.output))
    document = found.document() | ({} if known is None else known.document()) | told.document
    answer(options, document, "\n".join([table(rows), *told.lines]))
    return DONE


def _convert(options: argparse.Namespace) -> int:
    from cubepath.coordinator.shortening.conversion import convert  # noqa: PLC0415

    with progress_bar(None, "convert", " moves") as bar:
        found = convert(
            options.input,
            options.output,
            system=options.system,
            progress=bar.update,
            hints=hints(options),
        )
    document = {"what": found.what, "count": found.count, "output": str(options.output)}
    answer(options, document, f"{found.count} {found.what} written to {options.output}")
    return DONE


def _verify(options: argparse.Namespace) -> int:
    if is_of_a_path(options):
        return verify_certificate(options)
    from cubepath.coordinator.verification.recording import recover, verify  # noqa: PLC0415
    from cubepath.protocol.recordings.recording import read_recording  # noqa: PLC0415

    recording = read_recording(options.log)
    with progress_bar(None, "verify", " rounds") as bar:
        found = verify(recording, bar.update)
    width = max(len(check.name) for check in found.checks)
    lines = [
        f"{'ok    ' if check.ok else 'FAILED'}  {check.name:<{width}}  {check.detail}".rstrip()
        for check in found.checks
    ]
    lines.append(f"{found.rounds} rounds, {found.moves} moves, {found.cubes} cubes")
    answer(options, found.document(), "\n".join(lines))
    if options.recover is not None:
        saved = recover(recording, options.recover)
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
