"""Arms whose ends are joined at marked vertices: what of them is a segment and what a mark.

Room: agents; static, asks nobody. A picture of lattice edges may hold vertices too, of which each
has a letter (`cubepath.protocol.scenes.families.arms`): segments are drawn as ever, a vertex that
is marked as a mark, and one that is free not at all.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from cubepath.protocol.core.sites import Site

Vertex = tuple[int, int]
MARK = "*"
"""How a marked vertex shows in text."""
_MARKED = "marked"


@dataclass(frozen=True, slots=True)
class Segments:
    """Sites in a picture of lattice edges, with the vertices taken out.

    `numbers` are those that the segments have among all sites, and `moved` counts as `sites` does;
    `changed` are the vertices whose letter has just changed.
    """

    sites: list[Site]
    numbers: list[int]
    moved: dict[int, Site]
    marked: list[Vertex]
    changed: list[Vertex]


def segments(sites: Sequence[Site], moved: Mapping[int, Site] | None = None) -> Segments:
    """Return the sites in their order without the vertices, and `moved` by their new numbers."""
    numbers = {
        number: place
        for place, number in enumerate(
            number for number, site in enumerate(sites) if vertex_of(site) is None
        )
    }
    known = moved or {}
    changed = [vertex_of(sites[number]) for number in known]
    return Segments(
        sites=[sites[number] for number in numbers],
        numbers=list(numbers),
        moved={numbers[number]: site for number, site in known.items() if number in numbers},
        marked=marked(sites),
        changed=[vertex for vertex in changed if vertex is not None],
    )


def marked(sites: Iterable[Site]) -> list[Vertex]:
    """Return the vertices that are marked."""
    found = [vertex_of(site) for site in sites if isinstance(site, tuple) and site[1] == _MARKED]
    return [vertex for vertex in found if vertex is not None]


def vertex_of(site: Site) -> Vertex | None:
    """Return the vertex of a site ``((x, y), letter)``, None for a site that is an edge."""
    if isinstance(site, tuple) and len(site) == 2 and isinstance(site[1], str):
        x, y = site[0]
        return int(x), int(y)
    return None
