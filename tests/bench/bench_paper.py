"""The paper's claims: processor time of each, and of the whole command beside its start.

    python tests/bench/bench_paper.py [--quick]

Floor: a process that imports the same modules and numba, and computes nothing. Before that, how
long it takes to derive who can obstruct whom on a lattice, as the catalogue grows, beside its peer:
moves placed wherever they might meet, and asked whether they commute.
"""

import argparse
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from itertools import product
from resource import RUSAGE_CHILDREN, getrusage
from statistics import median
from time import process_time

from cubepath.coordinator.theory.paper.claims import all_claims, compute_claims
from cubepath.protocol.core.actions import commute
from cubepath.protocol.core.catalogue import Catalogue, Cell
from cubepath.protocol.scenes.families.shapes import sliding_catalogue
from cubepath.protocol.systems.lattice import LatticeSystem

COMMAND = ["-m", "cubepath.coordinator", "paper", "--json"]
START = [
    "-c",
    "import numba, cubepath.coordinator.commands.main, cubepath.coordinator.theory.paper.claims",
]
SLOWEST = 12


def child(arguments: list[str]) -> float:
    """Return the processor time of a process of this interpreter."""
    before = getrusage(RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
    after = getrusage(RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def seconds_of(work: Callable[[], object], repeat: int) -> float:
    """Return the median processor time of some runs."""
    times = []
    for _ in range(repeat):
        began = process_time()
        work()
        times.append(process_time() - began)
    return median(times)


def placed(catalogue: Catalogue) -> set[Cell]:
    """Return the competitors of the cell at the origin, by placing moves and asking."""
    mine = catalogue.proposals((0, 0))
    supports = {site for move in mine for site in move.action.support}
    shifts = {
        catalogue.lattice.between(catalogue.lattice.check(one), catalogue.lattice.check(other))
        for one, other in product(supports, supports)
    }
    return {
        by
        for by in shifts
        if by is not None
        and any(by)
        and not all(
            commute(one.action, other.action) for other in catalogue.proposals(by) for one in mine
        )
    }


def neighbourhoods(repeat: int) -> None:
    """Print a row for each length of the longest run that slides."""
    print(f"{'run':>4} {'generators':>10} {'system ms':>10} {'placing ms':>11} {'x':>6}")
    for longest in (0, 1, 2, 4, 8):
        catalogue = sliding_catalogue(longest)
        if not placed(catalogue) <= set(LatticeSystem(catalogue).reach((0, 0))):
            raise AssertionError("the two ways differ")
        ours = seconds_of(partial(LatticeSystem, catalogue), repeat)
        peer = seconds_of(partial(placed, catalogue), repeat)
        print(
            f"{longest + 1:>4} {len(catalogue.generators):>10} {1e3 * ours:>10.2f}"
            f" {1e3 * peer:>11.2f} {peer / ours:>6.1f}",
            flush=True,
        )


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--quick", action="store_true", help="once each")
    quick = options.parse_args().quick
    repeat = 1 if quick else 3
    neighbourhoods(repeat)
    if not quick:
        child(COMMAND)  # compiles
    start = median(child(START) for _ in range(repeat))
    whole = median(child(COMMAND) for _ in range(repeat))
    print(f"start {start:.2f} s, with all claims {whole:.2f} s: {whole / start:.1f} times as long")
    rows = compute_claims(all_claims())
    for row in sorted(rows, key=lambda row: -row.seconds)[:SLOWEST]:
        print(f"{row.seconds:>8.2f}  {row.item}: {row.claim}")


if __name__ == "__main__":
    main()
