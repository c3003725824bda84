"""The commands that run modules: ``cubepath run``, ``router`` and ``join``."""

from __future__ import annotations

import argparse
import contextlib
import re
import sys
import time
from pathlib import Path
from typing import Any

from cubepath.coordinator.commands.console import (
    DONE,
    FAILED,
    INTERRUPTED,
    SYSTEM_HELP,
    answer,
    complain,
    table,
)
from cubepath.coordinator.commands.files import check_files, input_path, output_path
from cubepath.coordinator.commands.progress import progress_bar
from cubepath.coordinator.commands.usage import AddCommand, module_numbers, number, whole
from cubepath.coordinator.plugins import plugin
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted
from cubepath.protocol.core.output_files import STANDARD_OUTPUT

_NAME = re.compile(r"process_(0|[1-9]\d{0,8})", re.ASCII)
_RUN = re.compile(r"[0-9a-f]{12}")
_LOOK_S = 0.5


def add_commands(command: AddCommand) -> None:
    """Add the commands and their options."""
    _add_run(command)
    router = command("router", _router)
    router.add_argument(
        "--listen", required=True, metavar="ENDPOINT", help="tcp/HOST:PORT or tls/HOST:PORT"
    )
    _add_secure(router)
    join = command("join", _join)
    join.add_argument(
        "--connect",
        required=True,
        metavar="ENDPOINT",
        help="where the run's router listens: tcp/HOST:PORT or tls/HOST:PORT",
    )
    join.add_argument(
        "--modules",
        required=True,
        type=module_numbers,
        metavar="0-7,9",
        help="the numbers of the modules that this process has",
    )
    join.add_argument("--run", type=_run_id, metavar="RUN", help="which run, if several wait")
    _add_secure(join)
    join.add_argument(
        "--as",
        type=_process_name,
        dest="name",
        metavar="process_N",
        help="join as the process of this number; with --secure by the certificate of this name",
    )
    join.add_argument(
        "--rule",
        metavar="FILE.py:NAME",
        help="the file to use if the run's rule is in a file; no other file runs",
    )
    _add_patience(join, "end if nothing is heard of the run for so long (default 60)")


def _add_run(command: AddCommand) -> None:
    run = command("run", _run)
    run.add_argument("system", nargs="?", metavar="SYSTEM", help=SYSTEM_HELP)
    run.add_argument(
        "--rule",
        help="rule of the modules, a name or FILE.py:NAME (default: the one that reaches the goal)",
    )
    run.add_argument(
        "--seed", type=whole(0), default=0, help="seed of every random choice (default 0)"
    )
    run.add_argument(
        "--hesitate",
        type=number("a number from 0 to less than 1", lambda p: 0 <= p < 1),
        default=0.0,
        metavar="P",
        help="each module skips a round with this probability (default 0)",
    )
    run.add_argument(
        "--processes",
        type=whole(0),
        default=4,
        metavar="N",
        help="processes to spread the modules over; 0 keeps them all here (default 4)",
    )
    run.add_argument(
        "--max-rounds",
        type=whole(0),
        metavar="N",
        help="end after N rounds, or levels (default 1000; with a schedule one a cube, 1000 more to"
        " repair); without rounds a few more may be done by then",
    )
    _add_patience(run, "end if nothing comes of a phase for so long (default 60)")
    _add_free(run)
    run.add_argument(
        "--schedule",
        type=input_path,
        metavar="CUBES",
        help="carry out a cubes file or the schedule of a recording, one cube a round; SYSTEM can"
        " then be another scene than that of the recording",
    )
    run.add_argument(
        "--repair",
        action="store_true",
        help="where a cube of the schedule no longer applies, go on with the rule from there",
    )
    run.add_argument(
        "--log", type=output_path, help="recording to write (default: a new file in logs/)"
    )
    run.add_argument(
        "--listen",
        metavar="ENDPOINT",
        help="let others listen at tcp/HOST:PORT or tls/HOST:PORT, and join with"
        " --wait-for (default: nobody else can)",
    )
    run.add_argument(
        "--connect", metavar="ENDPOINT", help="use the router that listens there, and start none"
    )
    _add_secure(run)
    plugin("add_live_options")(run)
    run.add_argument(
        "--wait-for",
        type=whole(0),
        default=0,
        metavar="N",
        help="wait until N processes have joined from elsewhere, each within --patience"
        " of the last; --processes have what they leave",
    )


def _add_free(run: argparse.ArgumentParser) -> None:
    run.add_argument(
        "--clock",
        choices=("lockstep", "free"),
        default="lockstep",
        help="in rounds, or without: every module acts when it is ready (default lockstep)",
    )
    run.add_argument(
        "--keepers",
        type=whole(1),
        default=4,
        metavar="N",
        help="with the free clock: processes that keep the sites (default 4)",
    )
    run.add_argument(
        "--speed",
        type=_speed,
        action="append",
        default=[],
        metavar="MODULE=F",
        help="with the free clock: this module thinks F times 10 ms before it acts, not at once",
    )
    run.add_argument(
        "--jitter",
        type=number("a number, 0 or more", lambda share: share >= 0),
        default=0.0,
        metavar="J",
        help="and up to J times longer than that, at random (default 0)",
    )
    run.add_argument(
        "--on-crash",
        choices=("stop", "continue", "restart"),
        default="stop",
        help="with the free clock: what to do when a process has died (default stop)",
    )
    run.add_argument(
        "--resume",
        type=input_path,
        metavar="RECORDING",
        help="take up a run with the free clock that was cut off or failed, where its keepers'"
        " logs end",
    )
    run.add_argument(
        "--log-time",
        choices=("round", "level", "wall"),
        help="the log time of messages in the recording: the round, or with the free clock the"
        " level (default), or the wall clock",
    )


def _speed(text: str) -> tuple[int, float]:
    module, found, factor = text.partition("=")
    with contextlib.suppress(ValueError):
        if found and module.isascii() and module.isdigit():
            return int(module), float(factor)
    raise argparse.ArgumentTypeError(f"expected MODULE=FACTOR as 3=100, found {text!r}")


def _add_secure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--secure",
        type=Path,
        metavar="DIR",
        help="use TLS with the certificates of a folder; see 'cubepath certificates'",
    )


def _add_patience(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument(
        "--patience",
        type=number("a number of seconds above 0 and below 3600", lambda each: 0 < each < 3600),
        default=60.0,
        metavar="SECONDS",
        help=what,
    )


def _process_name(text: str) -> str:
    if not _NAME.fullmatch(text):
        raise argparse.ArgumentTypeError(f"expected process_N, found {text!r}")
    return text


def _run_id(text: str) -> str:
    if not _RUN.fullmatch(text):
        raise argparse.ArgumentTypeError(f"expected the twelve digits of a run, found {text!r}")
    return text


def _run(options: argparse.Namespace) -> int:
    from cubepath.coordinator.runs.plan import Plan  # noqa: PLC0415 - only what a command needs
    from cubepath.coordinator.runs.run import Run  # noqa: PLC0415

    check_files(options, [options.schedule])
    if options.log == STANDARD_OUTPUT:
        raise InputError("standard output: has the answer, expected a file for the recording")
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
        patience=options.patience,
        listen=options.listen,
        connect=options.connect,
        secure=options.secure,
        wait_for=options.wait_for,
        clock=options.clock,
        keepers=options.keepers,
        speeds=dict(options.speed),
        jitter=options.jitter,
        on_crash=options.on_crash,
        log_time=options.log_time,
        resume=options.resume,
    )
    free = options.clock == "free" or options.resume is not None
    with progress_bar(None, "run", " moves" if free else " rounds") as bar:

        def watch(gatherer: Any) -> None:
            heap = gatherer.live if free else gatherer.heap
            bar.set_postfix_str(
                f"{counted(heap.moves, 'move')}, {counted(heap.cubes, 'cube')}", refresh=False
            )
            bar.update(heap.moves - bar.n if free else 1)

        def say(line: str) -> None:
            bar.clear()
            complain(line)

        # Without other processes, a rule that prints would print into the answer.
        with contextlib.redirect_stdout(sys.stderr):
            running = Run(plan, watch=watch, say=say)
            with plugin("watched")(options, running, say):
                outcome = running.play_from_the_start()
    rows: list[tuple[str, object]] = [
        ("system", f"{outcome.system}, rule {outcome.rule}, seed {outcome.seed}"),
        ("modules", f"{outcome.modules} in {outcome.processes or 'no other'} processes"),
        *([] if outcome.keepers is None else [("keepers", outcome.keepers)]),
        ("levels" if free else "rounds", outcome.rounds),
        ("moves", outcome.moves),
        ("reduced moves", outcome.reduced_moves),
        ("cubes", outcome.cubes),
        ("largest cube", outcome.max_cube_dimension),
        ("goal", "reached" if outcome.goal_reached else "not reached"),
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
    answer(options, outcome.document(), table(rows))
    if outcome.error is not None:
        complain(outcome.error)
    return {"failed": FAILED, "interrupted": INTERRUPTED}.get(outcome.ended, DONE)


def _router(options: argparse.Namespace) -> int:
    """Route until an interrupt, which is an exception here."""
    from cubepath.protocol.wire.router import Router, without_tls  # noqa: PLC0415

    with Router(options.listen, secure=options.secure) as router:
        if options.secure is None:
            complain(without_tls(router.listening))
        answer(options, {"endpoint": router.listening}, f"listening on {router.listening}")
        while True:
            time.sleep(_LOOK_S)
            if router.look_after():
                complain(f"the router died, and was started again at {router.listening}")


def _join(options: argparse.Namespace) -> int:
    from cubepath.agents.processes.joining import Joining, join  # noqa: PLC0415

    joining = Joining(
        options.connect,
        options.modules,
        run=options.run,
        name=options.name,
        secure=options.secure,
        patience_s=options.patience,
        rule=options.rule,
    )
    # A rule that prints would print into the answer.
    with contextlib.redirect_stdout(sys.stderr):
        orders = join(joining, complain)
    document = {"run": orders.run, "process": orders.process, "modules": orders.modules}
    answer(options, document, table(list(document.items())))
    return DONE
