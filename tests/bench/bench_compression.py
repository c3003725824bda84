"""How near `compression` is to its distribution without rounds, by how long a turn takes.

    python tests/bench/bench_compression.py [--quick] [--latency L] [--time T]

A module waits for a time that is drawn from the exponential distribution with mean 1, sees what is
around it, and attempts its step a fixed latency later; the keeper refuses that if a cell of the
support has changed meanwhile. Shapes of four modules are looked at at regular times. The total
variation from the exact shares is up to symmetry, with a 95% interval; that of the same number of
shapes of rounds is beside it, as the floor: rounds have the exact shares.
"""

from __future__ import annotations

import argparse
import random
from heapq import heapify, heappop, heappush

from tqdm import tqdm

from cubepath.agents.environments.free_world import FreeWorld
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.compression import COMPRESSION
from cubepath.agents.rules.rule import Choice
from cubepath.protocol.scenes.specs import scene_from_spec
from samples.compressed import Shape, at_origin, distance

LATENCIES = (0.02, 0.1, 0.5)
_BETWEEN = 0.25
"""How long it is from one look at the shape to the next."""


def sampled(latency: float, end: float, seed: int) -> tuple[list[Shape], float]:
    """Return the shapes of a run at regular times, and the share of attempts that was refused."""
    scene = scene_from_spec("compression:n=4")
    world = FreeWorld(scene, seed=seed)
    actors = actors_for(scene, COMPRESSION, seed=seed, hesitate=0.0, clock="free")
    waits = random.Random(seed)
    due: list[tuple[float, int, Choice | None]] = [
        (waits.expovariate(1), module, None) for module in actors
    ]
    heapify(due)
    shapes: list[Shape] = []
    asked = refused = 0
    with tqdm(total=round(end), desc=f"latency {latency:g}", mininterval=10) as bar:
        while len(shapes) * _BETWEEN < end:
            now, module, choice = heappop(due)
            while len(shapes) * _BETWEEN < now:
                shapes.append(at_origin(world.sites))
            if choice is None:
                choice = actors[module].act(world.look(module))
                heappush(due, (now + latency, module, choice))
                continue
            acted = world.act(module, choice)
            asked += acted.asked
            refused += bool(acted.why)
            heappush(due, (now + waits.expovariate(1), module, None))
            bar.update(round(now) - bar.n)
    return shapes, refused / max(asked, 1)


def main() -> None:
    """Print a row for each latency."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a short run of each")
    parser.add_argument("--latency", type=float, action="append", help="instead of the three")
    parser.add_argument("--time", type=float, default=40_000, help="in mean waits")
    asked = parser.parse_args()
    end = 200 if asked.quick else asked.time
    print(f"{'latency':>8} {'refused':>8}  total variation", flush=True)
    for latency in asked.latency or LATENCIES:
        shapes, refused = sampled(latency, end, seed=1)
        print(f"{latency:8g} {refused:8.4f}  {distance([shapes], bias=4.0)}", flush=True)


if __name__ == "__main__":
    main()
