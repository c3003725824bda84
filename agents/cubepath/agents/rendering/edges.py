"""Arms on lattice edges, with the vertices where they join, as text and on axes.

A picture of lattice edges may also hold vertices, each with a letter
(`cubepath.protocol.scenes.families.arms`): a marked vertex is drawn as a mark, a free one not.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from math import ceil, floor, pi

from cubepath.agents.rendering import places, style
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System

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


def _middle(_system: System, place: Site) -> style.Spot:
    (left, low), (right, top) = style.tips_of(place)
    return (left + right) / 2, (low + top) / 2


@cache
def _flat(kind: str) -> style.Points:
    half = {"module": 0.15, "goal": 0.26, "cell": 0.02}[kind]
    return style.arcs([(0.5, 0), (-0.5, 0)], half, first=-pi / 2)


def _outline(kind: str, place: Site) -> style.Points:
    upright = isinstance(place, tuple) and place[2] == 1
    return _flat(kind)[:, ::-1] if upright else _flat(kind)


_LOOK = places.PlaceShape(_middle, _outline, 0.7)
_MARK = 0.34
"""The diameter of a mark."""
_DARK: style.Colour = (0.133, 0.145, 0.165)


def _draw(
    pen: style.Pen,
    scene: Scene,
    sites: Sequence[Site],
    moved: Mapping[int, Site],
    _words: bool | None,  # noqa: FBT001 - as `Style.draw` has it
) -> None:
    """Draw segments on lattice edges, their joints, and the marked vertices."""
    edges = places.place_pen(pen, scene.system, _LOOK)
    _behind(pen, scene)
    arms = segments(sites, moved)
    colours = pen.palette(len(sites))
    own = [colours[number] for number in arms.numbers]
    places.draw_modules(edges, arms.moved, arms.sites, own, ways=False)
    pen.discs((tip for edge in arms.sites for tip in style.tips_of(edge)), 0.1, facecolors="white")
    pen.discs(arms.marked, 0.17, facecolors=style.INK)
    pen.discs(arms.changed, 0.25, facecolors="none")


def _behind(pen: style.Pen, scene: Scene) -> None:
    """Draw the lattice, and the goal as pink bands."""
    edges = places.place_pen(pen, scene.system, _LOOK)
    _ground(edges)
    edges.draw("goal", segments(list(scene.goal or ())).sites, facecolors=style.PALE_GOAL)


def _body(_scene: Scene, site: Site) -> style.Body:
    """Return a segment as a bar; a marked vertex is a dot, and a free one is not seen."""
    vertex = vertex_of(site)
    if vertex is not None:
        spot = float(vertex[0]), float(vertex[1])
        return style.Body("dot" if marked([site]) else "none", spot, spot, _DARK)
    (left, low), (right, top) = style.tips_of(site)
    return style.Body("bar", (left, low), (right, top))


def _ground(pen: places.PlacePen) -> None:
    """Draw the edges of the lattice pale, and obstacles dark."""
    system = pen.system
    left, right, low, high = pen.box
    edges = [
        (x, y, axis)
        for x in range(floor(left), ceil(right))
        for y in range(floor(low), ceil(high))
        for axis in (0, 1)
    ]
    free = [edge for edge in edges if system.has_place(edge)]
    pen.draw("cell", free if len(free) <= places.FREE_MAX else [], facecolors=style.LINE)
    pen.draw("module", [edge for edge in edges if edge in system.filled], facecolors=style.WALL)


def _solid(system: System, site: Site) -> style.Solid | None:
    """Return a bar for a segment, a small disc for a marked vertex, and nothing for a free one."""
    vertex = vertex_of(site)
    if vertex is None:
        return style.bar(*style.tips_of(system.place_of(site)))
    return style.disc_at(vertex, _MARK) if marked([site]) else None


def _colours(_system: System, sites: Sequence[Site]) -> list[style.Colour]:
    """Return the colours of segments by number; vertices are dark, as marks are drawn."""
    return [
        hue if vertex_of(site) is None else _DARK
        for hue, site in zip(style.palette(len(sites)), sites, strict=True)
    ]


def _marks(scene: Scene, shots: Sequence[style.Shot], _box: style.Box) -> Iterator[style.Mark]:
    if scene.goal:
        yield style.Mark("goal", face=style.PALE_GOAL)
    if scene.system.filled:
        yield style.Mark("fixed", face=style.WALL)
    arms = [segments(sites, moved) for sites, moved in shots]
    yield from style.moves_marks((found.sites, found.moved) for found in arms)
    yield style.Mark("joint", face="white", edge=style.INK, is_round=True)
    if any(found.marked for found in arms):
        yield style.Mark("marked vertex", face=style.INK, is_round=True)
    if any(found.changed for found in arms):
        yield style.Mark("mark has just changed", edge=style.INK, is_round=True)


def _text(scene: Scene, sites: Sequence[Site]) -> str:
    """Return segments as ``---`` and ``|`` between vertices; a marked vertex is ``*``."""
    marks = style.marks_of(scene, sites)
    flat = {style.MODULE_MARK: "---", style.ARRIVED_MARK: "===", style.GOAL_MARK: "..."}
    upright = {style.MODULE_MARK: "|", style.ARRIVED_MARK: "H", style.GOAL_MARK: ":"}
    filled = dict.fromkeys(scene.system.filled, "#")
    tips = [tip for edge in (*style.known_places(scene), *marks) for tip in style.tips_of(edge)]
    left, right = min(x for x, _ in tips), max(x for x, _ in tips)
    low, high = min(y for _, y in tips), max(y for _, y in tips)
    busy = {tip for edge in (*segments(sites).sites, *filled) for tip in style.tips_of(edge)}
    joined = marked(sites)
    marks |= filled
    lines = []
    for y in range(high, low - 1, -1):
        row, below = "", ""
        for x in range(left, right + 1):
            mark = marks.get((x, y, 0), "")
            vertex = MARK if (x, y) in joined else "o" if (x, y) in busy else "+"
            row += vertex + flat.get(mark, mark * 3).ljust(3)
            mark = marks.get((x, y - 1, 1), "")
            below += upright.get(mark, mark).ljust(4)
        lines += [row.rstrip(), below.rstrip()]
    return "\n".join(lines[:-1])


EDGES = style.Style(
    text=_text,
    frame=partial(places.frame_of, _LOOK),
    extent=partial(places.extent_of, _LOOK),
    draw=_draw,
    marks=_marks,
    moving=style.MovingPart(_body, _behind, thick=0.3, joints=True),
    solid=_solid,
    colours=_colours,
)
