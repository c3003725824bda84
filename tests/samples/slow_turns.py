"""Runs of `compression` without rounds, in which turns take time."""

import random
from heapq import heapify, heappop, heappush

from cubepath.agents.environments.free_world import FreeWorld
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.compression import COMPRESSION
from cubepath.agents.rules.rule import Choice
from cubepath.protocol.scenes.specs import scene_from_spec
from samples.compressed import Shape, at_origin

_BETWEEN = 0.25
"""How long it is from one look at the shape to the next."""


def shapes_in_turns(
    count: int, latency: float, *, end: float, seed: int
) -> tuple[list[Shape], float]:
    """Return the shapes at regular times, and the share of attempts that was refused.

    A module waits, sees what is around it and chooses, and makes its attempt some time later. The
    keeper refuses that if a cell of the support has changed. Waits and turns are drawn from
    exponential distributions with the means 1 and `latency`; `end` is in mean waits.
    """
    scene = scene_from_spec(f"compression:n={count}")
    world = FreeWorld(scene, seed=seed)
    actors = actors_for(scene, COMPRESSION, seed=seed, hesitate=0.0, clock="free")
    times = random.Random(seed)  # noqa: S311 - a run, no secret
    due: list[tuple[float, int, Choice | None]] = [
        (times.expovariate(1), module, None) for module in actors
    ]
    heapify(due)
    shapes: list[Shape] = []
    asked = refused = 0
    while len(shapes) * _BETWEEN < end:
        now, module, choice = heappop(due)
        while len(shapes) * _BETWEEN < now:
            shapes.append(at_origin(world.sites))
        if choice is None:
            choice = actors[module].act(world.look(module))
            heappush(due, (now + times.expovariate(1 / latency), module, choice))
        else:
            acted = world.act(module, choice)
            asked += acted.asked
            refused += bool(acted.why)
            heappush(due, (now + times.expovariate(1), module, None))
    return shapes, refused / max(asked, 1)
