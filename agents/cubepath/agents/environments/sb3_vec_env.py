"""Environments in the form that Stable-Baselines3 expects, with one row per module.

Import it only where the library is installed: see `sb3`. Source: its `VecEnv`, and the masks of
sb3-contrib's `MaskablePPO` (https://sb3-contrib.readthedocs.io).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv  # pyright: ignore[reportMissingImports]

from cubepath.agents.arrays.rounds import GRANTED
from cubepath.agents.environments.vector_environment import LATER_SEEDS, Arrays, CubepathVectorEnv
from cubepath.agents.local.relative import relative_layout
from cubepath.protocol.core.errors import InputError

Flags = NDArray[np.bool_]


class ModulesVecEnv(VecEnv):  # type: ignore[misc, unused-ignore]
    """Environments of scenes for Stable-Baselines3; `sb3_env` makes and documents it."""

    _seeds: list[int | None]
    """The seed of each row's next reset."""

    def __init__(
        self, envs: Sequence[CubepathVectorEnv], observation_space: spaces.Box, progress: float
    ) -> None:
        """Take over environments, the same number of each scene, and what one module sees."""
        scene = envs[0].scene
        self.modules = len(scene.start)
        """How many rows belong to one environment."""
        self._envs, self._progress = envs, progress
        self._nearer = relative_layout(scene.system).parts["nearer"]
        shape, actions = (len(envs), envs[0].num_envs, self.modules), scene.system.move_slots + 1
        self._seen = np.zeros((*shape, *observation_space.shape), observation_space.dtype)
        self._mask = np.ones((*shape, actions), np.bool_)
        self._actions: NDArray[np.int64] | None = None
        self._begun = False
        super().__init__(math.prod(shape), observation_space, spaces.Discrete(actions))

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Give environment i the seed ``seed + i`` at the next reset; None draws one."""
        if seed is None:
            seed = int(np.random.default_rng().integers(LATER_SEEDS))
        if seed < 0:
            raise InputError(f"seed={seed}: expected 0 or more")
        self._seeds = [seed + row // self.modules for row in range(self.num_envs)]
        return self._seeds

    def reset(self) -> NDArray[Any]:
        """Begin a new episode in every environment."""
        seeds = self._seeds[:: self.modules]
        if not self._begun:
            seeds = [number if seed is None else seed for number, seed in enumerate(seeds)]
        for place, env in enumerate(self._envs):
            first = place * env.num_envs
            seen, infos = env.reset(seed=seeds[first : first + env.num_envs])
            self._keep(place, seen)
            for number, seed in enumerate(infos["seed"].tolist()):
                self._note_seed(place, number, seed)
        self._begun = True
        self._reset_seeds()
        self._reset_options()
        return self._rows()

    def _keep(self, place: int, seen: Arrays) -> None:
        self._seen[place], self._mask[place] = seen["observation"], seen["action_mask"]

    def _note_seed(self, place: int, number: int, seed: int) -> range:
        """Keep the seed of an episode that began; return the rows of its modules."""
        first = (place * self._envs[0].num_envs + number) * self.modules
        rows = range(first, first + self.modules)
        for row in rows:
            self.reset_infos[row] = {"seed": seed}
        return rows

    def _rows(self) -> NDArray[Any]:
        return self._seen.reshape(self.num_envs, -1).copy()

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the action of each row."""
        self._actions = np.asarray(actions, np.int64).reshape(self._mask.shape[:-1])

    def step_wait(self) -> tuple[NDArray[Any], NDArray[np.float32], Flags, list[dict[str, Any]]]:
        """Play a round; environments whose episode is over begin the next one at once."""
        if self._actions is None or not self._begun:
            raise InputError("the environments have not been reset yet: call reset first")
        rewards = np.zeros(self._actions.shape, np.float32)
        over = np.zeros(self._actions.shape, np.bool_)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for place, (env, actions) in enumerate(zip(self._envs, self._actions, strict=True)):
            seen, shared, reached, late, found = env.step(actions)
            rewards[place] = shared[:, np.newaxis]
            if self._progress:
                nearer = self._seen[place][:, :, self._nearer]
                made = np.take_along_axis(nearer, actions[:, :, np.newaxis] - 1, 2)[:, :, 0]
                rewards[place] += self._progress * made * (env.batch.outcomes == GRANTED)
            self._keep(place, seen)
            over[place] = (reached | late)[:, np.newaxis]
            for number in np.flatnonzero(reached | late).tolist():
                rows = self._note_seed(place, number, int(found["seed"][number]))
                for row, last in zip(rows, found["final_obs"]["observation"][number], strict=True):
                    infos[row] = {
                        "terminal_observation": last,
                        "TimeLimit.truncated": bool(late[number]),
                        "is_success": bool(reached[number]),
                    }
        return self._rows(), rewards.ravel(), over.ravel(), infos

    def action_masks(self) -> Flags:
        """Return which actions of each row are legal, bool of shape (rows, actions)."""
        return self._mask.reshape(self.num_envs, -1).copy()

    def env_method(
        self,
        method_name: str,
        *method_args: Any,
        indices: int | Iterable[int] | None = None,
        **method_kwargs: Any,
    ) -> list[Any]:
        """Call `action_masks`, the one method that a row has by itself."""
        if method_name != "action_masks" or method_args or method_kwargs:
            raise AttributeError(f"a module has no method {method_name!r}, only 'action_masks'")
        return list(self.action_masks()[self._get_indices(indices)])

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        """Return what all rows have in common: ``render_mode``, None, and `action_masks`."""
        if attr_name not in ("action_masks", "render_mode"):
            raise AttributeError(f"a module has no attribute {attr_name!r}")
        value = None if attr_name == "render_mode" else self.action_masks
        return [value for _ in self._get_indices(indices)]

    def set_attr(
        self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None
    ) -> None:
        """Raise AttributeError: rows are modules, which have no attributes."""
        del value, indices
        raise AttributeError(f"a module has no attribute {attr_name!r} to be set")

    def env_is_wrapped(
        self, wrapper_class: type[Any], indices: int | Iterable[int] | None = None
    ) -> list[bool]:
        """Return that no row is wrapped by itself."""
        del wrapper_class
        return [False for _ in self._get_indices(indices)]

    def close(self) -> None:
        """Do nothing: arrays are released with their owner."""
