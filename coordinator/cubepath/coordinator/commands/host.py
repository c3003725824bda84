"""The commands for runs on several hosts: ``cubepath host router`` and ``host certificates``."""

import argparse
import contextlib
import re
import sys
import time
from pathlib import Path

from cubepath.coordinator.commands.console import DONE, answer, complain, table
from cubepath.coordinator.commands.usage import add_fields, module_numbers, whole
from cubepath.coordinator.runs.options import RunOptions
from cubepath.protocol.core.formatting import visible

_LOOK_S = 0.5


def add_host_router(router: argparse.ArgumentParser) -> None:
    """Add the options of ``host router``."""
    router.set_defaults(command=_router)
    router.add_argument(
        "--listen", required=True, metavar="ENDPOINT", help="tcp/HOST:PORT or tls/HOST:PORT"
    )
    router.add_argument(
        "--connect",
        action="extend",
        nargs="+",
        default=[],
        metavar="ENDPOINT",
        help="the routers to link it with; of two, one connects to the other",
    )
    add_fields(router, RunOptions, "secure")


def _router(options: argparse.Namespace) -> int:
    """Route until an interrupt."""
    from cubepath.protocol.wire.router import Router, without_tls  # noqa: PLC0415
    from cubepath.protocol.wire.sessions import check_links, endpoints_in  # noqa: PLC0415

    links = [each for text in options.connect for each in endpoints_in(text)]
    check_links(options.listen, links)
    with Router(options.listen, secure=options.secure, links=links) as router:
        if options.secure is None:
            complain(without_tls(router.listening))
        answer(options, {"endpoint": router.listening}, f"listening on {router.listening}")
        with contextlib.suppress(KeyboardInterrupt):
            while True:
                time.sleep(_LOOK_S)
                if router.look_after():
                    complain(f"the router died, and was started again at {router.listening}")
    options.interrupts.came = False  # as it always ends
    return DONE


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
        "--keepers",
        type=whole(0),
        default=4,
        metavar="N",
        help="certificates for keeper_0 to keeper_N-1, for --clock free (default 4)",
    )
    certificates.add_argument(
        "--host",
        action="extend",
        nargs="+",
        default=[],
        metavar="HOST[=NAME,NAME]",
        help="names and addresses of the router's host, in addition to localhost; HOST=process_0"
        " has a router of its own, which may forward the messages of these names alone",
    )
    certificates.add_argument(
        "--days", type=whole(1), default=365, metavar="D", help="valid for D days (default 365)"
    )


def _certificates(options: argparse.Namespace) -> int:
    from cubepath.protocol.wire.authority import make_certificates  # noqa: PLC0415

    names = make_certificates(
        options.folder,
        processes=options.processes,
        keepers=options.keepers,
        hosts=options.host,
        days=options.days,
    )
    document = {"folder": str(options.folder), "names": names}
    text = f"{len(names)} certificates with their keys written to {visible(str(options.folder))}"
    answer(options, document, text)
    return DONE


_RUN = re.compile(r"[0-9a-f]{12}")
_NAME = re.compile(r"(?:process|keeper)_(0|[1-9]\d{0,8})", re.ASCII)


def add_join(join: argparse.ArgumentParser) -> None:
    """Add the options of ``join``."""
    join.set_defaults(command=_join, patience=60.0)
    join.add_argument(
        "--connect",
        required=True,
        metavar="ENDPOINT",
        help="where the run's router listens: tcp/HOST:PORT or tls/HOST:PORT; of linked routers,"
        " all to try, separated by commas",
    )
    join.add_argument(
        "--modules",
        default=(),
        type=module_numbers,
        metavar="0-7,9",
        help="the numbers of the modules that this process has; a keeper has none",
    )
    join.add_argument("--run", type=_run_id, metavar="RUN", help="which run, if several wait")
    add_fields(join, RunOptions, "secure", "patience")
    join.add_argument(
        "--as",
        type=_process_name,
        dest="name",
        metavar="process_N|keeper_K",
        help="join as the process or the keeper of this number; with --secure by the certificate of"
        " this name",
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
        raise argparse.ArgumentTypeError(f"expected process_N or keeper_K, found {text!r}")
    return text


def _join(options: argparse.Namespace) -> int:
    from cubepath.agents.free.joining import Joining, join  # noqa: PLC0415
    from cubepath.agents.keepers.config import KeeperConfig  # noqa: PLC0415

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
    document: dict[str, object] = {"run": orders.run}
    if isinstance(orders, KeeperConfig):
        document |= {"keeper": orders.keeper, "log": orders.log}
    else:
        document |= {"process": orders.process, "modules": orders.modules}
    answer(options, document, table(list(document.items())))
    return DONE
