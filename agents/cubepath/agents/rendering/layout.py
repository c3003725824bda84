"""Where things lie in a picture, for text and drawings alike.

Room: agents; static, asks nobody.
"""

from __future__ import annotations

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.systems.lattice import LatticeSystem
from cubepath.protocol.systems.listed import TabledSystem


def label_of(system: System, site: Site) -> int | None:
    """Return the label of a site of a labelled system, None of another."""
    if system.labels is None or not isinstance(site, tuple):
        return None
    return int(site[1])


def cell_of(place: Site) -> tuple[int, ...]:
    """Return a place as whole numbers; InputError where it is something else."""
    if isinstance(place, tuple) and all(isinstance(number, int) for number in place):
        return place
    raise InputError(f"only places of whole numbers can be drawn on a lattice, found {place!r}")


def known_places(scene: Scene) -> list[Site]:
    """Return the places that a frame holds whatever the modules do."""
    system = scene.system
    places = [system.place_of(site) for site in (*scene.start, *(scene.goal or ()))]
    if isinstance(system, GraphSystem):
        places += system.vertices
    elif isinstance(system, LatticeSystem):
        places += [*system.obstacles, *(system.workspace or ())]
    elif isinstance(system, TabledSystem):
        places += system.places
    return places


def is_endless(system: System) -> bool:
    """Tell whether the workspace is a whole lattice."""
    return isinstance(system, LatticeSystem) and system.workspace is None


def tips_of(edge: Site) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the two vertices of a lattice edge; a vertex, as a place, is both of its own."""
    x, y, *rest = cell_of(edge)
    return (x, y), (x + (rest == [0]), y + (rest == [1]))
