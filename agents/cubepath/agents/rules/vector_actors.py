"""The actors of all modules of many environments together, for rules with a vectorised form.

`VectorActors` does in arrays what an `Actor` does for one module: it asks the rule, checks the
choice, and hesitates. The same seeds give the same choices.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.local.observation import SILENT, STAY, observation_length
from cubepath.agents.local.random_streams import (
    DRAW_STEPS,
    HESITATE,
    RULE,
    Streams,
    draw_fraction,
    shared_streams_of,
    streams_of,
)
from cubepath.agents.rules.actor import RuleBlame
from cubepath.agents.rules.registry import scene_and_rule
from cubepath.agents.rules.rule import RuleType
from cubepath.agents.rules.vector_rule import VectorChoice, VectorKnowledge, VectorRule, VectorView
from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.errors import InputError, RuleError
from cubepath.protocol.core.system import Scene

_CHECK_STEPS = 1
"""Microseconds in plain Python, to see that an action is legal."""


def vector_actors_for(
    system: str | Scene,
    rule: str | RuleType | None = None,
    *,
    seeds: Sequence[int],
    hesitate: float = 0.0,
) -> VectorActors | None:
    """Return the actors of one environment of the scene for each seed.

    `system` and `rule` may be names, as for `play`. None if the rule has no vectorised form for the
    scene. InputError if it does not fit the scene, RuleError if it fails, as for `actors_for`.

    >>> import numpy as np
    >>> from cubepath.agents.environments.vector_environment import CubepathVectorEnv
    >>> env = CubepathVectorEnv("agv:graph=grid3x3,n=2", num_envs=3)
    >>> seen, infos = env.reset(seed=1)
    >>> actors = vector_actors_for(env.scene, "random", seeds=[1, 2, 3])
    >>> actions = np.zeros((3, 2), np.int32)
    >>> actors.act(seen["observation"], seen["action_mask"], None, actions)
    >>> actions.tolist(), actors.failed
    ([[0, 0], [1, 0], [0, 0]], {})
    """
    scene, rule = scene_and_rule(system, rule)
    if rule.vectorised is None or not rule.is_for(scene.system):
        return None
    modules = len(scene.start)
    knowledge = VectorKnowledge(
        system=scene.system,
        environments=len(seeds),
        starts=scene.start,
        goals=scene.goals or ((),) * modules,
        streams=partial(streams_of, seeds, modules, RULE),
        shared_streams=partial(shared_streams_of, seeds),
    )
    name = f"rule {rule.name!r}, vectorised"
    with RuleBlame(name, making=True):
        made = rule.vectorised(knowledge)
    if made is None:
        return None
    doubts = streams_of(seeds, modules, HESITATE) if hesitate else None
    length = rule.length(modules)
    return VectorActors(
        made, knowledge, note_length=length, hesitate=hesitate, doubts=doubts, name=name
    )


class VectorActors:
    """Acts for all modules of E environments of one scene, with the choices of an `Actor` of each.

    `vector_actors_for` makes it. `notes`, int32 of shape (E, n, note length), is the last note of
    each module, zeros before the first. `failed` says of each environment in which a module gave up
    in the last round which it was, the first of them, and why: ``module_3: no way``.
    """

    def __init__(
        self,
        rule: VectorRule,
        knowledge: VectorKnowledge,
        *,
        note_length: int,
        hesitate: float,
        doubts: Streams | None,
        name: str,
    ) -> None:
        """Take a rule with what it knows; `doubts` decide hesitations, `who` is blamed."""
        self._rule = rule
        self._hesitate = hesitate
        self._doubts = doubts
        self._name = name
        system = knowledge.system
        each = (knowledge.environments, knowledge.modules)
        self._expected: dict[str, tuple[tuple[int, ...], type[np.generic]]] = {
            "observation": ((*each, observation_length(system)), np.int32),
            "action_mask": ((*each, system.move_slots + 1), np.int8),
            "notes": ((*each, system.reach_slots, note_length), np.int32),
            "playing": (each[:1], np.bool_),
            "out": (each, np.int32),
        }
        self.notes = np.zeros((*each, note_length), np.int32)
        self.failed: dict[int, str] = {}

    def act(
        self,
        observation: NDArray[np.int32],
        action_mask: NDArray[np.int8],
        notes: NDArray[np.int32] | None,
        out: NDArray[np.int32],
        *,
        playing: NDArray[np.bool_] | None = None,
    ) -> None:
        """Write the action of every module into `out`; InputError, or RuleError as for an `Actor`.

        Args:
            observation: int32, shape (E, n, `observation_length`), what `observe` documents.
            action_mask: int8, shape (E, n, `move_slots` + 1); to stay is legal for everybody.
            notes: int32, shape (E, n, `reach_slots`, note length); None if nothing is heard.
            out: int32, shape (E, n).
            playing: bool, shape (E,), False for environments that are over: their modules stay,
                draw nothing and say nothing new. By default all play.
        """
        if notes is None:
            notes = np.full(self._expected["notes"][0], SILENT, np.int32)
        if playing is None:
            playing = np.ones(len(self.notes), np.bool_)
        given: list[NDArray[Any]] = [observation, action_mask, notes, playing, out]
        for name, array in zip(self._expected, given, strict=True):
            self._check_array(name, array)
        # Of one memory layout, and writable: for another everything would be compiled once more.
        seen = VectorView(*[np.require(array, requirements=["C", "W"]) for array in given[:4]])
        actions = np.full(out.shape, STAY, np.int32)
        with RuleBlame(self._name):
            gave_up = sorted(self._rule(seen, VectorChoice(actions, self.notes)), reverse=True)
        # By environment the first module, which comes last.
        self.failed = {e: f"module_{module}: {' '.join(why.split())}" for e, module, why in gave_up}
        self._check_choices(seen, actions)
        if self._doubts is not None:
            hesitating = _hesitate.for_work(actions.size * DRAW_STEPS, by_entries=True)
            hesitating(self._doubts, self._hesitate, seen.playing, actions)
        out[...] = actions

    def _check_array(self, name: str, array: NDArray[Any]) -> None:
        shape, dtype = self._expected[name]
        if array.shape != shape or array.dtype != dtype:
            raise InputError(
                f"{name}: {array.dtype} of shape {array.shape}, expected {np.dtype(dtype)} of"
                f" shape {shape}"
            )

    def _check_choices(self, seen: VectorView, actions: NDArray[np.int32]) -> None:
        illegal = _illegal.for_work(actions.size * _CHECK_STEPS, by_entries=True)
        wrong = illegal(seen.action_mask, seen.playing, actions)
        if wrong >= 0:
            environment, module = divmod(wrong, actions.shape[1])
            legal = seen.action_mask[environment, module].nonzero()[0].tolist()
            raise RuleError(
                f"{self._name}, module_{module}: chose action {actions[environment, module]},"
                f" legal were {legal}"
            )
        if (self.notes == SILENT).any():
            raise RuleError(f"{self._name}: a note with {SILENT}, expected more and an int32")


@compiled
def _illegal(mask: NDArray[np.int8], playing: NDArray[np.bool_], actions: NDArray[np.int32]) -> int:
    """Return where the first action that is not in the mask is, by rows; -1 if all are."""
    for environment in range(actions.shape[0]):
        if playing[environment]:
            for module in range(actions.shape[1]):
                action = actions[environment, module]
                if not (0 <= action < mask.shape[2] and mask[environment, module, action] != 0):
                    return int(environment * actions.shape[1] + module)
    return -1


@compiled
def _hesitate(
    doubts: Streams, hesitate: float, playing: NDArray[np.bool_], actions: NDArray[np.int32]
) -> None:
    """Let each module stay with this probability."""
    for environment in range(actions.shape[0]):
        if playing[environment]:
            for module in range(actions.shape[1]):
                if draw_fraction(doubts, environment, module) < hesitate:
                    actions[environment, module] = STAY
