"""Arms whose ends join at marked vertices: segments and marks told apart.

Pure functions. A picture of lattice edges may also hold vertices, each with a letter
(`cubepath.protocol.scenes.families.arms`): segments are drawn as usual, a marked vertex as a mark,
and a free vertex not at all.
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

    `numbers` are the numbers of the segments among all sites, and `moved` is numbered like `sites`;
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
    """Return the marked vertices."""
    found = [vertex_of(site) for site in sites if isinstance(site, tuple) and site[1] == _MARKED]
    return [vertex for vertex in found if vertex is not None]


def vertex_of(site: Site) -> Vertex | None:
    """Return the vertex of a site ``((x, y), letter)``; None if the site is an edge."""
    if isinstance(site, tuple) and len(site) == 2 and isinstance(site[1], str):
        x, y = site[0]
        return int(x), int(y)
    return None
