"""A schedule for modules without rounds: at which versions each move finds its units.

The cubes are followed from the start by counting, so each module is told with its own moves how
often their units have been written and read before.
"""

from __future__ import annotations

from cubepath.agents.free.orders import OwnMove
from cubepath.agents.keepers.attempts import support_units
from cubepath.coordinator.runs.schedule import Assignment
from cubepath.protocol.core.names import Json
from cubepath.protocol.core.sites import Site, in_order, site_from_json, to_json
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.tiles import Tiles


def own_moves(scene: Scene, assignment: Assignment) -> dict[int, list[OwnMove]]:
    """Return the moves of each module in their order, each with what it must find."""
    system, tiles = scene.system, Tiles(scene.system, 1)
    owners = {
        (number, placed.generator, site_from_json(placed.at)): module
        for module, moves in assignment.own.items()
        for number, placed in moves.items()
    }
    versions: dict[Site, tuple[int, int]] = {}
    found: dict[int, list[OwnMove]] = {}
    for number, cube in enumerate(assignment.cubes, 1):
        for placed in cube:
            at = site_from_json(placed.at)
            module = owners.get((number, placed.generator, at))
            if module is None:
                continue  # no module can make it: the schedule stops there
            move = system.moves_of(system.action(placed.generator, at))[0]
            reads, writes = support_units(system, tiles, move)
            after: list[tuple[Json, int, int | None]] = [
                (to_json(unit), *versions.get(unit, (0, 0))) for unit in in_order(writes)
            ]
            after += [
                (to_json(unit), versions.get(unit, (0, 0))[0], None) for unit in in_order(reads)
            ]
            found.setdefault(module, []).append(OwnMove(placed, after))
            for unit in reads:
                version, times = versions.get(unit, (0, 0))
                versions[unit] = version, times + 1
            for unit in writes:
                versions[unit] = versions.get(unit, (0, 0))[0] + 1, 0
    return found
