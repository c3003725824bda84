"""The command line: ``cubepath run | shorten | verify | replay | info | view | complex | ...``.

Standard output carries the answer, standard error everything else. Exit codes: 0 done, 1 a check
failed, memory or a disk was full, or the answer could not be written, 2 bad input or usage, 130
interrupted with the recording closed, 141 the reader of the answer closed the pipe.
"""

from __future__ import annotations

import argparse
import errno
import logging
import resource
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from cubepath.coordinator.commands.certificates import (
    add_explain_options,
    check_explain_options,
    explain,
    write_schedule,
)
from cubepath.coordinator.commands.check_rule import add_check_rule_command
from cubepath.coordinator.commands.complexes import add_complex_commands
from cubepath.coordinator.commands.console import (
    BAD_INPUT,
    CLOSED_PIPE,
    DONE,
    FAILED,
    INTERRUPTED,
    Interrupts,
    answer,
    complain,
    prepare_streams,
    table,
)
from cubepath.coordinator.commands.cutting import add_cutting_commands
from cubepath.coordinator.commands.diff import add_diff_command
from cubepath.coordinator.commands.exporting import add_export_command
from cubepath.coordinator.commands.files import (
    PATH_SUFFIXES,
    Output,
    check_files,
    file_name,
    input_path,
    output_path,
)
from cubepath.coordinator.commands.following import add_following_options, shorten_following
from cubepath.coordinator.commands.new import add_new_command
from cubepath.coordinator.commands.pictures import add_view_command
from cubepath.coordinator.commands.plan_options import (
    INPUT_HELP,
    add_plan_options,
    hints,
    plan_rows,
    solved,
)
from cubepath.coordinator.commands.progress import progress_bar
from cubepath.coordinator.commands.record import add_record_command
from cubepath.coordinator.commands.recordings import add_recording_commands
from cubepath.coordinator.commands.replay import add_replay_command
from cubepath.coordinator.commands.report import add_report_command
from cubepath.coordinator.commands.runs import add_run_commands
from cubepath.coordinator.commands.search_options import (
    add_beyond_options,
    beyond_rows,
    improving,
    look_beyond,
)
from cubepath.coordinator.commands.secure import add_certificates_command
from cubepath.coordinator.commands.simulate import add_simulate_command
from cubepath.coordinator.commands.sweep import add_sweep_command
from cubepath.coordinator.commands.usage import Parser
from cubepath.protocol.core.control_characters import visible
from cubepath.protocol.core.errors import CubepathError, InputError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code."""
    # Silence the warning about where matplotlib keeps its caches if the home folder is read-only.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    with Interrupts() as interrupts:
        code = _guarded(arguments, interrupts)
    if interrupts.came and code != INTERRUPTED:
        complain("interrupted")
        return INTERRUPTED
    return code


def _guarded(arguments: Sequence[str] | None, interrupts: Interrupts) -> int:
    """Carry out the command; turn an error into one line and an exit code."""
    options = argparse.Namespace(smaller="a smaller input", interrupts=interrupts)
    try:
        prepare_streams()
        _parser().parse_args(arguments, options)
        command: Callable[[argparse.Namespace], int] = options.command
        return command(options)
    except InputError as error:
        complain(error)
        return BAD_INPUT
    except BrokenPipeError:
        return CLOSED_PIPE
    except (CubepathError, OSError, MemoryError) as error:
        complain(_reason(error, options.smaller))
        return FAILED
    except KeyboardInterrupt:
        complain("interrupted")
        return INTERRUPTED
    except Exception:
        # An interrupt during compilation may surface as another exception.
        if interrupts.came:
            return FAILED
        raise


def _reason(error: Exception, smaller: str) -> object:
    """Return what to say of an error; the system's own words are short of what helps."""
    if isinstance(error, MemoryError):
        return f"out of memory: expected more of it, or {smaller}"
    if isinstance(error, OSError) and error.errno == errno.EMFILE:
        most = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
        return f"too few open files are allowed: {most}, expected more (ulimit -n)"
    return error


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="cubepath",
        description="Modules of a metamorphic robot reconfigure by messages over zenoh; their path"
        " is shortened to the fastest parallel schedule in its homotopy class.",
    )
    parser.add_argument("--version", action="version", version=_version())
    parser.set_defaults(command=_help)
    commands = parser.add_subparsers(metavar="COMMAND")

    def command(
        name: str, function: Callable[[argparse.Namespace], int], summary: str
    ) -> argparse.ArgumentParser:
        added = commands.add_parser(name, help=summary, description=summary)
        added.set_defaults(command=function)
        added.add_argument("--json", action="store_true", help="answer with one JSON document")
        return added

    add_run_commands(command)

    shorten = command("shorten", _shorten, "shorten a path to its normal cube path")
    shorten.add_argument("input", type=input_path, metavar="INPUT", help=INPUT_HELP)
    shorten.add_argument(
        "-o",
        "--output",
        type=output_path,
        metavar="CUBES.jsonl",
        help="write the cubes to this file: JSON Lines (.jsonl), or the binary form (.npz); - is"
        " standard output, and the summary goes to standard error",
    )
    shorten.add_argument(
        "--system", metavar="SYSTEM", help="the system that the moves of a moves file name"
    )
    add_plan_options(shorten)
    add_beyond_options(shorten)
    add_explain_options(shorten)
    add_following_options(shorten)

    convert = command("convert", _convert, "write a path in another form: JSON Lines or .npz")
    convert.add_argument(
        "input",
        type=input_path,
        metavar="INPUT",
        help=f"{INPUT_HELP}; or cubes as .npz",
    )
    convert.add_argument(
        "output",
        type=output_path,
        metavar="OUTPUT",
        help="a file whose name ends in .jsonl or .npz; - for JSON Lines on standard output",
    )
    convert.add_argument(
        "--system", metavar="SYSTEM", help="the system that the moves of a moves file name"
    )
    add_plan_options(convert)

    add_recording_commands(command)
    add_replay_command(command)
    add_diff_command(command)
    add_record_command(command)
    add_cutting_commands(command)
    add_export_command(command)
    add_view_command(command)
    add_complex_commands(command)
    add_simulate_command(command)
    add_sweep_command(command)
    add_report_command(command)
    add_certificates_command(command)
    add_check_rule_command(command)
    add_new_command(command)
    command("systems", _systems, "list the systems with their keys and defaults")
    command("rules", _rules, "list the rules and the systems that they are for")
    return parser


def _help(_options: argparse.Namespace) -> int:
    """List the commands; called when none is given."""
    _parser().print_help()
    return DONE


def _version() -> str:
    from importlib.metadata import version  # noqa: PLC0415 - only for --version

    return f"cubepath {version('cubepath')}"


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
    from cubepath.agents.rules.asked import misfit  # noqa: PLC0415
    from cubepath.agents.rules.registry import rules  # noqa: PLC0415
    from cubepath.protocol.scenes.registry import all_families  # noqa: PLC0415
    from cubepath.protocol.scenes.specs import scene_from_spec  # noqa: PLC0415

    scenes = {name: scene_from_spec(name) for name in all_families()}
    scenes = {name: scene for name, scene in scenes.items() if scene.system.local}
    document: list[dict[str, object]] = []
    lines: list[str] = []
    for rule in rules().values():
        try:
            fitting = [
                name
                for name, scene in scenes.items()
                if rule.is_for(scene.system) and misfit(rule, scene) is None
            ]
        except InputError as error:
            complain(str(error))
            continue
        free = None if rule.free is None else rule.free.why
        document.append(
            {
                "name": rule.name,
                "summary": rule.summary,
                "source": rule.source,
                "systems": fitting,
                "clocks": list(rule.clocks),
                "free": free,
            }
        )
        lines += [
            f"{rule.name}: {rule.summary}",
            f"    for {', '.join(fitting)}",
            f"    clocks: {', '.join(rule.clocks)}" + (f"; without rounds: {free}" if free else ""),
            f"    source: {rule.source}",
        ]
    answer(options, document, "\n".join(lines))
    return DONE


def _shorten(options: argparse.Namespace) -> int:
    if options.following is not None:
        return shorten_following(options)
    from cubepath.coordinator.shortening.normal_path import shorten  # noqa: PLC0415

    check_explain_options(options)
    output: Path | None = options.output
    beyond = improving(options)
    if output is not None and output.suffix.lower() == ".npz" and beyond is not None:
        raise InputError(
            f"{output}: holds moves of the input alone, expected a .jsonl file with {beyond}"
        )
    with progress_bar(None, "shorten", " moves") as bar:
        found = shorten(
            options.input, system=options.system, progress=bar.update, hints=hints(options)
        )
    began = time.perf_counter()
    known = look_beyond(options, found)
    seconds = found.seconds + (0 if known is None else time.perf_counter() - began)
    told = explain(options, found)
    if output is not None:
        with progress_bar(None, "write", ""):
            write_schedule(output, found, known, told)
    rows: list[tuple[str, object]] = [
        ("moves", found.moves),
        ("reduced moves", found.reduced_moves),
        ("cubes", found.cubes),
        ("largest cube", found.max_cube_dimension),
        *plan_rows(found),
        *beyond_rows(known, options.proof),
        *told.rows,
        ("time", f"{seconds:.2f} s"),
    ]
    if options.output is not None:
        rows.append(("written to", file_name(options.output)))
    document = found.document() | {"seconds": round(seconds, 3)}
    document |= ({} if known is None else known.document()) | told.document
    answer(options, document, "\n".join([table(rows), *map(visible, told.lines)]))
    return solved(options, found.given.unsolved)


def _convert(options: argparse.Namespace) -> int:
    from cubepath.coordinator.shortening.conversion import convert  # noqa: PLC0415

    check_files(options, [options.input], Output(options.output, PATH_SUFFIXES, stream=True))
    with progress_bar(None, "convert", " moves") as bar:
        found = convert(
            options.input,
            options.output,
            system=options.system,
            progress=bar.update,
            hints=hints(options),
        )
    document = {"what": found.what, "count": found.count, "output": str(options.output)}
    written = visible(file_name(options.output))
    answer(options, document, f"{found.count} {found.what} written to {written}")
    return solved(options, found.unsolved)
