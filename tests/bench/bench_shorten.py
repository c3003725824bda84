"""How long shortening takes: the compiled heap, its reference, and TimeGeodesic as printed.

With cubepath installed: ``python tests/bench/bench_shorten.py [--quick] [--budget SECONDS]``. All
three take the moves as objects; what the compiled heap does with numbers is in `bench_scale.py`.

Times are processor times, of one thread. The floor is one pass over the same supports that touches
each site once in a dict: no algorithm that looks at every site of every move can do without it.
The growth exponent is the slope of log time over log moves against the row before; linear is 1.
Nothing is asserted.
"""

import argparse
import gc
import math
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from random import Random
from statistics import median

from cubepath.coordinator.normal_form.compiled_heap import FastHeap
from cubepath.coordinator.normal_form.heap import Heap
from cubepath.coordinator.theory.paper.algorithms import CubePath, TimeGeodesic
from cubepath.protocol.compiled import allowance
from cubepath.protocol.core.actions import Action, admissible, apply_in_place
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site
from cubepath.protocol.scenes.specs import scene_from_spec

Make = Callable[[], Heap | FastHeap]

SEGMENTS = "segments"
"""The paper's worst case for TimeGeodesic: two vehicles go straight on, one after the other."""
SPECS = ("agv:graph=grid20x20,n=80", "hex-open:n=40", "hex:n=40", SEGMENTS)
SIZES = (10_000, 20_000, 50_000, 100_000)
QUICK_SIZES = (1_000, 2_000)
PRINTED_SIZES = tuple(125 * 2**power for power in range(12))


def random_walk(spec: str, moves: int, seed: int = 1) -> list[Action]:
    """Return a walk of randomly chosen modules, each by a randomly chosen admissible move."""
    scene = scene_from_spec(spec)
    random = Random(seed)
    state = set(scene.start_state)
    modules: list[Site] = list(scene.start)
    word: list[Action] = []
    while len(word) < moves:
        move = random.choice(scene.system.moves(random.choice(modules)))
        if move is None or not admissible(move.action, state):
            continue
        apply_in_place(move.action, state)
        word.append(move.action)
        _follow(modules, move)
    return word


def segments(moves: int) -> list[Action]:
    """Return the path of two perpendicular segments in a flat state complex."""
    return [
        Action([here, there], [here, there], [here], [there])
        for vehicle in range(2)
        for step in range(moves // 2)
        for here, there in [((vehicle, step), (vehicle, step + 1))]
    ]


def _follow(modules: list[Site], move: Move) -> None:
    places = [(modules.index(source), target) for source, target in move.motion]
    for number, target in places:
        modules[number] = target


def seconds(run: Callable[[], object], repeats: int) -> float:
    """Return the median processor time of a run: other users of the machine do not count in it.

    Garbage of earlier runs is out of the way, and what is there before the run, the moves above
    all, is frozen: the collector's walks over the input are not the algorithm's work. Its walks
    over what the algorithm makes are counted.
    """
    times: list[float] = []
    for _ in range(repeats):
        gc.collect()
        gc.freeze()
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
        gc.unfreeze()
    return median(times)


def floor(word: Iterable[Action]) -> dict[Site, int]:
    """Touch every site of every support once in a dict."""
    touched: dict[Site, int] = {}
    for action in word:
        for site in action.support:
            touched[site] = touched.get(site, 0) + 1
    return touched


def shorten(word: Iterable[Action], make: Make = Heap) -> Heap | FastHeap:
    """Shorten the path, the cube path included."""
    heap = make()
    heap.extend(word)
    heap.cube_path()
    return heap


def exponent(now: tuple[int, float], before: tuple[int, float] | None) -> str:
    """Return the growth exponent between two sizes, as a cell of the table."""
    if before is None:
        return "-"
    return f"{math.log(now[1] / before[1]) / math.log(now[0] / before[0]):.2f}"


def show(*cells: object) -> None:
    """Print one row of the table."""
    print("  ".join(f"{cell!s:>{width}}" for cell, width in zip(cells, _WIDTHS, strict=False)))


_WIDTHS = (12, 8, 8, 6, 7, 9, 8, 7, 6)
_HEAD = ("algorithm", "moves", "left", "cubes", "max dim", "cpu s", "us/move", "x floor", "growth")


Paths = Callable[[int], Sequence[Action]]
"""Gives the edge path of so many moves."""


def heap_rows(paths: Paths, sizes: Iterable[int], repeats: int, name: str, make: Make) -> None:
    """Time a heap at every size."""
    before: tuple[int, float] | None = None
    for size in sizes:
        moves = paths(size)
        heap = shorten(moves, make)
        took = seconds(partial(shorten, moves, make), repeats)
        least = seconds(partial(floor, moves), repeats)
        show(
            name,
            size,
            heap.reduced_moves,
            heap.cubes,
            heap.max_cube_dimension,
            f"{took:.4f}",
            f"{took / size * 1e6:.2f}",
            f"{took / least:.1f}",
            exponent((size, took), before),
        )
        before = size, took


def _keep(found: list[CubePath], moves: Sequence[Action]) -> None:
    found.append(TimeGeodesic([action] for action in moves))


def printed_rows(paths: Paths, sizes: Iterable[int], budget_s: float) -> None:
    """Time TimeGeodesic as printed, on cubes of one move, until the next size would take too long.

    The next size is foreseen by the growth so far. One run each: the budget is for the whole.
    """
    before: tuple[int, float] | None = None
    power = 2.0
    left = budget_s
    for size in sizes:
        foreseen = 0.0 if before is None else before[1] * (size / before[0]) ** power
        if foreseen > left:
            print(f"  TimeGeodesic stops here: {size} moves would take some {foreseen:.0f} s more")
            return
        moves = paths(size)
        found: list[CubePath] = []
        took = seconds(partial(_keep, found, moves), 1)
        path = found[0]
        least = seconds(partial(floor, moves), 3)
        show(
            "TimeGeodesic",
            size,
            sum(len(cube) for cube in path),
            len(path),
            max(len(cube) for cube in path),
            f"{took:.4f}",
            f"{took / size * 1e6:.2f}",
            f"{took / least:.1f}",
            exponent((size, took), before),
        )
        if before is not None:
            power = max(2.0, math.log(took / before[1]) / math.log(size / before[0]))
        before = size, took
        left -= took


def _beginning(word: Sequence[Action], moves: int) -> Sequence[Action]:
    return word[:moves]


def main() -> None:
    """Print one table for each system."""
    allowance.left = 0  # what is measured is compiled code, for small sizes too
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--budget", type=float, default=60.0, metavar="SECONDS")
    parser.add_argument("--quick", action="store_true", help="small sizes, one repeat")
    parser.add_argument("systems", nargs="*", default=SPECS, help=f"default: {' '.join(SPECS)}")
    given = parser.parse_args()
    sizes = QUICK_SIZES if given.quick else SIZES
    budget_s = min(given.budget, 2.0) if given.quick else given.budget
    for spec in given.systems:
        if spec == SEGMENTS:
            paths: Paths = segments
            what = "two perpendicular segments"
        else:
            paths = partial(_beginning, random_walk(spec, sizes[-1]))
            what = "random walk"
        word = paths(sizes[-1])
        support = sum(len(action.support) for action in word) / len(word)
        print(f"{spec}: {what}, {support:.0f} sites a support, {len(set(word))} actions")
        show(*_HEAD)
        repeats = 1 if given.quick else 3
        heap_rows(paths, sizes, repeats, "compiled", FastHeap)
        heap_rows(paths, sizes, repeats, "heap", Heap)
        printed_rows(paths, [size for size in PRINTED_SIZES if size <= sizes[-1]], budget_s)
        print()


if __name__ == "__main__":
    main()
