"""The rule `word` for all segments of many arms at once.

`word` has the rule, and why it reaches the goal. A move changes the height of its mover by a number
that depends on its slot and on the axis of the edge alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.rules.lattice_slots import moves_by_orbit
from cubepath.agents.rules.vector_rule import (
    RuleFailure,
    VectorChoice,
    VectorKnowledge,
    VectorRule,
    VectorView,
)
from cubepath.agents.rules.word_heights import height, wanted_height
from cubepath.protocol.compiled import compiled

_STEPS = 2
"""Microseconds in plain Python, to choose for one segment."""


class _Heights(NamedTuple):
    """What the rule asks of slots and of segments."""

    axes: NDArray[np.int64]
    """The axes of edges that have moves."""
    gains: NDArray[np.int64]
    """Shape (axes, `move_slots`): by how much the move in a slot changes the height."""
    wanted: NDArray[np.int64]
    """The height of each segment in the goal word."""


def make(knowledge: VectorKnowledge) -> VectorRule | None:
    """Return the rule of all segments; InputError if one has no goal word."""
    wanted = [wanted_height(goals) for goals in knowledge.goals]
    system = knowledge.system
    orbits = moves_by_orbit(system, knowledge.starts)
    if orbits is None:
        return None
    gains = np.zeros((len(orbits), system.move_slots), np.int64)
    for row, moves in enumerate(orbits.values()):
        gains[row, : len(moves)] = [height(move.target) - height(move.source) for move in moves]
    axes = np.array([orbit[-1] for orbit in orbits], np.int64)
    heights = _Heights(axes, gains, np.array(wanted, np.int64))
    steps = knowledge.environments * knowledge.modules * _STEPS

    def choose(seen: VectorView, chosen: VectorChoice) -> Iterable[RuleFailure]:
        _turn.for_work(steps, by_entries=True)(seen, heights, chosen.actions)
        return ()

    return choose


@compiled
def _turn(seen: VectorView, heights: _Heights, actions: NDArray[np.int32]) -> None:
    """Let each segment take the first legal move that brings it nearer to its height."""
    for environment in range(actions.shape[0]):
        if not seen.playing[environment]:
            continue
        for module in range(actions.shape[1]):
            axis = seen.observation[environment, module, 2]
            short = heights.wanted[module] - seen.observation[environment, module, 0]
            if axis == 0:
                short -= 1
            row = _row_of(heights.axes, axis)
            if row < 0:
                continue
            for slot in range(heights.gains.shape[1]):
                after = short - heights.gains[row, slot]
                if seen.action_mask[environment, module, slot + 1] != 0 and abs(after) < abs(short):
                    actions[environment, module] = slot + 1
                    break


@compiled
def _row_of(axes: NDArray[np.int64], axis: int) -> int:
    """Return the row of an axis in the table; -1 if its edges have no moves."""
    for row in range(len(axes)):
        if axes[row] == axis:
            return row
    return -1
