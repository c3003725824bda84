"""Environments in the form that Stable-Baselines3 expects, with one row per module.

Import it only where the library is installed: see `sb3`. Source: its `VecEnv`, and the masks of
sb3-contrib's `MaskablePPO` (https://sb3-contrib.readthedocs.io).
"""

from __future__ import annotations

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
    """Environments of one scene for Stable-Baselines3; `sb3_env` makes and documents it."""

    _seeds: list[int | None]
    """The seed of each row's next reset."""

    def __init__(
        self, env: CubepathVectorEnv, observation_space: spaces.Box, progress: float
    ) -> None:
        """Take over environments that reset in the same step, and what one module sees."""
        scene = env.scene
        self.modules = len(scene.start)
        """How many rows belong to one environment."""
        self._env, self._progress = env, progress
        self._nearer = relative_layout(scene.system).parts["nearer"]
        rows, actions = env.num_envs * self.modules, scene.system.move_slots + 1
        self._mask = np.ones((rows, actions), np.bool_)
        self._seen: NDArray[Any] | None = None
        self._actions: NDArray[np.int64] | None = None
        super().__init__(rows, observation_space, spaces.Discrete(actions))

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
        seen, infos = self._env.reset(seed=self._seeds[:: self.modules])
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = [{"seed": seed} for seed in infos["seed"].repeat(self.modules).tolist()]
        return self._rows(seen)

    def _rows(self, seen: Arrays) -> NDArray[Any]:
        self._mask = seen["action_mask"].reshape(self.num_envs, -1).astype(np.bool_)
        self._seen = seen["observation"].reshape(self.num_envs, -1)
        return self._seen.copy()

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the action of each row."""
        self._actions = np.asarray(actions, np.int64).reshape(-1, self.modules)

    def step_wait(self) -> tuple[NDArray[Any], NDArray[np.float32], Flags, list[dict[str, Any]]]:
        """Play a round; environments whose episode is over begin the next one at once."""
        if self._actions is None or self._seen is None:
            raise InputError("the environments have not been reset yet: call reset first")
        seen, shared, reached, late, found = self._env.step(self._actions)
        rewards = np.repeat(shared, self.modules).astype(np.float32)
        if self._progress:
            slots = self._actions.reshape(-1, 1) - 1
            nearer = np.take_along_axis(self._seen[:, self._nearer], slots, 1).ravel()
            made = self._env.batch.outcomes.ravel() == GRANTED
            rewards += self._progress * nearer * made
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        over = np.repeat(reached | late, self.modules)
        for row in np.flatnonzero(over).tolist():
            number, module = divmod(row, self.modules)
            self.reset_infos[row] = {"seed": int(found["seed"][number])}
            infos[row] = {
                "terminal_observation": found["final_obs"]["observation"][number, module],
                "TimeLimit.truncated": bool(late[number]),
                "is_success": bool(reached[number]),
            }
        return self._rows(seen), rewards, over, infos

    def action_masks(self) -> Flags:
        """Return which actions of each row are legal, bool of shape (rows, actions)."""
        return self._mask.copy()

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
        return [self._mask[row].copy() for row in self._get_indices(indices)]

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
