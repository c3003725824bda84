"""Vehicles replanned: routes a second and their growth, and the rounds left over time.

With cubepath installed: ``python tests/bench/bench_vehicles.py [--quick] [--seconds S]``.

The crowd is 600 vehicles on a grid of 32 x 32 that have wandered for 60,000 moves from seed 1, see
`large_fleets.wandering`; each is to go from where it started to where it is then. The first table
has crowds of other sizes, by the same recipe with 100 moves a vehicle, and how many routes a second
the conflict optimizer plans there, in processor time. The second has the rounds of the crowd, and
of 160 vehicles of CG:SHOP 2021, after so many seconds of improvement, without the conflict
optimizer and with it, and their lower bound.
``--write FILE`` writes the crowd as a scenario, for `cubepath improve FILE --seconds 60`.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from random import Random

from large_fleets import wandering, write_scenario

from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.coordinator.theory.optimality.optimality_report import beyond
from cubepath.coordinator.theory.optimality.tasks import task_of
from cubepath.coordinator.theory.search import vehicle_lns

DATA = Path(__file__).parents[1] / "data" / "agv"
SIDE, VEHICLES, MOVES, SEED = 32, 600, 60_000, 1
TIMES = (5, 15, 30, 60, 120, 300, 600)


def crowd(target: Path, vehicles: int, moves: int, side: int = SIDE) -> None:
    """Write the crowd as a scenario."""
    starts, rounds = wandering(moves, side=side, vehicles=vehicles, seed=SEED)
    write_scenario(target, starts, rounds, side)


def rate(scenario: Path, seconds: float) -> tuple[int, int, float]:
    """Return vehicles, rounds in the end, and routes a second of processor time.

    Rounds are cut until the time is up, or the plan is at the longest way of a vehicle.
    """
    found = shorten(scenario)
    task = task_of(found)
    system = task.system
    assert system is not None
    assert system.graph is not None
    plan = vehicle_lns.Replanner(
        system, system.graph, task.start, found.cube_path, labelled_goals=True
    )
    random = Random(SEED)
    routes = 0
    began = time.process_time()
    while time.process_time() < began + seconds:
        plan.repair(random)
        if not plan.routes:
            break
        routes += plan.routes
    return len(task.start), plan.rounds, routes / (time.process_time() - began)


def course(scenario: Path, seconds: float, share: float) -> Iterator[tuple[float, int]]:
    """Yield when how few rounds were reached, and last of all the bound, at no time."""
    kept, vehicle_lns.REPAIRS = vehicle_lns.REPAIRS, share
    found = shorten(scenario)
    log: list[tuple[float, int]] = []
    began = time.monotonic()
    known = beyond(
        task_of(found),
        found,
        seconds=seconds,
        seed=SEED,
        watch=lambda better: log.append((time.monotonic() - began, better.cubes)),
    )
    vehicle_lns.REPAIRS = kept
    yield from [(0.0, found.cubes), *log, (0.0, known.lower_bound)]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small crowds, a second each")
    parser.add_argument("--seconds", type=float, default=60.0, help="for each improvement")
    parser.add_argument("--write", type=Path, help="write the crowd there, and do nothing else")
    options = parser.parse_args()
    if options.write is not None:
        crowd(options.write, VEHICLES, MOVES)
        return
    seconds = 1.0 if options.quick else options.seconds
    vehicle_lns.prepare()
    with tempfile.TemporaryDirectory() as folder:
        print("| vehicles | moves | rounds | routes a second |")
        print("|---|---|---|---|")
        for vehicles in (20, 40) if options.quick else (75, 150, 300, 600):
            moves = 100 * vehicles
            scenario = Path(folder) / f"{vehicles}.json"
            crowd(scenario, vehicles, moves)
            count, rounds, speed = rate(scenario, seconds / 10)
            print(f"| {count} | {moves} | {rounds} | {speed:.0f} |", flush=True)
        times = [1.0] if options.quick else [each for each in TIMES if each <= seconds]
        print(f"\n| plan | search | {' | '.join(f'{each:.0f} s' for each in times)} | bound |")
        print("|---|---|" + "---|" * (len(times) + 1))
        whole = Path(folder) / "crowd.json"
        crowd(whole, *((40, 2000) if options.quick else (VEHICLES, MOVES)))
        for name, path in (("crowd", whole), ("algae", DATA / "cgshop2021-algae.json")):
            for how, share in (("neighbourhoods", 0.0), ("both", vehicle_lns.REPAIRS)):
                *log, (_, bound) = course(path, seconds, share)
                cells = [min(cubes for when, cubes in log if when <= each) for each in times]
                print(f"| {name} | {how} | {' | '.join(map(str, cells))} | {bound} |", flush=True)


if __name__ == "__main__":
    main()
