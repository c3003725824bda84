"""Pages that follow a run: ``cubepath run --live``, and ``cubepath view --connect`` elsewhere."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from cubepath.coordinator.commands.console import (
    DONE,
    FAILED,
    INTERRUPTED,
    answer,
    complain,
    table,
)
from cubepath.coordinator.commands.usage import number, whole
from cubepath.protocol.core.errors import InputError

if TYPE_CHECKING:  # a command starts faster without it
    from cubepath.coordinator.runs.run import Run

_PORT_MAX = 65535
_LOOK_S = 0.5
_port = whole(0)


def add_live_options(run: argparse.ArgumentParser) -> None:
    """Add the options of a run that is watched."""
    run.add_argument(
        "--live",
        nargs="?",
        type=port,
        const=0,
        metavar="PORT",
        help="serve a page that follows the run, and can pause and step it, on this machine alone;"
        " its address is told (default: a free port)",
    )
    run.add_argument(
        "--paused",
        action="store_true",
        help="with --live: wait before the first round until the page lets the run go on",
    )
    run.add_argument(
        "--rate",
        type=number("a number of rounds a second above 0, at most 1000", lambda r: 0 < r <= 1000),
        metavar="R",
        help="with --live: play R rounds a second at most",
    )


def port(text: str) -> int:
    """Return a port for an option; 0 is any that is free."""
    found = int(_port(text))
    if found > _PORT_MAX:
        raise argparse.ArgumentTypeError(f"expected a port up to {_PORT_MAX}, found {found}")
    return found


@contextmanager
def watched(
    options: argparse.Namespace, running: Run, say: Callable[[str], None]
) -> Generator[None]:
    """Serve the page of a run, if that is asked for."""
    if options.live is None:
        for name, value in (("paused", options.paused), ("rate", options.rate)):
            if value:
                raise InputError(f"{name}: expected --live beside it")
        yield
        return
    from cubepath.coordinator.tools.live.watching import Live  # noqa: PLC0415 - only what is needed

    with Live(running, port=options.live, rate=options.rate, paused=options.paused) as page:
        # The address comes last: terminals take what follows it for a part of it.
        waits = "paused until you resume it on its page, " if options.paused else ""
        say(f"{waits}live at {page.address}")
        yield


def add_connect_options(view: argparse.ArgumentParser) -> None:
    """Add the options of a run elsewhere that is watched."""
    view.add_argument(
        "--connect",
        metavar="ENDPOINT",
        help="serve a page that follows a run elsewhere, on this machine alone: where the run can"
        " be listened to, as it says itself, or that of its router",
    )
    view.add_argument("--run", metavar="RUN", help="with --connect: which run, if several")
    view.add_argument(
        "--port", type=port, metavar="PORT", help="with --connect: serve there (default: any)"
    )
    view.add_argument(
        "--secure",
        type=Path,
        metavar="DIR",
        help="with --connect: use TLS with the certificate of guest in a folder",
    )


def watch_elsewhere(options: argparse.Namespace) -> int:
    """Follow a run elsewhere on a page, until it ends or this is interrupted."""
    from cubepath.coordinator.tools.live.remote_pages import watch_run  # noqa: PLC0415

    for name in ("input", "other", "output", "system", "of", "format", "fps"):
        if getattr(options, name):
            raise InputError(f"connect: follows a run that goes on, expected no {name}")
    interrupted = False
    with watch_run(
        options.connect, options.run, port=options.port or 0, secure=options.secure
    ) as run:
        late = f" from the end of round {run.begins} on," if run.begins else ""
        complain(f"run {run.run}{late} live at {run.address}")
        try:
            while not run.wait(_LOOK_S):
                pass
        except KeyboardInterrupt:
            interrupted = True
    rows = {"run": run.run, "begins": run.begins, "round": run.round, "ended": run.ended}
    answer(options, rows, table(list(rows.items())))
    if interrupted:
        complain("interrupted")
        return INTERRUPTED
    if run.error is not None:
        complain(run.error)
    return FAILED if run.ended in {"gone", "missed"} else DONE


def check_no_connect_options(options: argparse.Namespace) -> None:
    """Refuse options of a run elsewhere where there is none."""
    for name in ("run", "port", "secure"):
        if getattr(options, name) is not None:
            raise InputError(f"{name}: expected --connect beside it")
