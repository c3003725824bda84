"""The command ``cubepath paper``."""

from __future__ import annotations

import argparse
from textwrap import fill
from typing import TYPE_CHECKING

from cubepath.coordinator.commands.console import DONE, FAILED, answer, complain, progress_bar

if TYPE_CHECKING:  # a command starts faster without it
    from cubepath.coordinator.theory.paper.registry import ClaimResult


def add_paper(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``paper``."""
    parser.set_defaults(command=_paper)


def _paper(options: argparse.Namespace) -> int:
    from cubepath.coordinator.theory.paper.claims import all_claims, compute_claims  # noqa: PLC0415

    claims = all_claims()
    rows: list[ClaimResult] = []
    with progress_bar(len(claims), "paper", " claims") as bar:

        def note(row: ClaimResult) -> None:
            rows.append(row)
            bar.update()

        try:
            compute_claims(claims, note)
        except KeyboardInterrupt:
            bar.close()
            _say_rows(options, rows)  # keep what was computed
            raise
    _say_rows(options, rows)
    wrong = [row for row in rows if not row.as_expected]
    for row in wrong:
        complain(f"{row.item}: not what is known to come out: {row.computed}")
    return FAILED if wrong else DONE


def _say_rows(options: argparse.Namespace, rows: list[ClaimResult]) -> None:
    lines = []
    for row in rows:
        mark = {True: "agrees", False: "DIFFERS", None: "open"}[row.agrees]
        lines += [
            f"{mark:<8} {row.item}  ({row.seconds:.1f} s)",
            *_wrapped("claim", row.claim),
            *_wrapped("computed", row.computed),
        ]
    found = [sum(row.agrees is outcome for row in rows) for outcome in (True, False, None)]
    lines.append(f"{len(rows)} claims: {found[0]} agree, {found[1]} differ, {found[2]} open")
    answer(options, [row.document() for row in rows], "\n".join(lines))


def _wrapped(name: str, text: str) -> list[str]:
    return fill(
        text, width=100, initial_indent=f"         {name:<9} ", subsequent_indent=" " * 19
    ).splitlines()
