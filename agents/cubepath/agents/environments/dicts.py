"""The dicts of an environment in the form that PettingZoo asks for: kept ones, and infos."""

from __future__ import annotations

from collections.abc import Sequence

from cubepath.agents.environments.array_world import ArrayWorld, Infos
from cubepath.agents.local.observation import Observation


class Kept:
    """The dicts of an environment that keeps them, overwritten by every step."""

    def __init__(self, world: ArrayWorld, names: list[str]) -> None:
        self.world = world
        self.observations = world.observations(names, copy=False)
        self._names = names
        self._infos: Infos = {
            name: {"action_mask": seen["action_mask"], "illegal": False}
            for name, seen in self.observations.items()
        }
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
