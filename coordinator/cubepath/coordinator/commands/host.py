"""The commands for runs on several hosts: ``cubepath host router`` and ``host certificates``."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from cubepath.coordinator.commands.console import DONE, answer, complain
from cubepath.coordinator.commands.usage import add_fields, whole
from cubepath.coordinator.runs.options import RunOptions
from cubepath.protocol.core.formatting import visible

_LOOK_S = 0.5


def add_host_router(router: argparse.ArgumentParser) -> None:
    """Add the options of ``host router``."""
    router.set_defaults(command=_router)
    router.add_argument(
        "--listen", required=True, metavar="ENDPOINT", help="tcp/HOST:PORT or tls/HOST:PORT"
    )
    add_fields(router, RunOptions, "secure")


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


def add_host_certificates(certificates: argparse.ArgumentParser) -> None:
    """Add the options of ``host certificates``."""
    certificates.set_defaults(command=_certificates)
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
        help="names and addresses of the router's host, in addition to localhost",
    )
    certificates.add_argument(
        "--days", type=whole(1), default=365, metavar="D", help="valid for D days (default 365)"
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
