"""How far paths are from the best there is: what shortening, another class and proof each give.

With cubepath and its extra `proofs`: ``python tests/bench/bench_improve.py [--quick] [--prove S]``.

Prints the table of docs/instances.md with more columns: plans of other planners, triangulations as
CG:SHOP 2026 has them, and a long random walk of every local system. `rounds` is the planner's own
count where one is known: for the vehicles a follower may enter what another leaves in the same
round, which no cube allows. `seconds` is what improvement, bounds and exhaustive search took
together. Where the lower bound is met, the path is as short as any; elsewhere ``--prove`` goes on,
and the last three columns have what it finds and proves, or what is left open.
"""

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import NamedTuple

from cubepath.coordinator.normal_form.heap import Heap
from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.coordinator.theory.optimality.optimality_report import beyond
from cubepath.coordinator.theory.optimality.tasks import PathTask, task_of
from cubepath.coordinator.theory.search.transitions import Potential, Transitions
from cubepath.protocol.core.actions import Action, apply_in_place
from cubepath.protocol.core.sites import Site
from cubepath.protocol.scenes.families.triangulations import random_points
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.flips import FlipSystem
from cubepath.protocol.systems.graphs import scenario_from_json

DATA = Path(__file__).parents[1] / "data" / "agv"
PLANS = ("grid8-12agents", "random-32-32-10-30agents", "cgshop2021-algae")
POINTS = (10, 15, 20, 30, 40, 60, 160)
SYSTEMS = (
    "agv:graph=grid8x8,n=10",
    "agv-labelled:graph=grid6x6,n=6",
    "hex:n=12",
    "hex-open:n=8",
    "sliding:p=3,q=2,n=4",
    "arm:n=10",
    "arm-free:n=8",
    "arms",
    "polygon:n=16",
    "triangulation:n=20",
    "words:presentation=free2",
    "assembly:n=4",
)
WALK = 2000
QUICK_WALK = 200


class Case(NamedTuple):
    """A path to be looked at: what it has to do, how many moves it has, the planner's rounds."""

    name: str
    task: PathTask
    moves: int
    rounds: int | None = None


def plans(names: tuple[str, ...]) -> Iterator[Case]:
    """Yield the plans of other planners; each vehicle keeps its goal."""
    for name in names:
        path = DATA / f"{name}.json"
        found = shorten(path)
        yield Case(name, task_of(found), found.moves, scenario_from_json(path).planner_rounds)


def triangulations(sizes: tuple[int, ...]) -> Iterator[Case]:
    """Yield pairs of random triangulations of random points, and a planner's way between them.

    Both come from a sweep by 20 random flips a point. The planner flips one edge after another,
    always one that lessens the crossings with the goal most.
    """
    for count in sizes:
        system = FlipSystem(random_points(count, count))
        steps = Transitions(system)
        base = steps.encode({*system.plane.sweep("right")})
        random = Random(count)
        ends: list[int] = []
        for _ in range(2):
            state = base
            for _ in range(20 * count):
                state ^= steps.toggle[random.choice(steps.possible(state))]
            ends.append(state)
        state, goal = ends
        potential = Potential(steps, state, goal)
        path: list[Action] = []
        while state != goal:
            here = state
            best = min(steps.possible(state), key=lambda each: potential.change(each, here))
            state ^= steps.toggle[best]
            path.append(steps.actions[best])
        task = PathTask(tuple(path), steps.decode(ends[0]), system)
        yield Case(f"triangulations of {count} points", task, len(path))


def walks(specs: tuple[str, ...], moves: int) -> Iterator[Case]:
    """Yield a random walk of each system from its start."""
    for spec in specs:
        scene = scene_from_spec(spec)
        state: set[Site] = set(scene.start_state)
        steps = Transitions(scene.system)
        random = Random(spec)
        path: list[Action] = []
        for _ in range(moves):
            path.append(steps.actions[random.choice(steps.possible(steps.encode(state)))])
            apply_in_place(path[-1], state)
        task = PathTask(tuple(path), scene.start_state, scene.system)
        yield Case(f"walk of {spec}", task, len(path))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small inputs, a second each")
    parser.add_argument("--seconds", type=float, default=10.0, help="for each improvement")
    parser.add_argument("--prove", type=float, default=60.0, help="seconds, for each proof")
    parser.add_argument("--only", default="", help="rows whose names hold this text")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    seconds = 1.0 if options.quick else options.seconds
    most = 2.0 if options.quick else options.prove
    paths = [
        *plans(PLANS[:1] if options.quick else PLANS),
        *triangulations(POINTS[:2] if options.quick else POINTS),
        *walks(SYSTEMS, QUICK_WALK if options.quick else WALK),
    ]
    titles = [
        "path",
        "moves",
        "reduced",
        "rounds",
        "cubes",
        "improved",
        "bound",
        "by",
        "seconds",
        "optimum",
        "by",
        "seconds",
    ]
    print(f"| {' | '.join(titles)} |")
    print("|---" * len(titles) + "|")
    for name, task, moves, rounds in paths:
        if options.only not in name:
            continue
        heap = Heap()
        heap.extend(task.path)
        began = time.perf_counter()
        known = beyond(task, seconds=seconds, seed=options.seed)
        took = time.perf_counter() - began
        row = [name, moves, heap.reduced_moves, rounds or "", heap.cubes, known.improved]
        row += [known.lower_bound, known.why, f"{took:.1f}"]
        if not known.optimal:
            began = time.perf_counter()
            known = beyond(task, prove=most, seed=options.seed)
            took = time.perf_counter() - began
        found = f"**{known.improved}**"
        if not known.optimal:
            found = f"{known.agreed or known.lower_bound} to {known.improved}"
        print(f"| {' | '.join(map(str, [*row, found, known.why, f'{took:.1f}']))} |", flush=True)


if __name__ == "__main__":
    main()
