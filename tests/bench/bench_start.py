"""How long a first use takes against the second, and how long an environment takes to start.

    python tests/bench/bench_start.py [--quick]

A pair is the same command twice with caches that are empty at first, those of numba and matplotlib
and the home folder; the ratio is that of the median times of first and second. Python's own byte
code is there in both, as an installation leaves it. The floor of an environment's start is a bare
`import numpy, pettingzoo, gymnasium` in the same run; the two alternate, in processor time and in
time on the clock. Whether numba was imported or compiled anything shows in the number of files that
the first command left in the caches.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from tqdm import tqdm

GOLDEN = Path(__file__).parents[2] / "logs" / "golden" / "hex-5.mcap"
FLOOR = "import numpy, pettingzoo, gymnasium"
RESET = "from cubepath.agents import parallel_env\nparallel_env('hex:n=7').reset()"
LONG = 200_000
"""Moves of a path that is long enough to be compiled."""


class Took(NamedTuple):
    """Seconds on the clock, and of processor time, children included."""

    clock: float
    processor: float


def took(arguments: Sequence[str], folder: Path) -> Took:
    """Carry out a Python command line with all of its caches in the folder."""
    caches = ("NUMBA_CACHE_DIR", "HOME", "XDG_CACHE_HOME", "MPLCONFIGDIR")
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=os.environ | dict.fromkeys(caches, str(folder / "cache")),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        check=True,
    )
    clock, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Took(clock, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def median(times: Sequence[Took]) -> Took:
    """Return the medians."""
    clock, processor = zip(*times, strict=True)
    return Took(statistics.median(clock), statistics.median(processor))


def long_path(path: Path) -> None:
    """Write a moves file that is long enough to be compiled."""
    lines = [
        json.dumps({"id": place, "support": [place, place + 1], "trace": [place, place + 1]})
        for place in range(100)
    ]
    path.write_text(("\n".join(lines) + "\n") * (LONG // len(lines)))


def pairs(name: str, arguments: Sequence[str], count: int) -> None:
    """Print how long a command takes at first and then."""
    first, second, files = [], [], 0
    for _ in range(count):
        with TemporaryDirectory() as made:
            folder = Path(made)
            if "long.jsonl" in arguments:
                long_path(folder / "long.jsonl")
            first.append(took(arguments, folder))
            files = sum(each.is_file() for each in (folder / "cache").rglob("*"))
            second.append(took(arguments, folder))
    one, other = median(first), median(second)
    print(
        f"{name:<28}{one.clock:>10.2f}{other.clock:>10.2f}{one.clock / other.clock:>8.2f}"
        f"{one.processor:>12.2f}{other.processor:>10.2f}{files:>8}",
        flush=True,
    )


def start(count: int) -> None:
    """Print how long an environment takes to its first reset."""
    ours, floor = [], []
    for _ in range(count):
        with TemporaryDirectory() as made:
            ours.append(took(["-c", RESET], Path(made)))
            floor.append(took(["-c", FLOOR], Path(made)))
    one, bare = median(ours), median(floor)
    print(f"\n{'environment, first reset':<28}{'s':>10}{'floor s':>10}{'ratio':>8}")
    for name, mine, least in zip(("clock", "processor"), one, bare, strict=True):
        print(f"{name:<28}{mine:>10.2f}{least:>10.2f}{mine / least:>8.2f}")


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--quick", action="store_true", help="fewer commands and pairs")
    quick = options.parse_args().quick
    commands = {
        "run": ("run",),
        "run hex:n=30": ("run", "hex:n=30"),
        "shorten a recording": ("shorten", str(GOLDEN)),
        "verify a recording": ("verify", str(GOLDEN)),
        "replay a recording": ("replay", str(GOLDEN)),
        f"shorten {LONG:,} moves": ("shorten", "long.jsonl"),
        "complex agv:graph=K5,n=2": ("complex", "agv:graph=K5,n=2"),
    }
    columns = f"{'first s':>10}{'second s':>10}{'ratio':>8}{'first cpu s':>12}{'second':>10}"
    print(f"{'command':<28}{columns}{'files':>8}")
    chosen = list(commands.items())[: 3 if quick else None]
    for name, arguments in tqdm(chosen, disable=None, leave=False, file=sys.stderr):
        pairs(name, ("-m", "cubepath.coordinator", *arguments), 1 if quick else 5)
    start(1 if quick else 9)


if __name__ == "__main__":
    main()
