"""How long it takes to check reads, writes and versions of a path and its cubes.

With cubepath installed: ``python tests/bench/bench_dependencies.py [--quick]``.

Times are processor times of one thread. The floor is one pass over the same supports that touches
each site once in a dict. The path of moves has rounds of one move each, and its cubes are its
normal form. Nothing is asserted but that the check holds.
"""

import argparse
from collections.abc import Sequence
from functools import partial

from bench_shorten import exponent, floor, random_walk, seconds

from cubepath.coordinator.normal_form.compiled_heap import FastHeap
from cubepath.coordinator.verification.dependencies import check_dependencies
from cubepath.protocol.core.actions import Action

SIZES = (10_000, 100_000, 1_000_000)
QUICK_SIZES = (1_000, 10_000)
SPECS = {"agv:graph=grid20x20,n=80": SIZES, "hex:n=40": SIZES[:2]}
"""Hexagons take minutes to walk a million moves."""


def check(path: Sequence[Action], cubes: Sequence[Sequence[Action]]) -> None:
    """Check a path and its cubes, which agree."""
    wrong: list[str] = []
    ends = range(1, len(path) + 1)
    check_dependencies(path, ends, cubes, lambda _, line: wrong.append(line), whole=True)
    if wrong:
        raise AssertionError(wrong)


def rows(spec: str, sizes: Sequence[int]) -> None:
    """Print a line for each size."""
    walk = random_walk(spec, max(sizes))
    before: tuple[int, float] | None = None
    for size in sizes:
        path = walk[:size]
        heap = FastHeap()
        heap.extend(path)
        cubes = [list(cube) for cube in heap.cube_path()]
        least = seconds(partial(floor, path), 3)
        checking = seconds(partial(check, path, cubes), 3)
        growth = exponent((size, checking), before)
        left = sum(map(len, cubes))
        print(
            f"{spec:<26}{size:>9}{left:>9}{least:>9.3f}{checking:>9.3f}"
            f"{checking / least:>8.1f}{growth:>8}"
        )
        before = size, checking


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small sizes")
    quick = parser.parse_args().quick
    print(
        f"{'path':<26}{'moves':>9}{'left':>9}"
        f"{'floor s':>9}{'check s':>9}{'x floor':>8}{'growth':>8}"
    )
    for spec, sizes in SPECS.items():
        rows(spec, QUICK_SIZES if quick else sizes)


if __name__ == "__main__":
    main()
