"""The compiled world beside the plain one, held together step by step."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays.batch import Batch
from cubepath.agents.arrays.rounds import GRANTED, LOST
from cubepath.agents.environments.world import World
from cubepath.protocol.core.system import Scene


class Counted(NamedTuple):
    """What happened while the two were held together."""

    moves: int
    lost: int
    batch: Batch


def together(
    scene: Scene,
    seeds: Sequence[int],
    rounds: int,
    *,
    note_length: int = 0,
    eager: float = 0.9,
    batch: Batch | None = None,
) -> Counted:
    """Play random actions in a batch and in plain worlds; fail at the first difference.

    A few of the actions are not legal, some not even integers of any slot.
    """
    batch = Batch(scene, len(seeds), note_length=note_length) if batch is None else batch
    batch.reset(seeds)
    batch.observe()
    worlds = [World(scene, seed=seed, note_length=note_length) for seed in seeds]
    random = np.random.default_rng(seeds[0])
    moves = lost = 0
    for _ in range(rounds):
        held(batch, worlds)
        mask = batch.observed.mask
        actions = np.where(mask, random.random(mask.shape), -1.0).argmax(2).astype(np.int64)
        wild = random.random(actions.shape) > eager
        actions[wild] = random.integers(-2, mask.shape[2] + 2, int(wild.sum()))
        speaks = random.random(actions.shape) < 0.3
        notes = random.integers(-9, 9, (*actions.shape, note_length), dtype=np.int32)
        outcomes = batch.step(actions, spoken=(speaks, notes))
        for number, world in enumerate(worlds):
            said = {
                module: tuple(notes[number, module].tolist())
                for module in np.flatnonzero(speaks[number]).tolist()
                if note_length
            }
            played = world.step(dict(enumerate(actions[number].tolist())), said)
            assert list(played.moves) == np.flatnonzero(outcomes[number] == GRANTED).tolist()
            assert list(played.lost) == np.flatnonzero(outcomes[number] == LOST).tolist()
            moves += len(played.moves)
            lost += len(played.lost)
    held(batch, worlds)
    return Counted(moves, lost, batch)


def held(batch: Batch, worlds: Sequence[World]) -> None:
    """Fail if the two differ in where modules are or in what they observe."""
    scene, observed = batch.scene, batch.observed
    arrays: dict[str, NDArray[Any]] = {
        "observation": observed.observation,
        "action_mask": observed.mask,
        "notes": observed.notes,
    }
    for number, world in enumerate(worlds):
        assert batch.sites(number) == list(world.sites)
        assert batch.round[number] == world.round
        assert bool(batch.reached[number]) == scene.reached(world.sites)
        at_goal = sum(site in (scene.goal or ()) for site in world.sites)
        assert batch.at_goal[number] == at_goal
        for module in range(len(scene.start)):
            seen = world.observe(module)
            for key, array in arrays.items():
                if key in seen:
                    assert seen[key].tolist() == array[number, module].tolist(), (key, module)
