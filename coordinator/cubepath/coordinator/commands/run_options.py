"""Options that ``run``, ``join`` and other commands on runs have in common."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from cubepath.coordinator.commands.usage import number, whole

_RUN = re.compile(r"[0-9a-f]{12}")


def add_network_options(parser: Any, wait_for: str) -> None:
    """Add ``--connect``, ``--secure`` and ``--wait-for``, of which `wait_for` is the help."""
    parser.add_argument(
        "--connect", metavar="ENDPOINT", help="use the router that listens there, and start none"
    )
    add_secure(parser)
    parser.add_argument("--wait-for", type=whole(0), metavar="N", help=wait_for)


def add_secure(parser: Any, what: str = "the certificates of a folder") -> None:
    """Add ``--secure``."""
    parser.add_argument(
        "--secure",
        type=Path,
        metavar="DIR",
        help=f"use TLS with {what}; see 'cubepath host certificates'",
    )


def add_patience(parser: Any, what: str) -> None:
    """Add ``--patience``."""
    parser.add_argument(
        "--patience",
        type=number("a number of seconds above 0 and below 3600", lambda each: 0 < each < 3600),
        metavar="SECONDS",
        help=what,
    )


def run_id(text: str) -> str:
    """Return the value of ``--run``."""
    if not _RUN.fullmatch(text):
        raise argparse.ArgumentTypeError(f"expected the twelve digits of a run, found {text!r}")
    return text


def given(options: argparse.Namespace, names: Iterable[str]) -> dict[str, Any]:
    """Return which of these options were given, with their values."""
    found = {name: getattr(options, name) for name in names}
    return {name: value for name, value in found.items() if value is not None}
