"""What is compiled once for an installation, compiled in two processes side by side.

Left to themselves, all workers would wait for the same compilation, each for its own. What they
compile is kept on disk, where the others find it.
"""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import Executor, wait
from typing import Any

import numpy as np

from cubepath.agents.arrays.warming import compile_world, is_compiled
from cubepath.agents.environments.environment import CubepathEnv
from cubepath.agents.rules.registry import rule_named
from cubepath.agents.rules.vector_actors import vector_actors_for
from cubepath.coordinator.experiments.setting import Batch
from cubepath.coordinator.normal_form.compiled_heap import PathCounter
from cubepath.protocol.compiled import PLAIN_STEPS, allowance
from cubepath.protocol.scenes.specs import scene_from_spec


def warm(executor: Executor, batches: Iterable[Batch]) -> None:
    """Let two workers compile what runs of these batches take, if it is not on disk."""
    rules = {
        batch.setting.rule: batch.setting.system
        for batch in batches
        if batch.setting.core == "compiled" and batch.setting.clock == "lockstep"
    }
    if rules and not is_compiled():
        world = executor.submit(compile_world)
        wait([world, executor.submit(compile_rest, tuple(rules.items()))])


def compile_rest(rules: Iterable[tuple[str, str]]) -> None:
    """Compile the heap of moves, and rules by name, each with a system that it is for."""
    allowance.grant(PLAIN_STEPS)  # from now on nothing is done in plain Python
    scene = scene_from_spec("hex:n=2")
    actions = [move.action for move in scene.system.moves_at(scene.start[0])]
    PathCounter(actions).count(np.zeros(2, np.int64))
    for rule, system in rules:
        _compile_rule(rule, system)


def _compile_rule(rule: str, system: str) -> None:
    scene = scene_from_spec(system)
    kind = rule_named(rule, scene.system)
    actors = vector_actors_for(scene, kind, seeds=[0], hesitate=0.5)
    if actors is None:
        return
    env = CubepathEnv(scene, note_length=kind.length(len(scene.start)))
    seen = list(env.reset(seed=0)[0].values())
    columns: dict[str, Any] = {name: np.array([[each[name] for each in seen]]) for name in seen[0]}
    out = np.zeros((1, len(seen)), np.int32)
    actors.act(columns["observation"], columns["action_mask"], columns.get("notes"), out)
