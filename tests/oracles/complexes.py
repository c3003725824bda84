"""The obvious enumeration of small state and shape complexes, to count what the paper counts."""

from collections import Counter, deque
from collections.abc import Iterable
from operator import sub
from typing import cast

from cubepath.protocol.core.actions import Action, State, admissible, apply, commute
from cubepath.protocol.core.catalogue import Cell
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene

Key = tuple[frozenset[Site], frozenset[Action]]
ShapeKey = tuple[frozenset[Site], frozenset[frozenset[Site]]]


def actions_at(scene: Scene, state: State) -> list[Action]:
    """Return every action that is admissible at the state, once each."""
    found = {
        move.action: None
        for site in in_order(state - scene.system.filled)
        for move in scene.system.moves(site)
        if move is not None and admissible(move.action, state)
    }
    return [action for action in found if scene.system.legal(apply(action, state))]


def states_of(scene: Scene, most: int = 100_000) -> list[frozenset[Site]]:
    """Return the states that can be reached from the start, the nearest `most` of them."""
    first = frozenset(scene.start_state)
    seen, queue = {first: None}, deque([first])
    while queue and len(seen) < most:
        state = queue.popleft()
        for action in actions_at(scene, state):
            after = apply(action, state)
            if after not in seen:
                seen[after] = None
                queue.append(after)
    return list(seen)


def commuting_sets(actions: list[Action]) -> list[tuple[Action, ...]]:
    """Return all non-empty sets of pairwise commuting actions."""
    found: list[tuple[Action, ...]] = [(action,) for action in actions]
    layer = found
    while layer:
        layer = [
            (*chosen, action)
            for chosen in layer
            for action in actions[actions.index(chosen[-1]) + 1 :]
            if all(commute(action, other) for other in chosen)
        ]
        found = found + layer
    return found


def corners(state: State, chosen: tuple[Action, ...]) -> list[frozenset[Site]]:
    """Return the vertices of a cube."""
    found = [frozenset(state)]
    for action in chosen:
        found += [apply(action, corner) for corner in found]
    return found


def f_vector(scene: Scene) -> list[int]:
    """Return how many cubes of each dimension the state complex has (definition, literally)."""
    cubes: set[Key] = set()
    for state in states_of(scene):
        cubes.add((state, frozenset()))
        for chosen in commuting_sets(actions_at(scene, state)):
            if not all(map(scene.system.legal, corners(state, chosen))):
                continue  # the rule for the whole of a non-local system
            moved = frozenset().union(*(action.trace for action in chosen))
            cubes.add((state - moved, frozenset(chosen)))
    count = Counter(len(actions) for _, actions in cubes)
    return [count[dimension] for dimension in range(max(count) + 1)]


def shape_f_vector(scene: Scene) -> list[int]:
    """Return the same for the shape complex: cubes up to translation of a lattice of cells."""
    first = _normal(frozenset(scene.start))
    seen, queue = {first}, deque([first])
    cubes: set[ShapeKey] = set()
    while queue:
        state = queue.popleft()
        actions = actions_at(scene, state)
        for chosen in [(), *commuting_sets(actions)]:
            if all(map(scene.system.legal, corners(state, chosen))):
                cubes.add(_shape_key(state, chosen))
        for action in actions:
            after = _normal(apply(action, state))
            if after not in seen:
                seen.add(after)
                queue.append(after)
    count = Counter(len(actions) for _, actions in cubes)
    return [count[dimension] for dimension in range(max(count) + 1)]


def _normal(state: State) -> frozenset[Site]:
    return _shifted(state, in_order(state)[0])


def _shifted(sites: State, origin: Site) -> frozenset[Site]:
    cells, first = cast("Iterable[Cell]", sites), cast("Cell", origin)
    return frozenset(tuple(map(sub, cell, first)) for cell in cells)


def _shape_key(state: State, chosen: tuple[Action, ...]) -> ShapeKey:
    moved = frozenset().union(*(action.trace for action in chosen))
    origin = in_order(state | moved)[0]
    return (
        _shifted(state - moved, origin),
        frozenset(_shifted(action.trace, origin) for action in chosen),
    )
