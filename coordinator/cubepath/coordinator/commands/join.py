"""The command ``cubepath join``: some modules of a run elsewhere."""

from __future__ import annotations

import argparse
import contextlib
import re
import sys

from cubepath.coordinator.commands.console import DONE, answer, complain, table
from cubepath.coordinator.commands.usage import add_fields, module_numbers
from cubepath.coordinator.runs.options import RunOptions

_RUN = re.compile(r"[0-9a-f]{12}")
_NAME = re.compile(r"process_(0|[1-9]\d{0,8})", re.ASCII)


def add_join(join: argparse.ArgumentParser) -> None:
    """Add the options of ``join``."""
    join.set_defaults(command=_join, patience=60.0)
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
    add_fields(join, RunOptions, "secure", "patience")
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


def _run_id(text: str) -> str:
    if not _RUN.fullmatch(text):
        raise argparse.ArgumentTypeError(f"expected the twelve digits of a run, found {text!r}")
    return text


def _process_name(text: str) -> str:
    if not _NAME.fullmatch(text):
        raise argparse.ArgumentTypeError(f"expected process_N, found {text!r}")
    return text


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
