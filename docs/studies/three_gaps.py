"""Three gaps between a run and the optimum: timing, class and rule, where the optimum is proved.

``python docs/studies/three_gaps.py -o docs/studies/three-gaps.json`` plays all settings,
``--quick`` two small ones. Each is played with a common beat (h 0) and with modules that skip half
of their rounds (h 1/2), from seeds 0, 1, ... For each run that reaches its goal there are its
rounds and the cubes of its normal cube path; for each setting the best schedule and lower bound
that are found from its best run.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from time import monotonic

from cubepath.agents import play
from cubepath.coordinator import beyond, shorten, task_of

HESITATE = (0.0, 0.5)
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


def measure(system: str, rule: str, *, seeds: int, effort: int = 60) -> Row:
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
    known = beyond(task, shortest, iterations=effort)
    best = shortest.cubes if known.improved is None else known.improved
    return Row(system, rule, seeds, runs, shortest.cubes, best, known.lower_bound, known.why)


def write(path: Path, rows: list[Row]) -> None:
    """Write the rows, one a line."""
    lines = [json.dumps(asdict(row), separators=(",", ":")) for row in rows]
    path.write_text("[\n" + ",\n".join(lines) + "\n]\n", "utf-8")


def main() -> None:
    """Print the rows, and write them to a file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="two small settings only")
    parser.add_argument("--seeds", type=int, default=30, help="runs of each kind")
    parser.add_argument("-o", type=Path, metavar="FILE", help="a JSON file for the rows")
    asked = parser.parse_args()
    rows = []
    for system, rule in QUICK if asked.quick else SETTINGS:
        began = monotonic()
        rows.append(row := measure(system, rule, seeds=asked.seeds))
        print(
            f"{system} {rule}: fewest {row.fewest}, best {row.best}, bound {row.bound}"
            f" ({row.why}), {monotonic() - began:.1f} s",
            flush=True,
        )
        if asked.o is not None:
            write(asked.o, rows)


if __name__ == "__main__":
    main()
