"""Whether there is but one homotopy class of paths between two states of a system.

Where the state complex is simply connected there is, and then the normal cube path of any path is
a shortest of all. State complexes of local systems are non-positively curved (Abrams and Ghrist),
so their universal covers are contractible: simply connected and contractible are the same for them.

Room: coordinator; touches nothing.
"""

from __future__ import annotations

from cubepath.coordinator.complexes.collapses import contractibility
from cubepath.coordinator.complexes.exploration import explore
from cubepath.coordinator.complexes.homology_groups import homology
from cubepath.coordinator.complexes.state_complexes import f_vector, state_complex
from cubepath.coordinator.search.budget import SpentError
from cubepath.coordinator.search.transitions import Transitions
from cubepath.protocol.core.actions import State
from cubepath.protocol.core.sites import in_order
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.registry import families_of

STATES_MAX = 2_000
"""A larger complex is not computed."""
_CUBES_MAX = 50_000


def only_class(steps: Transitions, start: State) -> bool | None:
    """Tell whether all paths between two states that `start` reaches are homotopic.

    True where a family of scenes knows it, by an argument for all sizes. For others the complex is
    computed if it has at most `STATES_MAX` states: True where it collapses to a point, False where
    its homology is not that of a point. None where neither was found, or the budget of `steps` is
    spent.
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
    """Tell whether no more than `STATES_MAX` states can be reached; what is larger costs little."""
    first = steps.encode(start)
    known, waiting = {first}, [first]
    for state in waiting:
        try:
            steps.budget.spend()
            options = steps.possible(state)
        except SpentError:
            return False
        # So many moves can be made or not, each for itself.
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
