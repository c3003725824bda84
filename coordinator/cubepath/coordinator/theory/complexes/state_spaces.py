"""The state complex of a small system as data of a page, and where paths are in it.

It draws by `complexes`; `docs/viewing.md` has the fields.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex
from cubepath.coordinator.theory.complexes.exploration import explore
from cubepath.coordinator.theory.complexes.state_complexes import state_complex
from cubepath.coordinator.theory.complexes.vertex_layout import corners_of_squares, laid_out
from cubepath.protocol.core.actions import Action, apply_in_place
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene

STATES_MAX = 260
"""A state complex is shown if it has at most this many states."""


class StateSpace:
    """The states of a scene by number, and the complex that they span."""

    def __init__(
        self, scene: Scene, built: CubicalComplex, states: Iterable[frozenset[Site]]
    ) -> None:
        """Take the complex and its states in the order of its vertices."""
        self._scene = scene
        self._complex = built
        self._numbers = {state: number for number, state in enumerate(states)}

    def number(self, state: Iterable[Site]) -> int:
        """Return the number of a state."""
        return self._numbers[frozenset(state)]

    def along(self, steps: Iterable[Iterable[Action]]) -> list[int]:
        """Return the numbers of the start, and of the state after each step of a path."""
        state = set(self._scene.start_state)
        found = [self.number(state)]
        for actions in steps:
            for action in actions:
                apply_in_place(action, state)
            found.append(self.number(state))
        return found

    def document(self, paths: Sequence[Sequence[int]]) -> dict[str, Any]:
        """Return all of this as data, with the numbers of the states along each path."""
        built = self._complex
        points = np.zeros((len(self._numbers), 3))
        axes = 2 if built.dimension < 2 else 3
        points[:, :axes] = laid_out(built, axes)
        points /= np.abs(points).max()
        return {
            "counts": list(built.f_vector),
            "flat": axes == 2,
            "points": points.ravel(),
            "edges": built.faces[1][:, 0].ravel(),
            "squares": corners_of_squares(built).ravel(),
            "paths": [np.array(path, np.int64) for path in paths],
        }


def state_space(scene: Scene) -> StateSpace | None:
    """Return the state complex of a scene; None if it is too large to be shown, or a point."""
    explored = explore(scene, max_states=STATES_MAX)
    count = len(explored.states)
    if not explored.complete or not 2 <= count <= STATES_MAX:
        return None
    built = state_complex(explored).complex
    return StateSpace(scene, built, (explored.state(place) for place in range(count)))
