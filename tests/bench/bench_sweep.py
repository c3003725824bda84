"""What a sweep costs over playing its runs: 2 rules by 3 sizes by 100 seeds, in all and by size.

Floor: `play_many` of the same runs in this process, which keeps nothing but totals. The first line
is what a user waits for, in processes of their own; with ``--cold`` nothing is compiled before, so
that it has the compiler in it.
"""

import argparse
import os
import statistics
import tempfile
import time
from pathlib import Path

from cubepath.agents import play_many, rule_named
from cubepath.coordinator import sweep
from cubepath.protocol import scene_from_spec

RULES = ("chain", "random")


def whole(sizes: list[int], seeds: int, jobs: int) -> float:
    """Return the seconds of a sweep, with all that comes of it on disk."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        sweep(
            f"hex:n={','.join(map(str, sizes))}",
            rules=RULES,
            seeds=seeds,
            out=Path(folder) / "out",
            jobs=jobs,
        )
    return time.monotonic() - began


def processor(size: int, seeds: int, rule: str) -> tuple[float, float]:
    """Return the processor time of the runs of one setting, as a sweep and as the floor."""
    scene = scene_from_spec(f"hex:n={size}")
    began = time.process_time()
    play_many(scene, rule_named(rule, scene.system), range(seeds))
    floor = time.process_time() - began
    began = time.process_time()
    sweep(f"hex:n={size}", rules=rule, seeds=seeds)
    return time.process_time() - began, floor


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small, to see that it works")
    parser.add_argument("--cold", action="store_true", help="compile all anew")
    options = parser.parse_args()
    sizes, seeds, times = ([4, 6], 30, 1) if options.quick else ([8, 16, 32], 100, 3)
    with tempfile.TemporaryDirectory() as cache:
        if options.cold:  # read where compiled code is looked for, before any is
            os.environ["NUMBA_CACHE_DIR"] = cache
        jobs = 2
        seconds = whole(sizes, seeds, jobs)
        print(
            f"{2 * len(sizes) * seeds} runs in {jobs} processes: {seconds:.1f} s"
            + (", all compiled anew" if options.cold else "")
        )
    if options.cold:
        return
    print(f"{'':12}{'modules':>9}{'sweep s':>10}{'floor s':>10}{'ratio':>8}")
    for rule in RULES:
        for size in sizes:
            pairs = [processor(size, seeds, rule) for _ in range(times)]
            mine, floor = (statistics.median(column) for column in zip(*pairs, strict=True))
            print(f"{rule:12}{size:>9}{mine:>10.2f}{floor:>10.2f}{mine / floor:>8.1f}")


if __name__ == "__main__":
    main()
