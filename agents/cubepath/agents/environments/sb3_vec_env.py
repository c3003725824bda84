"""Environments as Stable-Baselines3 has them, a row for each module.

Imported only where the library is there: see `sb3`. Source: its `VecEnv`, and the masks of
sb3-contrib's `MaskablePPO` (https://sb3-contrib.readthedocs.io).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv  # pyright: ignore[reportMissingImports]

from cubepath.agents.environments.environment import CubepathEnv
from cubepath.agents.environments.vector_environment import LATER_SEEDS, CubepathVectorEnv
from cubepath.protocol.core.errors import InputError

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Seen = tuple[NDArray[Any], NDArray[np.int8]]
"""Observations and masks, of shapes (E, n, length) and (E, n, moves + 1)."""


class Worlds(Protocol):
    """E environments of one scene, which are reset one by one."""

    num_envs: int

    def reset(self, seeds: Sequence[int | None]) -> Seen:
        """Begin an episode in each environment that has a seed; return what is seen in all."""
        ...

    def step(self, actions: NDArray[np.int64]) -> tuple[Seen, Floats, Flags, Flags]:
        """Play a round; return what is seen, rewards, and who is terminated and truncated."""
        ...

    def close(self) -> None:
        """Release what they hold."""


class ArrayWorlds:
    """Environments in compiled code."""

    def __init__(self, env: CubepathVectorEnv) -> None:
        """Take environments that are not reset by themselves."""
        self._env = env
        self.num_envs: int = env.num_envs

    def reset(self, seeds: Sequence[int | None]) -> Seen:
        """Begin an episode in each environment that has a seed."""
        mask = np.array([seed is not None for seed in seeds])
        seen, _ = self._env.reset(seed=list(seeds), options={"reset_mask": mask})
        return seen["observation"], seen["action_mask"]

    def step(self, actions: NDArray[np.int64]) -> tuple[Seen, Floats, Flags, Flags]:
        """Play a round in each environment."""
        seen, rewards, terminated, truncated, _ = self._env.step(actions)
        return (seen["observation"], seen["action_mask"]), rewards, terminated, truncated

    def close(self) -> None:
        """Do nothing: arrays are released with their owner."""


class DictWorlds:
    """PettingZoo environments, such as those over zenoh, one after another."""

    def __init__(self, envs: Sequence[CubepathEnv]) -> None:
        """Take environments of one scene."""
        self._envs = envs
        self._seen: list[Any] = [None] * len(envs)
        self.num_envs = len(envs)

    def reset(self, seeds: Sequence[int | None]) -> Seen:
        """Begin an episode in each environment that has a seed."""
        for number, (env, seed) in enumerate(zip(self._envs, seeds, strict=True)):
            if seed is not None:
                self._seen[number], _ = env.reset(seed=seed)
        return self._stacked("observation"), self._stacked("action_mask")

    def step(self, actions: NDArray[np.int64]) -> tuple[Seen, Floats, Flags, Flags]:
        """Play a round in each environment."""
        told = []
        for number, (env, row) in enumerate(zip(self._envs, actions.tolist(), strict=True)):
            who = env.possible_agents[0]
            self._seen[number], rewards, terminated, truncated, _ = env.step(
                dict(zip(env.possible_agents, row, strict=True))
            )
            told.append((rewards[who], terminated[who], truncated[who]))
        rewards_, done, late = zip(*told, strict=True)
        seen = self._stacked("observation"), self._stacked("action_mask")
        return seen, np.array(rewards_), np.array(done), np.array(late)

    def _stacked(self, name: str) -> NDArray[Any]:
        return np.array([[each[name] for each in seen.values()] for seen in self._seen])

    def close(self) -> None:
        """Close all of them."""
        for env in self._envs:
            env.close()


class ModulesVecEnv(VecEnv):  # type: ignore[misc, unused-ignore]
    """Environments of one scene for Stable-Baselines3; `sb3_env` makes and documents it."""

    _seeds: list[int | None]
    """The seed of each row's next reset."""

    def __init__(
        self, worlds: Worlds, modules: int, observation_space: spaces.Box, actions: int
    ) -> None:
        """Take the environments over, with what one module sees and how many actions it has."""
        self.modules = modules
        """How many rows belong to one environment."""
        self._worlds = worlds
        self._streams: list[np.random.Generator] = []
        self._mask = np.ones((worlds.num_envs * modules, actions), np.bool_)
        self._actions: NDArray[np.int64] | None = None
        super().__init__(worlds.num_envs * modules, observation_space, spaces.Discrete(actions))

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
        given = self._seeds[:: self.modules]
        if not self._streams:
            given = [number if seed is None else seed for number, seed in enumerate(given)]
            self._streams = [np.random.default_rng(seed) for seed in given]
        seeds = []
        for number, seed in enumerate(given):
            if seed is not None:
                self._streams[number] = np.random.default_rng(seed)
            seeds.append(self._next_seed(number) if seed is None else seed)
        self._reset_seeds()
        self._reset_options()
        self._tell(seeds)
        return self._rows(self._worlds.reset(seeds))

    def _next_seed(self, number: int) -> int:
        return int(self._streams[number].integers(LATER_SEEDS))

    def _tell(self, seeds: Sequence[int | None]) -> None:
        """Keep the seeds of episodes that begin, for `reset_infos`."""
        for number, seed in enumerate(seeds):
            if seed is not None:
                begin = number * self.modules
                for row in range(begin, begin + self.modules):
                    self.reset_infos[row] = {"seed": seed}

    def _rows(self, seen: Seen) -> NDArray[Any]:
        observation, mask = seen
        self._mask = mask.reshape(self.num_envs, -1).astype(np.bool_)
        return observation.reshape(self.num_envs, -1)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the action of each row."""
        self._actions = np.asarray(actions, np.int64).reshape(-1, self.modules)

    def step_wait(self) -> tuple[NDArray[Any], NDArray[np.float32], Flags, list[dict[str, Any]]]:
        """Play a round; environments whose episode is over begin the next one at once."""
        if self._actions is None or not self._streams:
            raise InputError("the environments have not been reset yet: call reset first")
        seen, rewards, terminated, truncated = self._worlds.step(self._actions)
        rows = self._rows(seen)
        over = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if over.any():
            for number in np.flatnonzero(over).tolist():
                for row in range(number * self.modules, (number + 1) * self.modules):
                    infos[row] = {
                        "terminal_observation": rows[row].copy(),
                        "TimeLimit.truncated": bool(truncated[number]),
                        "is_success": bool(terminated[number]),
                    }
            seeds = [self._next_seed(n) if ends else None for n, ends in enumerate(over.tolist())]
            self._tell(seeds)
            rows = self._rows(self._worlds.reset(seeds))
        by_row = np.repeat(rewards, self.modules).astype(np.float32)
        return rows, by_row, np.repeat(over, self.modules), infos

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
        """Raise AttributeError: rows are modules, which have no attributes of their own."""
        del value, indices
        raise AttributeError(f"a module has no attribute {attr_name!r} to be set")

    def env_is_wrapped(
        self, wrapper_class: type[Any], indices: int | Iterable[int] | None = None
    ) -> list[bool]:
        """Return that no row is wrapped by itself."""
        del wrapper_class
        return [False for _ in self._get_indices(indices)]

    def close(self) -> None:
        """End what the environments have started: over zenoh their processes."""
        self._worlds.close()
