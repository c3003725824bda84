"""Exploring states and building cubes: states and cubes a second, and bytes a cell, as they grow.

Floor: one compiled pass over the arrays that were built, reading every face once. The obvious
enumeration of tests/oracles/complexes.py stands beside it as far as it goes in a few seconds.
"""

import argparse
import sys
from pathlib import Path
from statistics import median
from time import process_time

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from cubepath.coordinator.theory.complexes.exploration import explore
from cubepath.coordinator.theory.complexes.links import check_links
from cubepath.coordinator.theory.complexes.state_complexes import (
    StateComplex,
    f_vector,
    state_complex,
)
from cubepath.protocol.compiled import allowance
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles import complexes

ARMS = [f"arm:n={count}" for count in range(12, 19)]
HEXAGONS = [f"hex:n={count},base=1" for count in (4, 5, 6, 7, 8, 9)]
VEHICLES = [
    *("agv:graph=grid4x4,n=4", "agv:graph=grid5x5,n=4", "agv:graph=grid6x6,n=4"),
    "agv:graph=grid5x5,n=5",
]
SPECS = [*ARMS, *HEXAGONS, *VEHICLES]
OBVIOUS_MOST = 3_000
STATES_MOST = 10_000_000
LINKS_MOST = 5_000_000
"""Cells up to which links are checked too."""


def floor(built: StateComplex) -> float:
    """Return the seconds of one pass over all faces."""
    began = process_time()
    for faces in built.complex.faces:
        np.add.reduce(faces, axis=None)
    return max(process_time() - began, 1e-6)


def timed(scene: Scene) -> tuple[tuple[float, float, float], tuple[int, ...], StateComplex]:
    """Return the seconds for states, counts and cells, the counts, and the complex."""
    began = process_time()
    explored = explore(scene, max_states=STATES_MOST)
    walked = process_time()
    counted = f_vector(explored)
    after = process_time()
    built = state_complex(explored)
    done = process_time()
    return (walked - began, after - walked, done - after), counted, built


def measure(spec: str, repeat: int) -> None:
    """Print one row."""
    scene = scene_from_spec(spec)
    first, counted, built = timed(scene)
    walks, counts, builds = zip(first, *(timed(scene)[0] for _ in range(repeat - 1)), strict=True)
    cells = sum(counted)
    least = median(floor(built) for _ in range(5))
    links = "-"
    if cells <= LINKS_MOST:
        began = process_time()
        check_links(built.complex)
        links = f"{process_time() - began:.2f}"
    obvious = "-"
    if counted[0] <= OBVIOUS_MOST:
        began = process_time()
        complexes.f_vector(scene)
        obvious = f"{(process_time() - began) / (median(walks) + median(counts)):.0f}"
    total = median(walks) + median(builds)
    print(
        f"{spec:<24} {counted[0]:>9,} {cells:>11,} {len(counted) - 1:>4}"
        f" {counted[0] / median(walks):>12,.0f} {cells / median(builds):>12,.0f}"
        f" {built.memory / cells:>7.1f} {total:>8.2f} {total / least:>7.1f} {links:>7}"
        f" {obvious:>8}",
        flush=True,
    )


def main() -> None:
    """Measure every system at growing sizes."""
    allowance.left = 0  # what is measured is compiled code, for small sizes too
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small sizes, each once")
    parser.add_argument("--repeat", type=int, default=3)
    options = parser.parse_args()
    specs = [*ARMS[:2], *HEXAGONS[:2], VEHICLES[0]] if options.quick else SPECS
    measured = explore(scene_from_spec("arm:n=6"))  # compiles
    check_links(state_complex(measured).complex)
    f_vector(measured)
    print(
        f"{'system':<24} {'states':>9} {'cells':>11} {'dim':>4} {'states/s':>12} {'cubes/s':>12}"
        f" {'B/cell':>7} {'cpu s':>8} {'x floor':>7} {'links s':>7} {'obvious':>8}"
    )
    for spec in specs:
        measure(spec, 1 if options.quick else options.repeat)


if __name__ == "__main__":
    main()
