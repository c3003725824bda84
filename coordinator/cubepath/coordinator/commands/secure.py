"""The command that makes certificates for secure runs: ``cubepath certificates``."""

from __future__ import annotations

import argparse
from pathlib import Path

from cubepath.coordinator.commands.console import DONE, answer
from cubepath.coordinator.commands.usage import AddCommand, whole
from cubepath.protocol.core.formatting import visible


def add_commands(command: AddCommand) -> None:
    """Add the command and its options."""
    certificates = command("certificates", _certificates)
    certificates.add_argument("folder", type=Path, metavar="DIR", help="a new folder for them")
    certificates.add_argument(
        "--processes",
        type=whole(0),
        default=4,
        metavar="N",
        help="certificates for process_0 to process_N-1 (default 4)",
    )
    certificates.add_argument(
        "--host",
        action="extend",
        nargs="+",
        default=[],
        metavar="NAME|IP",
        help="names and addresses of the host of the router, besides localhost",
    )
    certificates.add_argument(
        "--days", type=whole(1), default=365, metavar="D", help="valid so long (default 365)"
    )


def _certificates(options: argparse.Namespace) -> int:
    from cubepath.protocol.wire.authority import make_certificates  # noqa: PLC0415

    names = make_certificates(
        options.folder, processes=options.processes, hosts=options.host, days=options.days
    )
    document = {"folder": str(options.folder), "names": names}
    text = f"{len(names)} certificates with their keys written to {visible(str(options.folder))}"
    answer(options, document, text)
    return DONE
