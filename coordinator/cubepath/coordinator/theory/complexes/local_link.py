"""The link of one state, from the definition, without any exploration.

This is how the link condition of a non-local system is checked: its complex may be far too large,
but a link involves only the cubes at one state.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from cubepath.protocol.core.actions import Action, State, admissible, apply, commute
from cubepath.protocol.core.sites import in_order
from cubepath.protocol.core.system import Scene


def actions_at(scene: Scene, state: State) -> list[Action]:
    """Return the actions that may be executed at the state, by site and slot.

    >>> scene = scene_from_spec("hex:n=3")
    >>> [action.label for action in actions_at(scene, scene.start_state)][:2]
    ['pivot-1-right at [0, 0]', 'pivot-2-right at [1, -1]']
    """
    system = scene.system
    found = {
        move.action: None
        for site in in_order(state - system.filled)
        for move in system.moves(site)
        if move is not None and admissible(move.action, state)
    }
    return [action for action in found if system.legal(apply(action, state))]


def spans_cube(scene: Scene, state: State, actions: Sequence[Action]) -> bool:
    """Return whether actions admissible at the state span a cube: all its corners are states."""
    if not all(commute(one, other) for one, other in combinations(actions, 2)):
        return False
    if scene.system.local:
        return True
    corners = [frozenset(state)]
    for action in actions:
        corners += [apply(action, corner) for corner in corners]
    return all(scene.system.legal(corner) for corner in corners)


def unfilled(scene: Scene, state: State) -> list[tuple[Action, ...]]:
    """Return the minimal sets of actions that fail the link condition at the state.

    Each has at least three actions; any proper subset of them spans a cube, but all together do
    not. A local system has none (the paper's theorem on non-positive curvature).

    >>> scene = scene_from_spec("hex:n=3")
    >>> unfilled(scene, scene.start_state)
    []
    """
    actions = actions_at(scene, state)
    filled: set[tuple[int, ...]] = {(number,) for number in range(len(actions))}
    layer = sorted(filled)
    missing: list[tuple[Action, ...]] = []
    while layer:
        following = []
        for chosen in layer:
            for number in range(chosen[-1] + 1, len(actions)):
                larger = (*chosen, number)
                if any(part not in filled for part in combinations(larger, len(chosen))):
                    continue
                found = [actions[each] for each in larger]
                if spans_cube(scene, state, found):
                    following.append(larger)
                elif len(larger) > 2:
                    missing.append(tuple(found))
        filled.update(following)
        layer = following
    return missing
