"""Runs without rounds against runs with rounds, on the same scenes: moves, messages, waits, cubes.

Prints one table. Real processes over zenoh; times are from the first move to the last, by the wall
clock on record, medians over several seeds. Run on a machine that does nothing else:

    python tests/bench/bench_free.py [--seeds N] [--quick]
"""

import argparse
import statistics
import tempfile
import textwrap
from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal

from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import run
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.wire.free_messages import Commit, decode_free

SCENES = (("hex:n=12", None), ("agv:graph=grid8x8,n=30", None), ("arm:n=8", None))
_SLOW = 3


@dataclass(frozen=True, slots=True)
class Measured:
    """What came of one run."""

    moves: int
    cubes: int
    levels: int
    seconds: float
    messages: int
    commit_messages: float = 0.0
    longest_wait_s: float = 0.0


def measured(folder: Path, number: int, **options: object) -> Measured:
    """Run a plan and read its recording."""
    log = folder / f"{number}.mcap"
    outcome = run(Plan(log=log, **options))  # type: ignore[arg-type]  # what a plan takes
    if outcome.error is not None:
        raise SystemExit(f"{options}: {outcome.error}")
    recording = read_recording(log)
    free = recording.clock == "free"
    kind = "commit" if free else "reports"
    walls = [record.wall_ns for record in recording.of_kind(kind)]
    seconds = (max(walls) - min(walls)) / 1e9 if len(walls) > 1 else 0.0
    return Measured(
        outcome.moves,
        outcome.cubes,
        outcome.rounds,
        seconds,
        outcome.messages,
        _commit_messages(recording) if free else 0.0,
        _longest_wait(recording) if free else 0.0,
    )


def _commit_messages(recording: Recording) -> float:
    """Return the messages for one commit: asked, passed, decided, told; sensing is apart."""
    count: Counter[str] = Counter()
    for record in recording.records:
        for part in record.parts():
            count[part.kind] += 1
    commits = sum(1 for _ in recording.of_kind("commit"))
    parts = sum(count[kind] for kind in ("attempt", "forwarded", "decision", "inquiry", "settled"))
    return parts / max(1, commits)


def _longest_wait(recording: Recording) -> float:
    """Return how long a module went at most between two of its own commits."""
    when: dict[int, list[int]] = {}
    for record in recording.of_kind("commit"):
        message = decode_free(record.data)
        if isinstance(message, Commit):
            when.setdefault(message.module, []).append(record.wall_ns)
    waits = [later - earlier for each in when.values() for earlier, later in pairwise(each)]
    return max(waits, default=0) / 1e9


def _slow_rule(folder: Path, rule: str, think_s: float) -> str:
    """Return a rule that takes its time to choose: one module takes a hundred times as long."""
    path = folder / "thinking.py"
    path.write_text(
        textwrap.dedent(
            f"""
            import time
            from dataclasses import replace
            from cubepath.agents.rules.registry import rule_named
            from cubepath.agents import RuleType
            from cubepath.protocol.scenes.specs import scene_from_spec
            from cubepath.agents.rules.registry import BUILT_IN

            known = BUILT_IN[{rule!r}]

            def make(knowledge):
                found = known.make(knowledge)
                seconds = {think_s} * (100 if knowledge.module == {_SLOW} else 1)

                def choose(view):
                    choice = found(view)
                    if getattr(choice, "action", choice):
                        time.sleep(seconds)
                    return choice

                return choose

            THINKING = replace(known, name="thinking", make=make, free=None)
            """
        )
    )
    return f"{path}:THINKING"


def _median(found: list[Measured], name: str) -> float:
    return float(statistics.median(getattr(each, name) for each in found))


def _row(title: str, found: list[Measured]) -> None:
    moves, seconds = _median(found, "moves"), max(_median(found, "seconds"), 1e-9)
    print(
        f"{title:<44}{moves:>7.0f}{_median(found, 'cubes'):>7.0f}{seconds:>9.2f}"
        f"{moves / seconds:>9.0f}{_median(found, 'messages') / seconds:>10.0f}"
        f"{_median(found, 'commit_messages'):>8.1f}{_median(found, 'longest_wait_s'):>8.2f}",
        flush=True,
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--cubes", type=int, default=0, help="compare cubes over so many seeds")
    options = parser.parse_args()
    seeds = range(1 if options.quick else options.seeds)
    print(
        f"{'':<44}{'moves':>7}{'cubes':>7}{'s':>9}{'moves/s':>9}{'mess./s':>10}"
        f"{'a move':>8}{'wait s':>8}"
    )
    with tempfile.TemporaryDirectory() as name:
        folder, number = Path(name), 0

        def rows(title: str, **plan: object) -> None:
            nonlocal number
            found = []
            for seed in seeds:
                number += 1
                found.append(measured(folder, number, seed=seed, **plan))
            _row(title, found)

        for spec, rule in SCENES[:1] if options.quick else SCENES:
            for clock in ("lockstep", "free"):
                rows(f"{spec} {clock}", system=spec, rule=rule, clock=clock)
        size = 4 if options.quick else 8
        spec, every = f"hex:n={size}", dict.fromkeys(range(size), 1.0)
        thinking = _slow_rule(folder, "chain", 0.01)
        rows(f"{spec} lockstep, one 100 times slower", system=spec, rule=thinking, processes=size)
        rows(
            f"{spec} free, one 100 times slower",
            system=spec,
            clock="free",
            processes=size,
            speeds={**every, _SLOW: 100.0},
        )
        rows(f"{spec} free, all think", system=spec, clock="free", processes=size, speeds=every)
        big = "agv:graph=grid12x12,n=64" if options.quick else "agv:graph=grid24x24,n=256"
        most = 5 if options.quick else 100
        for clock in ("lockstep", "free"):
            rows(f"{big} {clock}, random", system=big, rule="random", clock=clock, max_rounds=most)
        if options.cubes:
            _cubes(folder, options.cubes)


def _cubes(folder: Path, seeds: int) -> None:
    """Compare the cubes of the normal cube path under both clocks."""
    found: dict[Literal["lockstep", "free"], list[int]] = {"lockstep": [], "free": []}
    for seed in range(seeds):
        for clock, cubes in found.items():
            log = folder / f"cubes-{clock}-{seed}.mcap"
            plan = Plan(
                system="agv:graph=grid6x6,n=12", seed=seed, hesitate=0.3, clock=clock, log=log
            )
            cubes.append(run(plan).cubes)
    for clock, cubes in found.items():
        print(
            f"cubes over {seeds} seeds, {clock}: median {statistics.median(cubes):.0f},"
            f" {min(cubes)} to {max(cubes)}"
        )


if __name__ == "__main__":
    main()
