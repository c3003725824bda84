"""What the environments show of what a module sees: absolute or relative observations.

It is one step behind the worlds, which know absolute observations alone; so all of them show the
same.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from cubepath.agents.local.observation import SILENT, Observation, observation_length
from cubepath.agents.local.relative import checked_showing, relative_layout, relative_observer
from cubepath.protocol.core.system import Scene, System


class Shown:
    """Turns what the modules of a scene see into what the environment shows."""

    def __init__(self, scene: Scene, showing: str) -> None:
        """Take in what modules know from birth; InputError if `showing` is no `Showing`."""
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
