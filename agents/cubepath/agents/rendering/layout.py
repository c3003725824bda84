"""Positions in a picture, for both text and drawings.

Pure functions.
"""

from __future__ import annotations

from collections.abc import Sequence

from cubepath.agents.rendering.pen import Spot
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System

MODULE_MARK, ARRIVED_MARK, GOAL_MARK = "o", "@", "+"
"""The text of an unlabelled module, off and on a goal cell, and of a goal cell without one."""


def cell_of(place: Site) -> tuple[int, int]:
    """Return a place as a cell of a lattice in the plane; InputError if it is something else."""
    match place:
        case (int(x), int(y)):
            return x, y
        case _:
            raise InputError(f"{place!r} cannot be drawn as a cell, expected two whole numbers")


def spot_of(system: System, place: Site) -> Spot | None:
    """Return where the system says that a place lies; None if it does not say.

    Raises InputError if that is no point of the plane.
    """
    position = system.positions.get(place)
    if position is not None and len(position) != 2:
        raise InputError(f"position {position} of {place!r} cannot be drawn, expected two numbers")
    return position


def known_places(scene: Scene) -> list[Site]:
    """Return the places that a frame holds wherever the modules are."""
    system = scene.system
    places = [system.place_of(site) for site in (*scene.start, *(scene.goal or ()))]
    return [*places, *system.places]


def tips_of(edge: Site) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the two vertices of a lattice edge; for a vertex as a place, that vertex twice.

    Raises InputError if it is no edge in the plane.
    """
    match edge:
        case (int(x), int(y)):
            return (x, y), (x, y)
        case (int(x), int(y), (0 | 1) as axis):
            return (x, y), (x + (axis == 0), y + (axis == 1))
        case _:
            raise InputError(
                f"{edge!r} cannot be drawn as an edge, expected two whole numbers and 0 or 1"
            )


def marks_of(scene: Scene, sites: Sequence[Site]) -> dict[Site, str]:
    """Return the text mark of each place that has a module or belongs to the goal."""
    system, goal = scene.system, scene.goal or frozenset()
    marks = {system.place_of(site): GOAL_MARK for site in goal}
    for site in sites:
        label, arrived = system.label_of(site), site in goal
        if label is None:
            mark = ARRIVED_MARK if arrived else MODULE_MARK
        else:
            mark = f"{label}*" if arrived else str(label)
        marks[system.place_of(site)] = mark
    return marks
