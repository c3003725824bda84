"""The command ``cubepath simulate``: runs under faults."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cubepath.coordinator.commands import console
from cubepath.coordinator.commands.files import add_out, check_files
from cubepath.coordinator.commands.usage import whole
from cubepath.coordinator.testing.properties import apart, unmet
from cubepath.protocol.core.output_files import check_output_folder
from cubepath.protocol.core.ranges import seeds_of

if TYPE_CHECKING:  # a command starts faster without it
    from cubepath.coordinator.simulation.swarm import KeptRun, SeedTally

_SHOWN_MAX = 300
"""Of a line on what failed this many characters are shown; the document and the log have it all."""


def add_simulate(simulate: argparse.ArgumentParser) -> None:
    """Add the options of ``simulate``."""
    simulate.set_defaults(command=_simulate)
    simulate.add_argument(
        "--seeds",
        default="100",
        metavar="N",
        help="N seeds from 0 on, A..B, or a list such as 3,7 (default 100)",
    )
    simulate.add_argument(
        "--system",
        metavar="SYSTEM",
        help="simulate this system alone: a name for small scenes of it, or as for 'cubepath run'",
    )
    simulate.add_argument("--rule", help="simulate this rule alone")
    simulate.add_argument(
        "--modules", type=whole(1), metavar="N", help="scenes with about N modules (default 3 to 6)"
    )
    simulate.add_argument(
        "--liars", action="store_true", help="let module processes lie in most of the runs"
    )
    simulate.add_argument(
        "--clock",
        choices=("lockstep", "free"),
        default="lockstep",
        help="simulate runs with rounds, or with keepers and without rounds (default: lockstep)",
    )
    simulate.add_argument(
        "--why",
        action="store_true",
        help="stop at the first seed that fails, and find the event that decided it",
    )
    add_out(
        simulate,
        "DIR",
        "folder for the recordings and pictures of failing seeds (default: logs)",
        folder=True,
        default=Path("logs"),
    )


def _simulate(options: argparse.Namespace) -> int:
    from cubepath.coordinator.simulation import swarm  # noqa: PLC0415
    from cubepath.coordinator.simulation.scenarios import ScenarioOptions, check  # noqa: PLC0415

    check_files(options, [])
    seeds = seeds_of(options.seeds)
    asked = ScenarioOptions(
        options.system, options.rule, options.modules, options.liars, options.clock
    )
    check(asked)
    check_output_folder(options.out)
    tally, began, interrupted = swarm.SeedTally(swarm.simulator_of(asked)), time.monotonic(), False
    with console.progress_bar(len(seeds), "simulate", " seeds") as bar, apart():

        def failing(seed: int) -> None:
            bar.set_postfix_str(f"shrinking seed {seed}")

        def played(runs: int) -> None:
            bar.set_postfix_str(f"why seed {tally.failed[-1].seed}: {runs} runs", refresh=False)

        try:
            # A rule that prints would print into the answer.
            with contextlib.redirect_stdout(sys.stderr):
                for kept in swarm.simulate_seeds(seeds, options.out, tally, failing=failing):
                    if kept is not None:
                        bar.clear()
                        _tell(kept)
                        if options.why:
                            swarm.explain(tally, played)
                            bar.clear()
                            break
                    bar.set_postfix_str(_state(tally), refresh=False)
                    bar.update()
                    # Where Python runs a finalizer, the exception would be dropped.
                    interrupted = options.interrupts.came
                    if interrupted:
                        break
        except KeyboardInterrupt:
            interrupted = True
        never = unmet()
    document = {**tally.document(time.monotonic() - began), "never_met": never}
    for line in never:
        console.complain(line)
    causes = [_cause(kept) for kept in tally.failed if kept.cause is not None]
    console.answer(options, document, "\n".join([*causes, _table(tally, document)]))
    if interrupted:
        console.complain("interrupted")
        return console.INTERRUPTED
    return console.FAILED if tally.outcomes["failure"] or never else console.DONE


def _state(tally: SeedTally) -> str:
    failures = tally.outcomes["failure"]
    return f"{failures} failures" if failures else ""


def _tell(kept: KeptRun) -> None:
    detail = kept.detail if len(kept.detail) <= _SHOWN_MAX else kept.detail[:_SHOWN_MAX] + "..."
    console.complain(
        f"seed {kept.seed}: {kept.kind}: {detail}; replay: {kept.command}; log: {kept.log}"
    )


def _cause(kept: KeptRun) -> str:
    cause = kept.cause
    if cause is None:
        raise AssertionError("nobody asked why")
    lines = [f"seed {kept.seed}, faults: {'; '.join(kept.faults) or 'none'}", *cause.around]
    if cause.event is None:
        lines.append(cause.what)
    if cause.fault:
        lines.append(f"a fault decided it: the bug acts later, up to event {cause.events}")
    for event in (0,) if cause.event is None else (cause.event - 1, cause.event):
        point = next(each for each in cause.points if each.event == event)
        low, high = point.interval
        after = f"after event {event}" if event else "from the start"
        lines.append(
            f"{after} {point.failures} of {point.plays} runs fail in the same way:"
            f" {point.share:.2f} ({low:.2f} to {high:.2f})"
        )
    lines.append(f"pictures: {', '.join(kept.pictures)}")
    return "\n".join([*lines, ""])


def _table(tally: SeedTally, document: dict[str, Any]) -> str:
    outcomes = tally.outcomes
    rows: list[tuple[str, object]] = [
        ("seeds", tally.seeds),
        ("failures", outcomes["failure"]),
        ("to the goal", outcomes["goal"]),
    ]
    if tally.simulator.unit == "moves":
        rows += [("enough moves", outcomes["moves"]), ("blocked", outcomes["blocked"])]
        rows += [("rule gave up", outcomes["gave-up"])]
    else:
        rows += [
            ("stopped at the round limit", outcomes["max-rounds"]),
            ("rule gave up", outcomes["gave-up"]),
            ("by a fault", sum(outcomes[kind] for kind in ("crash", "return", "stall", "lie"))),
        ]
    return console.table(
        [
            *rows,
            (tally.simulator.unit, tally.long),
            ("steps", tally.steps),
            ("faults", tally.met.total()),
            ("time", f"{document['seconds']:.2f} s, {tally.virtual_seconds:.0f} s of virtual time"),
            ("faults in", "".join(f"{state:>10}" for state in tally.simulator.states)),
            *(
                (kind, "".join(f"{count or '-':>10}" for count in counts.values()))
                for kind, counts in document["states"].items()
            ),
        ]
    )
