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
from cubepath.coordinator.search.transitions import Transitions
from cubepath.protocol.core.actions import State
from cubepath.protocol.core.sites import in_order
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.scenes.families.arm import arm_catalogue
from cubepath.protocol.scenes.families.assembly import PLANS, STEPS, assembly_moves
from cubepath.protocol.systems.lattice import LatticeSystem
from cubepath.protocol.systems.listed import TabledSystem

STATES_MAX = 2_000
"""A larger complex is not computed."""
_CUBES_MAX = 50_000


def only_class(system: System, start: State) -> bool | None:
    """Tell whether all paths between two states that `start` reaches are homotopic.

    True for the positive arm, whose complex is contractible for every length (the paper's
    proposition), and for an assembly, whose states are the order ideals of its steps, so that its
    complex is CAT(0) (Ardila, Owen and Sullivant 2012). For others the complex is computed if it
    has at most `STATES_MAX` states: True where it collapses to a point, False where its homology
    is not that of a point. None where neither was found.
    """
    if _is_positive_arm(system, start) or _is_assembly(system):
        return True
    steps = Transitions(system)
    widest = len(steps.greedy(steps.possible(steps.encode(start))))
    if 1 << widest > STATES_MAX:
        # So many moves can be made or not, each for itself.
        return None
    scene = Scene("", "", system, in_order(start - system.filled))
    explored = explore(scene, max_states=STATES_MAX)
    if not explored.complete or sum(f_vector(explored)) > _CUBES_MAX:
        return None
    found = state_complex(explored).complex
    answer = contractibility(found, homology(found))
    return {"collapses to a point": True, "not contractible": False}.get(answer)


def _is_positive_arm(system: System, start: State) -> bool:
    """Tell whether the state is an arm that goes right and up, under the arm's own catalogue."""
    if not (
        isinstance(system, LatticeSystem)
        and system.catalogue == arm_catalogue()
        and system.workspace is None
        and not system.obstacles
    ):
        return False
    edges = sorted(map(system.catalogue.lattice.check, start), key=lambda edge: edge[0] + edge[1])
    tips = [(x + 1 - axis, y + axis) for x, y, axis in edges]
    return all((edge[0], edge[1]) == tip for edge, tip in zip(edges[1:], tips, strict=False))


def _is_assembly(system: System) -> bool:
    """Tell whether the listed moves are those of one of the built-in plans."""
    if not isinstance(system, TabledSystem):
        return False
    for count in (2, 3):
        if system.letters != STEPS[:count]:
            continue
        for build, most in PLANS.values():
            for size in range(1, most + 1):
                plan = build(size)
                if len(plan.middles) > len(system.places):
                    break
                if system.listed == assembly_moves(plan, weld=count == 3):
                    return True
    return False
