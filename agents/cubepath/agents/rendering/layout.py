"""Where things lie in a picture, for text and drawings alike.

Room: agents; static, asks nobody.
"""

from __future__ import annotations

from collections.abc import Sequence

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene

MODULE_MARK, ARRIVED_MARK, GOAL_MARK = "o", "@", "+"
"""How an unlabelled module shows in text, off and on a goal cell, and a goal cell without one."""


def cell_of(place: Site) -> tuple[int, ...]:
    """Return a place as whole numbers; InputError where it is something else."""
    if isinstance(place, tuple) and all(isinstance(number, int) for number in place):
        return place
    raise InputError(f"only places of whole numbers can be drawn on a lattice, found {place!r}")


def known_places(scene: Scene) -> list[Site]:
    """Return the places that a frame holds whatever the modules do."""
    system = scene.system
    places = [system.place_of(site) for site in (*scene.start, *(scene.goal or ()))]
    return [*places, *system.places]


def tips_of(edge: Site) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the two vertices of a lattice edge; a vertex, as a place, is both of its own."""
    x, y, *rest = cell_of(edge)
    return (x, y), (x + (rest == [0]), y + (rest == [1]))


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
