"""How long comparing two runs takes, against decoding both.

    python tests/bench/bench_diff.py [--quick]

Recordings are made of 60 vehicles that move at random, in one process, with parts in batches: one
with a seed, and one with another, which part in the first rounds. Times are processor times of one
thread, medians of three, in seconds: ``same`` compares a recording with a copy of itself, ``other``
with the run of the other seed. The floor decodes every message of both recordings once, in the same
run. Memory is the greatest that Python has allocated meanwhile, measured in a run of its own, in
bytes a part of both. The growth exponent is the slope of log time of ``other`` over log parts
against the row before; linear is 1. Nothing is asserted.
"""

import argparse
import shutil
import sys
from functools import partial
from math import log
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from cubepath.coordinator.tools.comparison.run_comparison import diff
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.messages import decode

sys.path += [str(Path(__file__).parents[1]), str(Path(__file__).parent)]
from bench_recording import floor, peak, seconds

from samples.long_runs import write

SPEC = "agv:graph=grid10x10,n=60"
SIZES = (10_000, 30_000)
QUICK_SIZES = (2_000, 5_000)
_TIMES = 3
_WIDTHS = (10, 8, 8, 8, 12, 12, 8, 10)


def row(folder: Path, parts: int) -> tuple[int, float, float, float, int]:
    """Return the number of parts of both recordings, the times, and the memory of ``other``."""
    scene = scene_from_spec(SPEC)
    one, two, copy = (folder / f"{name}.mcap" for name in ("one", "two", "copy"))
    count = sum(write(path, scene, parts, seed=seed) for seed, path in enumerate((one, two)))
    shutil.copy(one, copy)

    def least() -> None:
        floor(one, decode)
        floor(two, decode)

    diff(one, two)  # what is loaded and compiled once does not count
    works = least, partial(diff, one, copy), partial(diff, one, two)
    bare, same, other = (median(seconds(work) for _ in range(_TIMES)) for work in works)
    return count, bare, same, other, peak(works[2])


def main() -> None:
    """Print a row for each size."""
    parser = argparse.ArgumentParser(description="comparing two runs, in times of decoding both")
    parser.add_argument("--quick", action="store_true", help="small recordings")
    quick: bool = parser.parse_args().quick
    names = ("parts", "floor", "same", "other", "same/floor", "other/floor", "growth", "bytes")
    print(*(f"{name:>{width}}" for name, width in zip(names, _WIDTHS, strict=True)))
    before: tuple[int, float] | None = None
    with TemporaryDirectory() as folder:
        for parts in QUICK_SIZES if quick else SIZES:
            count, bare, same, other, most = row(Path(folder), parts)
            growth = "" if before is None else f"{_growth(before, (count, other)):.2f}"
            before = count, other
            cells = (
                str(count),
                f"{bare:.3f}",
                f"{same:.3f}",
                f"{other:.3f}",
                f"{same / bare:.2f}",
                f"{other / bare:.2f}",
                growth,
                f"{most / count:.0f}",
            )
            print(*(f"{cell:>{width}}" for cell, width in zip(cells, _WIDTHS, strict=True)))
            for path in Path(folder).iterdir():
                path.unlink()


def _growth(before: tuple[int, float], now: tuple[int, float]) -> float:
    return log(now[1] / before[1]) / log(now[0] / before[0])


if __name__ == "__main__":
    main()
