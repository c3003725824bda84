"""A world whose sites and moves become more while a run goes on, and what is new of it."""

from __future__ import annotations

from collections.abc import Iterable
from collections.abc import Set as AbstractSet
from typing import Any

import numpy as np

from cubepath.coordinator.tools.viewing.worlds import World
from cubepath.protocol.core.actions import Action, apply_in_place, end_at, why_inadmissible
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene

_SITE = {"name": 1, "shape": 1, "at": 2, "to": 2, "colour": 1, "word": 1}
"""The lists of sites, each with how many entries a site has."""
_FRAME = ("box", "behind", "before", "goal")
"""What changes when modules come to where none has been."""


class Growing:
    """A world, the state that its path has led to, and what was told of it."""

    def __init__(self, scene: Scene) -> None:
        """Begin at the start, of which nothing was told."""
        self.world = World(scene)
        self._state = set(scene.start_state)
        self._told: dict[str, Any] = {}

    def begin(self) -> dict[str, Any]:
        """Return the whole world; what is new is so from here on."""
        self._told = self.world.document()
        return self._told

    @property
    def state(self) -> AbstractSet[Site]:
        """The sites that are on where the path stands."""
        return self._state

    def follow(self, actions: Iterable[Action]) -> list[int]:
        """Return the rows of a step's moves; InputError if one is not admissible."""
        rows: list[int] = []
        for action in actions:
            end = end_at(action, self._state)
            if end is None:
                raise InputError(f"not a step: {why_inadmissible(action, self._state)}")
            rows.append(self.world.row(action, end))
            self._state -= action.ends[end]
            self._state |= action.ends[1 - end]
        return rows

    def go_back(self, steps: Iterable[Iterable[Action]]) -> None:
        """Stand where these steps lead from the start."""
        self._state = set(self.world.scene.start_state)
        for actions in steps:
            for action in actions:
                apply_in_place(action, self._state)

    def has_grown(self) -> bool:
        """Return whether there is anything to tell."""
        return self.world.counts != _counts(self._told)

    def grown(self) -> dict[str, Any] | None:
        """Return what has come to the world since it was asked last, as lists; None if nothing.

        Lists of ``sites`` and ``rows`` go behind those that are there, all else takes its place.
        """
        if not self.has_grown():
            return None
        before, self._told = self._told, self.world.document()
        now = self._told
        sites, rows = _counts(before)
        motions = int(before["rows"]["begins"][-1])
        found = now["rows"]
        return {
            "sites": {
                key: _listed(now["sites"][key][width * sites :]) for key, width in _SITE.items()
            },
            "rows": {
                "generators": found["generators"][len(before["rows"]["generators"]) :],
                "generator": _listed(found["generator"][rows:]),
                "at": found["at"][rows:],
                "begins": _listed(found["begins"][rows + 1 :]),
                "source": _listed(found["source"][motions:]),
                "target": _listed(found["target"][motions:]),
                "corner": _listed(found["corner"][2 * motions :]),
                "turn": _listed(found["turn"][motions:]),
            },
            **{
                key: _listed(now[key])
                for key in _FRAME
                if _listed(now[key]) != _listed(before[key])
            },
        }


def _counts(document: dict[str, Any]) -> tuple[int, int]:
    """Return how many sites and rows a world has in a document."""
    return len(document["sites"]["name"]), len(document["rows"]["at"])


def _listed(found: Any) -> Any:
    return found.tolist() if isinstance(found, np.ndarray) else found
