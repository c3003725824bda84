"""How the search for paths of parallel flips grows with the number of points.

With cubepath installed: ``python tests/bench/bench_flips.py [--quick] [--seconds S]``.

The first table is about pairs of triangulations of random points, both far from a sweep by random
flips: what one greedy path takes, in cubes and seconds, what `improve` makes of a detour over the
sweep, the lower bound, the ratio of the two, and the greatest memory of the process so far. The
second one is about listing flips: all that two fans, or two sweeps, can meet in some layers from
either end, and the microseconds that each of them takes.
"""

import argparse
import resource
import time
from collections.abc import Sequence
from random import Random

from cubepath.coordinator.theory.optimality.optimality_report import beyond
from cubepath.coordinator.theory.optimality.tasks import PathTask
from cubepath.protocol.core.actions import Action, State
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.scenes.families.triangulations import random_points
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.flips import FlipSystem
from cubepath.protocol.systems.point_sets import Triangles, edge_of

POINTS = (100, 300, 1000, 3000, 7000, 10_000)
FLIPS_A_POINT = 60
LISTED = ("polygon:n=20", "polygon:n=40", "triangulation:n=80", "triangulation:n=320")
LAYERS = 4


def far_from_the_sweep(system: FlipSystem, random: Random) -> frozenset[Site]:
    """Return a triangulation that is many random flips away from the sweep to the right."""
    triangles = Triangles(system.plane.points, system.plane.sweep("right"))
    edges = sorted(edge for edge in triangles.edges() if edge not in system.kept)
    for _ in range(FLIPS_A_POINT * len(system.plane.points)):
        place = random.randrange(len(edges))
        if triangles.convex(edges[place]):
            _, d, _, c = corners = triangles.corners(edges[place])
            triangles.flip(corners)
            edges[place] = edge_of(c, d)
    return frozenset(triangles.edges())


def first_path(system: FlipSystem, start: State, goal: State) -> Sequence[Action]:
    """Return the first path that the system's own search finds."""
    search = system.paths(start, goal, seed=1)
    if search is None:
        raise SystemExit("no search: the coordinates span too much")
    return next(path for path in search if path is not None)


def grown(sizes: Sequence[int], seconds: float) -> None:
    """Print the table of paths."""
    print("| points | first | in | detour | cubes | improved | lower bound | ratio | s | MB |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for size in sizes:
        system = FlipSystem(random_points(size, size))
        system.prepare_paths()
        random = Random(size)
        start, goal = (far_from_the_sweep(system, random) for _ in range(2))
        began = time.perf_counter()
        first = first_path(system, start, goal)
        took = time.perf_counter() - began
        rounds = beyond(PathTask(first, start, system, end=goal), iterations=0)
        sweep = system.plane.sweep("right")
        detour = (*first_path(system, start, sweep), *first_path(system, sweep, goal))
        began = time.perf_counter()
        task = PathTask(detour, start, system, end=goal)
        known = beyond(task, seconds=seconds, seed=1)
        spent = time.perf_counter() - began
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        print(
            f"| {size} | {rounds.improved} | {took:.2f} | {len(detour)} |"
            f" {len(beyond(task, iterations=0).cube_path)} | {known.improved}"
            f" | {known.lower_bound} | {(known.improved or 0) / max(1, known.lower_bound):.2f}"
            f" | {spent:.0f} | {memory} |",
            flush=True,
        )


def listed(specs: Sequence[str], layers: int) -> None:
    """Print the table of flips that are met."""
    print("\n| scene | layers | edges | flips | seconds | µs a flip |")
    print("|---|---|---|---|---|---|")
    for spec in specs:
        scene = scene_from_spec(spec)
        edges = flips = 0
        began = time.perf_counter()
        for end in (scene.start_state, {*(scene.goal or ()), *scene.system.filled}):
            discover = scene.system.discovery() or scene.system.moves_at
            met, new = set[Site](), set(end)
            for _ in range(layers + 1):
                met |= new
                found = [move for site in in_order(new) for move in discover(site)]
                new = {site for move in found for site in move.action.trace} - met
                flips += len(found)
            edges += len(met)
        took = time.perf_counter() - began
        print(f"| {spec} | {layers} | {edges} | {flips} | {took:.2f} | {took / flips * 1e6:.0f} |")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small inputs, a second each")
    parser.add_argument("--seconds", type=float, default=60.0, help="for each improvement")
    options = parser.parse_args()
    grown(POINTS[:2] if options.quick else POINTS, 1.0 if options.quick else options.seconds)
    listed(LISTED[::2] if options.quick else LISTED, LAYERS)


if __name__ == "__main__":
    main()
