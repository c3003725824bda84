"""The families whose systems are local: those with environments, runs and shortening.

A family that only starts elsewhere with the moves of an earlier one is not among them, nor is one
without a goal: its runs do not end, and it has tests of its own.
"""

from cubepath.protocol.core.catalogue import Generator
from cubepath.protocol.scenes.registry import all_families
from cubepath.protocol.scenes.specs import scene_from_spec


def _with_moves_of_their_own() -> list[str]:
    found: list[str] = []
    catalogues: list[set[Generator]] = []
    for name in all_families():
        scene = scene_from_spec(name)
        system = scene.system
        if not system.local or scene.goal is None:
            continue
        if system.catalogue is not None:
            mine = set(system.catalogue.generators)
            if any(mine <= known or known <= mine for known in catalogues):
                continue
            catalogues.append(mine)
        found.append(name)
    return found


LOCAL_FAMILIES = _with_moves_of_their_own()
