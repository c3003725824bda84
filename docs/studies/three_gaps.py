"""Three gaps between a run and the optimum: timing, class and rule, where the optimum is proved.

``python docs/studies/three_gaps.py -o docs/studies/three-gaps.json`` plays all settings,
``--quick`` two small ones. Each is played with a common beat (h 0) and with modules that skip half
of their rounds (h 1/2), from seeds 0, 1, ... For each run that reaches its goal there are its
rounds and the cubes of its normal cube path; for each setting the best schedule and lower bound
that are found from its best run: by exhaustive search, by 60 steps of the search past the class,
and by SAT solvers in at most ``--prove SECONDS``, which takes the extra `proofs`. A value that is
proved does not depend on the time that it took; one that is not can be better with more.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from time import monotonic
from typing import Any

from cubepath.agents import play
from cubepath.coordinator import beyond, shorten, task_of

HESITATE = (0.0, 0.5)
EFFORT = 60
"""Steps of the search for a better schedule, before that for a proof."""
SETTINGS: tuple[tuple[str, str], ...] = (
    *((f"hex:n={n}", "chain") for n in (3, 4, 5, 6, 7, 8)),
    *((f"hex:n={n},bend=60", "chain") for n in (3, 4, 5, 6, 7, 8)),
    *((f"hex:n={n},bend=0,shift={n}", "chain") for n in (3, 4, 5, 6, 7, 8)),
    *((f"hex-open:n={n}", "chain") for n in (3, 4, 5, 6, 7, 8)),
    *((f"arm:n={n}", "word") for n in (5, 10, 20, 40)),
    *((f"agv-labelled:graph=grid6x6,n={n},seed=1", "pibt") for n in (2, 4, 8, 12, 18)),
    *((f"agv:graph=grid6x6,n={n},seed=1", "tswap") for n in (2, 4, 8, 12, 18)),
)
QUICK: tuple[tuple[str, str], ...] = (("hex:n=4", "chain"), ("arm:n=5", "word"))


@dataclass(frozen=True)
class Row:
    """What came of one setting.

    `runs` has for each of `HESITATE` the rounds and cubes of the runs that reached their goal, in
    the order of their seeds. `fewest` is the fewest cubes of all of them, `best` the cubes of the
    best schedule known, and no schedule has fewer than `bound`, by the argument `why`.
    """

    system: str
    rule: str
    seeds: int
    runs: list[list[tuple[int, int]]]
    fewest: int
    best: int
    bound: int
    why: str


def measure(system: str, rule: str, *, seeds: int, prove: float | None = None) -> Row:
    """Play one setting from the seeds, and look for its optimum from the best run."""
    runs: list[list[tuple[int, int]]] = []
    shortest = None
    for hesitate in HESITATE:
        runs.append([])
        for seed in range(seeds):
            run = play(system, rule, seed=seed, hesitate=hesitate)
            if not run.reached:
                continue
            found = shorten(run)
            runs[-1].append((len(run.rounds), found.cubes))
            if shortest is None or found.cubes < shortest.cubes:
                shortest = found
    if shortest is None:
        raise SystemExit(f"{system}: none of {2 * seeds} runs of {rule} reached the goal")
    task = task_of(shortest)
    known = beyond(task, shortest, iterations=EFFORT, prove=prove)
    best = shortest.cubes if known.improved is None else known.improved
    return Row(system, rule, seeds, runs, shortest.cubes, best, known.lower_bound, known.why)


def main() -> None:
    """Print the rows, and write them to a file, in the order of the settings."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("systems", nargs="*", help="these alone; a file keeps its other rows")
    parser.add_argument("--quick", action="store_true", help="two small settings only")
    parser.add_argument("--seeds", type=int, default=30, help="runs of each kind")
    parser.add_argument("--prove", type=float, default=60.0, metavar="SECONDS", help="a setting")
    parser.add_argument("-o", type=Path, metavar="FILE", help="a JSON file that gets the rows")
    asked = parser.parse_args()
    settings = QUICK if asked.quick else SETTINGS
    known = {system for system, _ in settings}
    if strange := [system for system in asked.systems if system not in known]:
        parser.error(f"{strange[0]}: expected one of {', '.join(sorted(known))}")
    prove = None if asked.quick or not asked.prove else asked.prove
    rows: dict[str, Any] = {}
    if asked.o is not None and asked.o.exists():
        rows = {row["system"]: row for row in json.loads(asked.o.read_text("utf-8"))}
    for system, rule in settings:
        if asked.systems and system not in asked.systems:
            continue
        began = monotonic()
        row = measure(system, rule, seeds=asked.seeds, prove=prove)
        rows[system] = asdict(row)
        print(
            f"{system} {rule}: fewest {row.fewest}, best {row.best}, bound {row.bound}"
            f" ({row.why}), {monotonic() - began:.1f} s",
            flush=True,
        )
        if asked.o is not None:
            lines = [
                json.dumps(rows[each], separators=(",", ":"))
                for each, _ in SETTINGS
                if each in rows
            ]
            asked.o.write_text("[\n" + ",\n".join(lines) + "\n]\n", "utf-8")


if __name__ == "__main__":
    main()
