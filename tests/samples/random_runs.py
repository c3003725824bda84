"""Runs of modules that move at random: the scene, the moves, and where modules were."""

import numpy as np

from cubepath.agents.environments.world import World
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec

Rounds = list[list[Action]]
SPECS = ["hex:n=6", "arm:n=6", "agv:graph=grid4x4,n=5", "agv-labelled:graph=C6,n=3", "agv:graph=K5"]


def random_run(spec: str, count: int) -> tuple[Scene, Rounds, list[tuple[Site, ...]]]:
    """Return the scene, the actions of each round, and where modules were after each."""
    scene = scene_from_spec(spec)
    world, random = World(scene, seed=2), np.random.default_rng(2)
    rounds, where = [], [tuple(world.sites)]
    for _ in range(count):
        masks = [world.observe(module)["action_mask"] for module in range(len(world.sites))]
        chosen = {
            module: int(random.choice(mask.nonzero()[0])) for module, mask in enumerate(masks)
        }
        rounds.append([move.action for move in world.step(chosen).moves.values()])
        where.append(tuple(world.sites))
    return scene, rounds, where
