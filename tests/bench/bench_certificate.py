"""How long a certificate takes: building it, checking it, and earliest starts, beside the moves.

With cubepath installed: ``python tests/bench/bench_certificate.py [--quick]``.

Times are processor times of one thread. The floor is one pass over the same supports that touches
each site once in a dict. The growth exponent is that of the checker, the slope of log time over log
moves against the row before; linear is 1. ``deep`` goes out on a random walk and all the way back,
so that partners lie up to the whole path apart; ``readers`` are moves that all read one site.
Nothing is asserted.
"""

import argparse
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import partial

from bench_shorten import exponent, floor, random_walk, seconds

from cubepath.coordinator.normal_form.certificate import certificate_of
from cubepath.coordinator.normal_form.timetable import earliest
from cubepath.coordinator.verification.proof import check_proof
from cubepath.protocol.core.actions import Action
from cubepath.protocol.path_files.certificates import Certificate

SIZES = (10_000, 20_000, 50_000, 100_000)
QUICK_SIZES = (1_000, 2_000)


def deep(walk: Sequence[Action], moves: int) -> list[Action]:
    """Return half a walk and the way back, but for the last step."""
    half = list(walk[: moves // 2])
    return half + half[:0:-1]


def readers(moves: int) -> list[Action]:
    """Return moves that read one site, each there and back, the last partner far from the first."""
    there = [Action(["hub", n], [n], [n], []) for n in range(moves // 2)]
    return there + there


def check(path: Sequence[Action], found: Certificate) -> None:
    """Check a certificate, which holds."""
    why = check_proof(path, found.cancelled, found.cubes, found.chain)
    if any(why.values()):
        raise AssertionError(why)


def rows(name: str, paths: Callable[[int], Sequence[Action]], sizes: Sequence[int]) -> None:
    """Print a line for each size."""
    before: tuple[int, float] | None = None
    for size in sizes:
        path = paths(size)
        found = certificate_of(path)
        durations = [Fraction(1 + n % 3, 2) for n in range(len(path))]
        building = seconds(partial(certificate_of, path), 3)
        checking = seconds(partial(check, path, found), 3)
        timing = seconds(partial(earliest, path, durations), 3)
        least = seconds(partial(floor, path), 3)
        each = [f"{took / len(path) * 1e6:6.2f}" for took in (building, checking, timing)]
        print(
            f"{name:<12} {len(path):>8} {len(found.cancelled):>8} {len(found.cubes):>8}"
            f"  {'  '.join(each)}  {checking / least:7.1f}  {exponent((size, checking), before)}"
        )
        before = size, checking


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="small sizes")
    sizes = QUICK_SIZES if parser.parse_args().quick else SIZES
    walk = random_walk("hex:n=40", sizes[-1])
    print("path            moves    pairs    cubes   build   check   times  x floor  growth")
    print("                                        us a move, of one thread")
    rows("walk", lambda moves: walk[:moves], sizes)
    rows("deep", partial(deep, walk), sizes)
    rows("readers", readers, sizes)


if __name__ == "__main__":
    main()
