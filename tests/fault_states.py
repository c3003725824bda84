"""Plays simulated seeds until each kind of fault has struck in each state in which it has before.

`data/fault_states.json` has by clock in how many seeds a kind struck something in a state (what is
``met``), what no seed has met (``unmet``), and what ``cannot`` be met, with the reason. Cells that
are met in few seeds are not asked for. ``--write SEEDS`` counts anew.
"""

import argparse
import json
import re
from collections import Counter
from collections.abc import Iterable
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias

from cubepath.coordinator.simulation.scenarios import ScenarioOptions
from cubepath.coordinator.simulation.swarm import Simulator, simulator_of

FILE = Path(__file__).parent / "data" / "fault_states.json"
Cell: TypeAlias = tuple[str, str]
"""A kind of fault, and the state of what it strikes."""
ASKED = {
    "lockstep": ScenarioOptions(),
    "liars": ScenarioOptions(liars=True),
    "free": ScenarioOptions(clock="free"),
}
SEEDS_MIN = 5
"""What was met in fewer seeds may be met no more by chance."""
LONGER = 5
"""How many times the seeds of the file are played at most."""


def cells_of(simulator: Simulator, seed: int) -> set[Cell]:
    """Return the cells that the run of a seed meets."""
    return set(simulator.run_of(seed).met)


def usual(told: dict[str, Any], share: float = 0.0) -> set[Cell]:
    """Return the cells that are met in enough seeds, and in this share of them."""
    least = max(SEEDS_MIN, share * told["seeds"])
    met = told["met"].items()
    return {(kind, state) for kind, counts in met for state, n in counts.items() if n >= least}


def impossible(told: dict[str, Any]) -> set[Cell]:
    """Return the cells that cannot be met, each of which has a reason."""
    return {cell for each in told["cannot"] for cell in product(each["kinds"], each["states"])}


def unmet(simulator: Simulator, cells: set[Cell], seeds: Iterable[int]) -> set[Cell]:
    """Return which of the cells none of the seeds meets; it stops when all are met."""
    left = set(cells)
    for seed in seeds:
        left -= cells_of(simulator, seed)
        if not left:
            break
    return left


def write(simulator: Simulator, told: dict[str, Any], seeds: int) -> set[Cell]:
    """Count in how many of the seeds each cell is met; return those that cannot be, but were."""
    found = Counter(cell for seed in range(seeds) for cell in cells_of(simulator, seed))
    every = list(product(simulator.kinds, simulator.states))
    told["seeds"] = seeds
    told["met"] = {
        kind: {state: found[kind, state] for state in simulator.states if found[kind, state]}
        for kind in simulator.kinds
    }
    told["unmet"] = [cell for cell in every if cell not in found and cell not in impossible(told)]
    return impossible(told) & found.keys()


def text_of(told: dict[str, Any]) -> str:
    """Return the file as text, a line a kind or a reason."""
    text = json.dumps(told, indent=1)
    return re.sub(r"\n {4,}|\n {3}(?=[\]}])", " ", text) + "\n"


def main() -> int:
    """Return 1 if a cell is met no more, or one that cannot be."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", type=int, metavar="SEEDS", help="count that many seeds anew")
    parser.add_argument("--clock", choices=ASKED, action="append", help="default: all")
    options = parser.parse_args()
    told, failed = json.loads(FILE.read_text()), False
    for clock in options.clock or ASKED:
        simulator, one = simulator_of(ASKED[clock]), told[clock]
        if options.write:
            wrong, why = write(simulator, one, options.write), "met, and is said to be impossible"
        else:
            wrong = unmet(simulator, usual(one), range(LONGER * one["seeds"]))
            why = f"not met any more in {LONGER * one['seeds']} seeds"
        for kind, state in sorted(wrong):
            print(f"{clock}: {kind} in {state}: {why}")
        failed |= bool(wrong)
    if options.write:
        FILE.write_text(text_of(told))
    return int(failed)


if __name__ == "__main__":
    raise SystemExit(main())
