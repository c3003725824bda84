"""Whether there is only one homotopy class of paths between two states of a system.

This is so if the state complex is simply connected, and then the normal cube path of any path is a
shortest path overall. State complexes of local systems are non-positively curved (Abrams and
Ghrist), so their universal covers are contractible: for them, simply connected and contractible are
the same.
"""

from __future__ import annotations

from cubepath.coordinator.theory.complexes.collapses import contractibility
from cubepath.coordinator.theory.complexes.exploration import explore
from cubepath.coordinator.theory.complexes.homology_groups import homology
from cubepath.coordinator.theory.complexes.state_complexes import f_vector, state_complex
from cubepath.coordinator.theory.search.budget import SpentError
from cubepath.coordinator.theory.search.transitions import Transitions
from cubepath.protocol.core.actions import State
from cubepath.protocol.core.sites import in_order
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.registry import families_of

STATES_MAX = 2_000
"""A complex with more states is not computed."""
_CUBES_MAX = 50_000


def only_class(steps: Transitions, start: State) -> bool | None:
    """Return whether all paths between two states reachable from `start` are homotopic.

    True if a family of scenes knows it, by an argument for all sizes. For other systems the complex
    is computed if it has at most `STATES_MAX` states: True if it collapses to a point, False if its
    homology differs from that of a point. None if neither is found, or the budget of `steps` is
    spent.

    >>> scene = scene_from_spec("agv:graph=C4,n=1")
    >>> only_class(Transitions(scene.system), scene.start_state)
    False
    """
    system = steps.system
    if system is None:
        return None
    if any(family.one_class(system, start) for family in families_of(system)):
        return True
    if not _are_few(steps, start):
        return None
    scene = Scene("", "", system, in_order(start - system.filled))
    explored = explore(scene, max_states=STATES_MAX)
    if not explored.complete or sum(f_vector(explored)) > _CUBES_MAX:
        return None
    found = state_complex(explored).complex
    answer = contractibility(found, homology(found))
    return {"collapses to a point": True, "not contractible": False}.get(answer)


def _are_few(steps: Transitions, start: State) -> bool:
    """Return whether at most `STATES_MAX` states are reachable; a larger complex costs little."""
    first = steps.encode(start)
    known, waiting = {first}, [first]
    for state in waiting:
        try:
            steps.budget.spend()
            options = steps.possible(state)
        except SpentError:
            return False
        # Each of these moves can be made or not, independently of the others.
        if 1 << len(steps.greedy(options)) > STATES_MAX:
            return False
        for number in options:
            there = state ^ steps.toggle[number]
            if there not in known:
                known.add(there)
                waiting.append(there)
        if len(known) > STATES_MAX:
            return False
    return True
