"""What an environment returns: observations, infos, arrays, pictures and shares.

Worlds know only absolute observations. This module makes them relative on request.
"""

from collections.abc import Sequence
from typing import Any, TypedDict

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from cubepath.agents.environments.array_world import ArrayWorld, Infos
from cubepath.agents.local.observation import SILENT, Observation, observation_length
from cubepath.agents.local.relative import (
    Showing,
    checked_showing,
    relative_layout,
    relative_observer,
)
from cubepath.agents.rendering.pictures import draw_pixels, draw_text
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System, local_only
from cubepath.protocol.scenes.specs import scene_from_spec


class ReusedDicts:
    """The dicts of an environment that keeps them, overwritten by every step."""

    def __init__(self, world: ArrayWorld, names: list[str]) -> None:
        self.world = world
        self.observations = world.observations(names, copy=False)
        self._names = names
        self._infos = infos_of(self.observations, set())
        self._illegal: Sequence[int] = ()
        self._results: tuple[float, bool, bool] = 0.0, False, False
        self._rewards = dict.fromkeys(names, 0.0)
        self._ended = dict.fromkeys(names, False)
        self._cut = dict.fromkeys(names, False)

    def marked(self, illegal: Sequence[int]) -> Infos:
        """Return the infos, with these modules marked."""
        for numbers, mark in ((self._illegal, False), (illegal, True)):
            for module in numbers:
                self._infos[self._names[module]]["illegal"] = mark
        self._illegal = illegal
        return self._infos

    def results(
        self, reward: float, *, done: bool, late: bool
    ) -> tuple[dict[str, float], dict[str, bool], dict[str, bool]]:
        """Return the rewards, terminations and truncations."""
        if self._results != (reward, done, late):
            self._results = reward, done, late
            for name in self._names:
                self._rewards[name], self._ended[name], self._cut[name] = reward, done, late
        return self._rewards, self._ended, self._cut


def infos_of(observations: dict[str, Observation], illegal: set[str]) -> Infos:
    """Return the infos of agents with these observations, some of whose actions were illegal."""
    return {
        name: {"action_mask": seen["action_mask"], "illegal": name in illegal}
        for name, seen in observations.items()
    }


class ObservationEncoder:
    """Turns what the modules of a scene see into what the environment shows."""

    def __init__(self, scene: Scene, showing: str) -> None:
        """Take in what modules know from the start; InputError if `showing` is no `Showing`."""
        self._system = scene.system
        goals = scene.goals or ((),) * len(scene.start)
        self._observers = (
            [relative_observer(scene.system, each) for each in goals]
            if checked_showing(showing) == "relative"
            else None
        )

    @property
    def relative(self) -> bool:
        """Return whether relative observations are shown."""
        return self._observers is not None

    def __call__(self, module: int, seen: Observation) -> Observation:
        """Return what is shown of what a module sees, which is left as it is."""
        if self._observers is None:
            return seen
        numbers = seen["observation"].astype(np.int32, copy=False)
        return {**seen, "observation": self._observers[module].of(numbers)}

    def space(self, note_length: int, *, register: bool = False) -> spaces.Dict:
        """Return the space of what is shown, with or without a register."""
        system = self._system
        parts: dict[str, spaces.Space[Any]] = {
            "observation": _absolute(system) if self._observers is None else _relative(system),
            "action_mask": spaces.Box(0, 1, (system.move_slots + 1,), np.int8),
        }
        if note_length:
            most = np.iinfo(np.int32).max
            shape = system.reach_slots, note_length
            parts["notes"] = spaces.Box(SILENT, most, shape, np.int32)
            if register:
                parts["register"] = spaces.Box(SILENT, most, (note_length,), np.int32)
        return spaces.Dict(parts)


class EnvironmentOptions(TypedDict, total=False):
    """What the environments of both clocks take, apart from the system."""

    max_cycles: int
    """An episode is truncated after this many rounds, or turns for each agent; by default 500."""
    render_mode: str | None
    """What `render` returns: "ansi", "rgb_array", "human", or by default nothing."""
    note_length: int
    """The length of the notes that `step` accepts; by default 0."""
    observation: Showing
    """The array ``observation``: "absolute", the default, or "relative"."""


class ModuleAgents:
    """What the environments of both clocks have in common: agents, their spaces, pictures."""

    metadata: dict[str, Any]
    _world: Any = None

    def _take(
        self,
        system: str | Scene,
        *,
        max_cycles: int = 500,
        render_mode: str | None = None,
        note_length: int = 0,
        observation: str = "absolute",
        register: bool = False,
    ) -> None:
        """Take the arguments of an environment; InputError if one is wrong."""
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise InputError(
                f"render_mode={render_mode!r}: expected one of {self.metadata['render_modes']}"
            )
        scene = scene_from_spec(system) if isinstance(system, str) else system
        self.scene = local_only(scene, "environment")
        self.max_cycles = max_cycles
        self.render_mode = render_mode
        self.note_length = note_length
        self.possible_agents = list(self.scene.modules)
        self._module = {name: number for number, name in enumerate(self.possible_agents)}
        self.agents: list[str] = []
        self._shown = ObservationEncoder(self.scene, observation)
        space = self._shown.space(note_length, register=register)
        self._observation_spaces = dict.fromkeys(self.possible_agents, space)
        size = self.scene.system.move_slots + 1
        self._action_spaces = {name: spaces.Discrete(size) for name in self.possible_agents}
        info = np.iinfo(np.int32)
        shape = len(self.possible_agents), self.scene.system.site_size
        self.state_space = spaces.Box(info.min, info.max, shape, np.int32)

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Return the agent's observation space, the same object each time."""
        return self._observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Return the agent's action space, the same object each time."""
        return self._action_spaces[agent]

    @property
    def sites(self) -> tuple[Site, ...]:
        """Return the site of each module, by number; before the first reset, the start."""
        return self.scene.start if self._world is None else tuple(self._world.sites)

    def render(self) -> str | NDArray[np.uint8] | None:
        """Draw the modules: text for "ansi", pixels (height, width, 3) for "rgb_array".

        "human" prints the text and returns None.
        """
        if self.render_mode == "rgb_array":
            return draw_pixels(self.scene, self.sites)
        if self.render_mode is None:
            return None
        text = draw_text(self.scene, self.sites)
        if self.render_mode == "ansi":
            return text
        print(text)
        return None


def checked_seed(seed: int | None) -> int:
    """Return the seed of an episode, by default 0; InputError if it is negative."""
    found = int(seed or 0)
    if found < 0:
        raise InputError(f"seed={found}: expected 0 or more")
    return found


def _absolute(system: System) -> spaces.Box:
    info = np.iinfo(np.int32)
    low = np.zeros(observation_length(system), np.int32)
    high = np.ones(observation_length(system), np.int32)
    low[: system.site_size] = info.min
    high[: system.site_size] = info.max
    high[system.site_size + 1 :: 2] = system.codes - 1
    return spaces.Box(low, high, dtype=np.int32)


def _relative(system: System) -> spaces.Box:
    low = relative_layout(system).low
    return spaces.Box(low, np.ones_like(low), dtype=np.float32)


def share_at_goal(scene: Scene, sites: Sequence[Site]) -> float:
    """Return the fraction of the modules at these sites that are on sites of the goal."""
    if scene.goal is None:
        return 0.0
    return sum(site in scene.goal for site in sites) / len(sites)


def state_of(scene: Scene, sites: Sequence[Site]) -> NDArray[np.int32]:
    """Return the places of modules at these sites, int32, shape (modules, site_size)."""
    return np.array([scene.system.encode_site(site) for site in sites], np.int32)
