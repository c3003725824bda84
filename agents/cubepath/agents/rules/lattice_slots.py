"""The moves of a module and the cells that it senses, by slot, where they are the same everywhere.

In a system with a catalogue both are translated along with the module, so what a rule asks of a
slot can be tabled once for each orbit of cells.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from cubepath.protocol.core.catalogue import Cell, Move
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System


def moves_by_orbit(system: System, cells: Iterable[Site]) -> Mapping[Cell, tuple[Move, ...]] | None:
    """Return the moves of a module at the representative of each orbit, in the order of slots.

    They are what is in the slots at any other cell of the orbit as well, translated, unless they
    are excluded there. None if the system has no catalogue, or its slots at one of these `cells`
    hold something else; one cell of each orbit is looked at.
    """
    catalogue = system.catalogue
    if catalogue is None:
        return None
    found = {orbit: catalogue.proposals(orbit) for orbit in catalogue.templates}
    looked_at: set[Cell] = set()
    for site in cells:
        cell = catalogue.lattice.check(site)
        orbit = catalogue.orbit(cell)
        if orbit in looked_at:
            continue
        looked_at.add(orbit)
        wanted = catalogue.proposals(cell)
        slots = system.moves(cell)
        padded = (*wanted, *[None] * (len(slots) - len(wanted)))
        if len(slots) != len(padded) or any(
            move not in (None, one) for move, one in zip(slots, padded, strict=True)
        ):
            return None
    return found


def sensed_offsets(system: System, cell: Cell) -> tuple[Cell, ...] | None:
    """Return the sensed cells by slot, from the representative of the cell's orbit.

    None if the system has no catalogue, or if slots stand for no cell.
    """
    catalogue = system.catalogue
    if catalogue is None:
        return None
    lattice, found = catalogue.lattice, []
    back = tuple(-number for number in cell[: lattice.dimension])
    for near in system.sensed(cell):
        if near is None:
            return None
        found.append(lattice.shift(lattice.check(near), back))
    return tuple(found)
