"""The options of ``cubepath shorten`` that look beyond the homotopy class, and their answers."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from cubepath.coordinator.commands.files import none_written, output_path
from cubepath.coordinator.commands.progress import progress_bar
from cubepath.coordinator.commands.usage import number, whole
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.coordinator.shortening.normal_path import Shortened
    from cubepath.coordinator.theory.optimality.optimality_report import OptimalityReport
    from cubepath.coordinator.theory.search.anytime import Improvement
    from cubepath.coordinator.theory.search.budget import SearchStage


def add_beyond_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--improve``, ``--effort``, ``--prove``, ``--bounds`` and what belongs to them."""
    parser.add_argument(
        "--improve",
        type=number("a number of seconds, 0 or more", lambda seconds: seconds >= 0),
        metavar="SECONDS",
        help="search for a shorter schedule in other homotopy classes; implies --bounds",
    )
    parser.add_argument(
        "--effort",
        type=whole(0),
        metavar="N",
        help="the same with N steps instead of seconds: one result on every machine",
    )
    parser.add_argument(
        "--seed", type=whole(0), default=0, help="seed of the search for improvements (default 0)"
    )
    parser.add_argument(
        "--bounds",
        action="store_true",
        help="bound from below the cubes of every path between the same ends",
    )
    parser.add_argument(
        "--prove",
        type=number("a number of seconds, 0 or more", lambda seconds: seconds >= 0),
        metavar="SECONDS",
        help="search for the shortest schedule of all, and prove that none is shorter",
    )
    parser.add_argument(
        "--proof",
        type=output_path,
        metavar="FILE.proof",
        help="with --prove: write what was proved, for 'cubepath verify FILE.proof'",
    )
    parser.add_argument(
        "--max-states",
        type=whole(0),
        metavar="N",
        help="states that the search for the exact optimum may look at (default 100000)",
    )


_BEYOND = ("improve", "effort", "prove")
"""The options that may find a path outside the class."""


def check_proof_option(options: argparse.Namespace) -> None:
    """Check that there is something to write into a proof; InputError if not."""
    if options.proof is not None and options.prove is None:
        raise InputError(
            "--proof: says where to write what --prove SECONDS has proved, which is missing"
        )


def improving(options: argparse.Namespace) -> str | None:
    """Return the option that asks for a path outside the class, None if there is none."""
    return next(
        (f"--{name}" for name in _BEYOND if getattr(options, name) is not None),
        None,
    )


def look_beyond(options: argparse.Namespace, found: Shortened) -> OptimalityReport | None:
    """Return what the options ask for, None if that is nothing; InputError if it is impossible.

    Progress goes to standard error.
    """
    seconds: float | None = options.improve
    effort: int | None = options.effort
    check_proof_option(options)
    if improving(options) is None and not options.bounds:
        return None
    if seconds is not None and effort is not None:
        raise InputError("--improve and --effort: one counts seconds, one steps, expected one")
    from cubepath.coordinator.theory.optimality.optimality_report import beyond  # noqa: PLC0415
    from cubepath.coordinator.theory.optimality.tasks import task_of  # noqa: PLC0415
    from cubepath.coordinator.theory.search.exact import MAX_STATES  # noqa: PLC0415

    most: int = MAX_STATES if options.max_states is None else options.max_states
    task = task_of(found)
    with progress_bar(None, "bounds", " steps") as bar:

        def watch(better: Improvement) -> None:
            bar.set_postfix_str(
                f"{counted(better.cubes, 'cube')}, {counted(better.moves, 'move')}", refresh=False
            )

        def tick(stage: str, steps: int) -> None:
            if steps == 0:
                bar.reset()
                bar.set_description(stage, refresh=False)
            bar.update(steps - bar.n)

        def between(least: int, cubes: int) -> None:
            bar.set_postfix_str(
                f"{counted(cubes, 'cube')}, open: {least}..{cubes - 1}", refresh=False
            )

        return beyond(
            task,
            found,
            seconds=seconds,
            iterations=effort,
            seed=options.seed,
            max_states=most,
            prove=options.prove,
            proof=options.proof,
            watch=watch,
            tick=tick,
            between=between,
        )


def beyond_rows(known: OptimalityReport | None, proof: Path | None) -> list[tuple[str, object]]:
    """Return the lines of the summary; `proof` is the file that was asked for."""
    if known is None:
        return []
    optimal = {True: "yes", False: "no, a shorter one exists", None: "not known"}[known.optimal]
    rows: list[tuple[str, object]] = []
    if known.improved is not None:
        rows.append(("improved", known.improved))
    rows += [
        ("lower bound", f"{known.lower_bound} ({known.why})"),
        ("optimal", optimal),
    ]
    if known.agreed is not None:
        rows.append(("agreed", f"{known.agreed} (two solvers, without a proof to check)"))
    if proof is not None:
        none = none_written(proof, "no length was refuted by clauses")
        rows.append(("proof", known.proof or none))
    if known.only_class is not None:
        rows.append(("other classes", "none" if known.only_class else "there are"))
    rows += [
        ("spent on" if not place else "", _told(each)) for place, each in enumerate(known.spent)
    ]
    return rows


_STEPS = {
    "classes": "state",
    "bounds": "site",
    "windows": "move",
    "optimum": "state",
    "search": "attempt",
    "solver": "problem",
    "proof": "problem",
}
"""What the steps of each stage count."""
_ENDED = {
    "done": "",
    "time": ", out of time",
    "limit": ", at its limit",
    "interrupt": ", interrupted",
}


def _told(stage: SearchStage) -> str:
    unit = _STEPS.get(stage.name)
    if unit is None:
        return f"{stage.name} {stage.seconds:.1f} s"
    ended = _ENDED[stage.ended] if stage.why is None else f", {stage.why}"
    steps = counted(stage.steps, unit)
    return f"{stage.name} {stage.seconds:.1f} s ({steps}{ended})"
