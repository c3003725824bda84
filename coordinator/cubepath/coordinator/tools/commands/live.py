"""Pages that follow a run: ``cubepath run --live``, and ``cubepath view --connect`` elsewhere."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from cubepath.coordinator.commands.console import DONE, FAILED, INTERRUPTED, answer, complain, table
from cubepath.coordinator.commands.usage import add_fields, number, whole
from cubepath.coordinator.runs.options import RunOptions
from cubepath.protocol.core.errors import InputError

if TYPE_CHECKING:  # a command starts faster without it
    from cubepath.coordinator.runs.run import Run

_PORT_MAX = 65535
_LOOK_S = 0.5
_port = whole(0)
_OPTIONS = {"input": "INPUT", "other": "OTHER"}


def add_live_options(run: argparse.ArgumentParser, more: Any) -> None:
    """Add the options of a run that is watched, of which few need `more`."""
    _add_live(run, "serve a page that follows the run, and can pause and step it")
    more.add_argument(
        "--paused",
        action="store_true",
        help="with --live: wait before the first round until the page resumes the run",
    )
    more.add_argument(
        "--rate",
        type=number("a number of rounds a second above 0, at most 1000", lambda r: 0 < r <= 1000),
        metavar="R",
        help="with --live: play R rounds a second at most",
    )


def _add_live(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument(
        "--live",
        nargs="?",
        type=port,
        const=0,
        metavar="PORT",
        help=f"{what}, on this machine alone, and print its address (default: any free port)",
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
                raise InputError(f"--{name}: expected --live with it")
        yield
        return
    from cubepath.coordinator.tools.live.watching import LivePage  # noqa: PLC0415 - only what is needed

    with LivePage(running, port=options.live, rate=options.rate, paused=options.paused) as page:
        # The address comes last: terminals take what follows it for a part of it.
        waits = "paused until you resume it on its page, " if options.paused else ""
        say(f"{waits}live at {page.address}")
        yield


def add_connect_options(view: argparse.ArgumentParser, more: Any) -> None:
    """Add the options of a run elsewhere that is watched, of which few need `more`."""
    view.add_argument(
        "--connect",
        metavar="ENDPOINT",
        help="follow a run elsewhere on a page: where the run can be listened to, as it says"
        " itself, or that of its router; of linked routers, all to try, separated by commas",
    )
    _add_live(view, "with --connect: serve its page at this port")
    view.add_argument("--run", metavar="RUN", help="with --connect: which run, if several")
    add_fields(more, RunOptions, "secure")


def watch_elsewhere(options: argparse.Namespace) -> int:
    """Follow a run elsewhere on a page, until it ends or this is interrupted."""
    from cubepath.coordinator.tools.live.remote_pages import RemoteRunPage  # noqa: PLC0415

    for name in ("input", "other", "out", "system", "of", "format", "rate"):
        if getattr(options, name):
            option = _OPTIONS.get(name, f"--{name}")
            raise InputError(f"--connect: follows a running run, expected no {option}")
    interrupted = False
    with RemoteRunPage(
        options.connect, options.run, port=options.live or 0, secure=options.secure
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
    for name in ("run", "live", "secure"):
        if getattr(options, name) is not None:
            raise InputError(f"--{name}: expected --connect with it")
