"""The command ``cubepath improve``: search outside the homotopy class, bounds and proofs.

`following` has what it does for plans whose vehicles follow one another.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING

from cubepath.coordinator.commands import files, shorten
from cubepath.coordinator.commands.console import progress_bar
from cubepath.coordinator.commands.path_options import add_durations, add_plan_options
from cubepath.coordinator.commands.usage import more_options, number, whole
from cubepath.coordinator.progress import StageProgress
from cubepath.coordinator.theory.commands.following import improve_following
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.coordinator.shortening.normal_path import Shortened
    from cubepath.coordinator.theory.optimality.optimality_report import OptimalityReport
    from cubepath.coordinator.theory.search.budget import SearchStage

_SECONDS = 10.0
_duration = number("a number of seconds, 0 or more", lambda seconds: seconds >= 0)


def add_improve(improve: argparse.ArgumentParser) -> None:
    """Add the options of ``improve``."""
    improve.set_defaults(command=_improve)
    shorten.add_path_options(improve)
    improve.add_argument(
        "--seconds",
        type=_duration,
        metavar="S",
        help="search for a shorter schedule in other homotopy classes for S seconds (default"
        f" {_SECONDS:g}, if nothing else is asked for)",
    )
    improve.add_argument(
        "--steps",
        type=whole(0),
        metavar="N",
        help="the same with N steps instead of seconds: one result on every machine",
    )
    improve.add_argument(
        "--bounds",
        action="store_true",
        help="only bound from below the cubes of every path between the same ends",
    )
    improve.add_argument(
        "--prove",
        type=_duration,
        metavar="SECONDS",
        help="search for the shortest schedule of all, and prove that none is shorter",
    )
    improve.add_argument(
        "--proof",
        type=files.output_path,
        metavar="FILE.proof",
        help="with --prove: write what was proved, for 'cubepath verify FILE.proof'",
    )
    improve.add_argument(
        "--following",
        choices=("mapf", "cgshop"),
        metavar="RULE",
        help="for plans of vehicles: a timetable in which a vehicle may enter what another leaves"
        " at one time, under the rule of path finding (mapf) or of CG:SHOP 2021 (cgshop); -o then"
        " writes it, a move a line",
    )
    improve.add_argument(
        "--explain",
        action="store_true",
        help="say which chain of moves proves that no schedule in the class, or timetable, is"
        " shorter",
    )
    more = more_options(improve)
    more.add_argument("--seed", type=whole(0), help="seed of the search (default 0)")
    more.add_argument(
        "--max-states",
        type=whole(0),
        metavar="N",
        help="states that the search for the exact optimum may look at (default 100000)",
    )
    add_plan_options(more)
    add_durations(more)


def _seconds(options: argparse.Namespace) -> float | None:
    """Return how long to search for a better path: by default, if nothing else is asked for."""
    if options.seconds is None and not options.bounds and not _leaves_class(options):
        return _SECONDS
    seconds: float | None = options.seconds
    return seconds


def _leaves_class(options: argparse.Namespace) -> bool:
    """Return whether an option asks for a path outside the class."""
    return any(getattr(options, name) is not None for name in ("seconds", "steps", "prove"))


def _improve(options: argparse.Namespace) -> int:
    if options.proof is not None and options.prove is None:
        raise InputError("--proof: expected --prove SECONDS with it, which proves something")
    if options.following is not None:
        return improve_following(options)
    if options.durations:
        raise InputError("--durations: expected --following with it, or 'cubepath shorten'")
    if options.seconds is not None and options.steps is not None:
        raise InputError("--seconds and --steps: expected one of the two")
    out: Path | None = options.out
    if (
        out is not None
        and out.suffix.lower() == ".npz"
        and not (options.bounds and not _leaves_class(options))
    ):
        raise InputError(f"{out}: holds moves of the input alone, expected a .jsonl file")
    files.check_files(
        options,
        [options.input],
        files.Output(out, files.PATH_SUFFIXES, stream=True),
        files.Output(options.proof, (".proof",)),
    )
    found = shorten.shortened_input(options)
    began = time.perf_counter()
    known = _searched(options, found)
    document = known.document()
    document["seconds"] = found.seconds + time.perf_counter() - began
    lines: tuple[str, ...] = ()
    if options.explain:
        from cubepath.coordinator.shortening.explain import certified_path  # noqa: PLC0415

        with progress_bar(None, "certificate", ""):
            explanation = shorten.explained(found, certified_path(found))
        document |= explanation.document
        lines = explanation.lines
    if out is not None:
        with progress_bar(None, "write", ""):
            shorten.write_schedule(out, found, lambda: known.named)
    rows = tuple(_rows(known, options.proof))
    return shorten.answer_shortened(options, found, shorten.MoreResults(document, rows, lines))


def _searched(options: argparse.Namespace, found: Shortened) -> OptimalityReport:
    """Return what the options ask for; progress goes to standard error."""
    from cubepath.coordinator.theory.optimality.optimality_report import beyond  # noqa: PLC0415
    from cubepath.coordinator.theory.optimality.tasks import task_of  # noqa: PLC0415
    from cubepath.coordinator.theory.search.exact import MAX_STATES  # noqa: PLC0415

    most: int = MAX_STATES if options.max_states is None else options.max_states
    task = task_of(found)
    with progress_bar(None, "bounds", " steps") as bar:
        shown = StageProgress(bar)
        return beyond(
            task,
            found,
            seconds=_seconds(options),
            iterations=options.steps,
            seed=options.seed or 0,
            max_states=most,
            prove=options.prove,
            proof=options.proof,
            watch=shown.watch,
            tick=shown.tick,
            between=shown.between,
        )


def _rows(known: OptimalityReport, proof: Path | None) -> list[tuple[str, object]]:
    """Return the lines of the summary; `proof` is the file that was asked for."""
    optimal = {True: "yes", False: "no, a shorter one exists", None: "not known"}[known.optimal]
    rows: list[tuple[str, object]] = []
    if known.improved is not None:
        rows.append(("improved", known.improved))
    rows += [("lower bound", f"{known.lower_bound} ({known.why})"), ("optimal", optimal)]
    if known.agreed is not None:
        rows.append(("agreed", f"{known.agreed} (two solvers, without a proof to check)"))
    if proof is not None:
        none = files.none_written(proof, "no length was refuted by clauses")
        rows.append(("proof", known.proof or none))
    if known.only_class is not None:
        rows.append(("other classes", "none" if known.only_class else "some"))
    rows += [
        ("spent on" if not place else "", _stage_text(each))
        for place, each in enumerate(known.spent)
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


def _stage_text(stage: SearchStage) -> str:
    unit = _STEPS.get(stage.name)
    if unit is None:
        return f"{stage.name} {stage.seconds:.1f} s"
    ended = _ENDED[stage.ended] if stage.why is None else f", {stage.why}"
    steps = counted(stage.steps, unit)
    return f"{stage.name} {stage.seconds:.1f} s ({steps}{ended})"
