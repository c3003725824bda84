"""Where things lie in a picture, for text and drawings alike.

Room: agents; static, asks nobody.
"""

from __future__ import annotations

from collections.abc import Sequence

from cubepath.agents.rendering.pen import Spot
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System

MODULE_MARK, ARRIVED_MARK, GOAL_MARK = "o", "@", "+"
"""How an unlabelled module shows in text, off and on a goal cell, and a goal cell without one."""


def cell_of(place: Site) -> tuple[int, int]:
    """Return a cell of a lattice in the plane; InputError where a place is something else."""
    match place:
        case (int(x), int(y)):
            return x, y
        case _:
            raise InputError(f"{place!r} cannot be drawn as a cell, expected two whole numbers")


def spot_of(system: System, place: Site) -> Spot | None:
    """Return where the system says that a place lies, None where it does not say.

    InputError where that is no point of the plane.
    """
    position = system.positions.get(place)
    if position is not None and len(position) != 2:
        raise InputError(f"position {position} of {place!r} cannot be drawn, expected two numbers")
    return position


def known_places(scene: Scene) -> list[Site]:
    """Return the places that a frame holds whatever the modules do."""
    system = scene.system
    places = [system.place_of(site) for site in (*scene.start, *(scene.goal or ()))]
    return [*places, *system.places]


def tips_of(edge: Site) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the two vertices of a lattice edge; a vertex, as a place, is both of its own.

    InputError where it is no edge in the plane.
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
    """Return what text has at each place that has a module or is of the goal."""
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
