"""How long it takes to check a proof of optimality, beside the solver that made it.

With the extra ``proofs``: ``python tests/bench/bench_proofs.py [--quick]``.

Proofs are made in the obvious way, which is slow and not counted: chains of hexagons, at one round
below the optimum. ``solve`` is CaDiCaL, handing over the clauses included; ``derive`` finds moves,
windows and clauses again; ``follow`` checks the log. Nothing is asserted but that the proof holds.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

from cubepath.coordinator.verification.optimality import Refutation
from cubepath.coordinator.verification.unit_propagation import Refuter
from cubepath.protocol.scenes.specs import scene_from_spec

sys.path.append(str(Path(__file__).parents[1]))
from obvious_refutations import claim_of, log_of

CHAINS = ((6, 17), (7, 21), (8, 27))
QUICK = ((4, 8),)


def row(size: int, rounds: int) -> None:
    """Print a line for a chain of so many hexagons."""
    scene = scene_from_spec(f"hex:n={size}")
    claim, obvious = claim_of(scene, [], frozenset(scene.goal or ()), refuted=rounds)
    begun = time.perf_counter()
    log = log_of(len(obvious.variables), obvious.clauses)
    assert log is not None
    times = [time.perf_counter()]
    literals, ends = Refutation(replace(claim, log=[log])).clauses
    times.append(time.perf_counter())
    refuter = Refuter(len(obvious.variables), literals, ends)
    why = refuter.check(log)
    times.append(time.perf_counter())
    assert why is None
    assert refuter.refuted
    solve, derive, follow = (
        after - before for before, after in zip([begun, *times], times, strict=False)
    )
    print(
        f"hex:n={size:<3} {rounds:>3} rounds {len(ends):>8} clauses {len(log) / 1e6:>6.1f} MB"
        f"  solve {solve:>6.2f} s  derive {derive:>5.2f} s  follow {follow:>6.2f} s"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a small chain alone")
    quick = parser.parse_args().quick
    row(*QUICK[0])  # loads, or compiles
    for size, rounds in () if quick else CHAINS:
        row(size, rounds)


if __name__ == "__main__":
    main()
