"""What holds for all runs in a scene, as experiments use it; `theory` works it out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.plugins import plugin
from cubepath.protocol.core.actions import State
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene

Change: TypeAlias = tuple[State, State]
"""The sites that a move turns off, and those that it turns on."""


class SceneFacts(Protocol):
    """What is known of a scene; see the class of this name in `theory` for each value."""

    scene: Scene
    optimum: int | None
    best_found: int | None
    missing: int | None
    distance: int | None
    hashed: str

    def bound(self, cubes: int | None) -> int | None:
        """Return a lower bound on cubes from start to goal; None if there is none."""
        ...

    def measures(self, changes: Iterable[Change]) -> NDArray[np.int64]:
        """Return how much each change of sites changes `missing` and `distance`, shape (2, n)."""
        ...

    def blocked(self, sites: Sequence[Site]) -> bool:
        """Return whether no move at all is admissible with the modules at these sites."""
        ...


def facts_of(system: str, max_states: int = 0, iterations: int = 0) -> SceneFacts:
    """Return what is known of a scene by name, found once in a process.

    `max_states` bounds a search for the optimum, `iterations` one for a path with few cubes; there
    is none if it is 0.
    """
    found: SceneFacts = plugin("facts_of")(system, max_states, iterations)
    return found


def forget_facts() -> None:
    """Forget what is known of all scenes, since files of scenes may have changed."""
    plugin("facts_of").cache_clear()
