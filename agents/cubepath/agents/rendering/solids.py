"""Cells in three dimensions: cubes, rhombic dodecahedra and lattice edges, as text and on axes.

Faces are shaded by their direction, and lie in front of one another as they would be seen. A goal
cell, a cell kept free and the trace of a module can be seen through.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from math import pi
from typing import NamedTuple

import numpy as np

from cubepath.agents.rendering import style
from cubepath.agents.rendering.places import PlaceShape, extent_of, frame_of, place_marks
from cubepath.agents.rendering.projection import (
    CELL_FACES,
    FRONT,
    ROD,
    Face,
    Faces,
    box_faces,
    moved,
    outline_of,
    painting_order,
    project,
    tone,
)
from cubepath.agents.rendering.ways import Leg, Way, way_in
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene, System

_CLEAR, _GHOST = 0.15, 0.3
_ORIGIN = np.zeros(3)
_SIZE = 0.94
"""The size of a cube in files for viewers. A dodecahedron is shown there as the cube within it."""


class _Body(NamedTuple):
    """What is painted at a cell, of a colour and as opaque as `alpha`, with an outline."""

    faces: Faces
    middle: style.Points
    colour: style.Colour
    alpha: float = 1.0
    edge: str = style.PAPER
    width: float = 0.03
    number: int | None = None
    """The number of the module that this is."""


_WANTED = {
    "cubes": "a cell, expected three whole numbers",
    "dodecahedra": "a cell, expected three whole numbers with an even sum",
    "cube-edges": "an edge, expected three whole numbers and 0, 1 or 2",
}


def middle_of(drawing: str, place: Site) -> style.Points:
    """Return the middle of a cell in space, shape (3,); InputError if it is none."""
    match place:
        case (int(x), int(y), int(z)) if drawing == "cubes" or (
            drawing == "dodecahedra" and (x + y + z) % 2 == 0
        ):
            return np.array((x, y, z), np.float64)
        case (int(x), int(y), int(z), (0 | 1 | 2) as axis) if drawing == "cube-edges":
            return np.array([at + (along == axis) / 2 for along, at in enumerate((x, y, z))])
        case _:
            raise InputError(f"{place!r} cannot be drawn as {_WANTED[drawing]}")


def _axis(place: Site) -> int:
    return int(place[3]) if isinstance(place, tuple) and len(place) == 4 else 0


def _tips(place: Site) -> tuple[style.Points, style.Points]:
    """Return the two ends of a lattice edge."""
    middle, half = middle_of("cube-edges", place), np.eye(3)[_axis(place)] / 2
    return middle - half, middle + half


def _swing(_action: Action, source: Site, target: Site) -> Way:
    """Return how an edge turns by a quarter about an end that it keeps; any other goes straight."""
    kept = [one for one in _tips(source) for other in _tips(target) if (one == other).all()]
    if len(kept) != 1:
        return ()
    arm, goal = (middle_of("cube-edges", place) - kept[0] for place in (source, target))
    x, y, z = (4 * np.cross(arm, goal)).tolist()
    a, b, c = kept[0].tolist()
    return (Leg((a, b, c), (x, y, z), pi / 2),) if x or y or z else ()


def _spot(drawing: str, place: Site) -> style.Spot:
    x, y, _ = project(middle_of(drawing, place)).tolist()
    return x, y


def _bodies(
    pen: style.Pen, drawing: str, scene: Scene, sites: Sequence[Site], left: Mapping[int, Site]
) -> Iterator[_Body]:
    """Yield what the picture shows: obstacles, the goal, traces, and the modules at last."""
    system, colours, theme = scene.system, pen.palette(len(sites)), pen.theme

    def at(place: Site, colour: style.Colour, *paint: float | str) -> _Body:
        middle = middle_of(drawing, place)
        faces = moved(CELL_FACES[drawing][_axis(place)], middle)
        return _Body(faces, middle, colour, *paint)  # type: ignore[arg-type]  # in their order

    for place in in_order(system.filled):
        yield at(place, style.parts_of(theme.of(style.WALL)))
    for place in in_order(system.empty):
        yield at(place, style.parts_of(theme.of(style.LINE)), _GHOST)
    places = [system.place_of(site) for site in sites]
    arrived = {place for number, place in enumerate(places) if number not in pen.poses}
    goal = {system.place_of(site) for site in scene.goal or ()}
    pink = theme.of(style.GOAL)
    for place in in_order(goal - arrived):
        yield at(place, style.parts_of(pink), _CLEAR, pink, 0.05)
    for number, site in left.items():
        if system.place_of(site) not in arrived:
            yield at(system.place_of(site), colours[number], _GHOST)
    for number, place in enumerate(places):
        pose = pen.poses.get(number)
        edge, width = (pink, 0.05) if place in goal and pose is None else (theme.rim, 0.03)
        edge, width = (theme.of(style.INK), 0.06) if number in left else (edge, width)
        source = place if pose is None else left[number]
        body = at(source, colours[number], 1.0, edge, width, number)
        if pose is not None:
            faces = tuple(Face(pose(f.corners), pose(f.normal) - pose(_ORIGIN)) for f in body.faces)
            body = body._replace(faces=faces, middle=pose(body.middle))
        yield body
        for tip in _tips(place) if drawing == "cube-edges" else ():
            yield _Body(moved(box_faces(ROD, ROD, ROD), tip), tip, (1, 1, 1), 1.0, style.INK, 0.02)


def _paint(pen: style.Pen, bodies: Iterable[_Body], *, words: Mapping[int, str] = {}) -> None:
    """Paint bodies from back to front, and words on the modules whose fronts can be seen."""
    found = list({(b.number, *b.middle.tolist(), b.alpha): b for b in bodies}.values())
    if not found:
        return
    loose = [place for place, body in enumerate(found) if body.number in pen.poses]
    order = painting_order([b.faces for b in found], np.array([b.middle for b in found]), loose)
    seen = [
        (found[place], face)
        for place in order
        for face in found[place].faces
        if face.normal @ FRONT.axes[2] > 1e-9
    ]
    pen.shapes(
        [project(face.corners)[:, :2] for _, face in seen],
        facecolors=[(*_shaded(body.colour, face), body.alpha) for body, face in seen],
        edgecolors=[pen.theme.of(body.edge) for body, _ in seen],
        linewidths=[pen.line(body.width) for body, _ in seen],
        joinstyle="round",
    )
    opaque = [found[place] for place in order if found[place].alpha == 1]
    outlines = [outline_of(body.faces) for body in opaque]
    for rank, body in enumerate(opaque):
        word = words.get(-1 if body.number is None else body.number)
        if word is not None:
            front = max(body.faces, key=lambda face: float(face.normal @ FRONT.axes[2]))
            x, y, _ = project(front.corners.mean(axis=0)).tolist()
            if not any(_holds(outline, (x, y)) for outline in outlines[rank + 1 :]):
                pen.write((x, y), word, _shaded(body.colour, front))


def _shaded(colour: style.Colour, face: Face) -> style.Colour:
    red, green, blue = colour
    part = tone(face.normal)
    return part * red, part * green, part * blue


def _holds(outline: style.Points, spot: style.Spot) -> bool:
    """Return whether a convex outline, counter-clockwise, holds a spot."""
    ways, arms = np.roll(outline, -1, axis=0) - outline, np.array(spot) - outline
    return bool((ways[:, 0] * arms[:, 1] > ways[:, 1] * arms[:, 0]).all())


def _draw(
    pen: style.Pen,
    scene: Scene,
    sites: Sequence[Site],
    left: Mapping[int, Site],
    words: bool | None,  # noqa: FBT001 - as `Style.draw` has it
    *,
    drawing: str,
) -> None:
    numbered = style.readable(pen, words) and pen.theme.modules is None and drawing != "cube-edges"
    numbers = {number: str(number) for number in range(len(sites) if numbered else 0)}
    _paint(pen, _bodies(pen, drawing, scene, sites, left), words=numbers)


def _body(scene: Scene, site: Site, *, drawing: str) -> style.Body:
    at = _spot(drawing, scene.system.place_of(site))
    return style.Body("cell", at, at)


def _solid(system: System, site: Site, *, drawing: str) -> style.Solid:
    place = system.place_of(site)
    x, y, z = middle_of(drawing, place).tolist()
    if drawing == "cube-edges":
        wide, deep, tall = (1 - ROD if axis == _axis(place) else ROD for axis in range(3))
        return style.Solid((x, y, z), (wide, deep, tall))
    return style.Solid((x, y, z), (_SIZE, _SIZE, _SIZE))


def _marks(
    scene: Scene, shots: Sequence[style.Shot], _box: style.Box, *, drawing: str
) -> Iterator[style.Mark]:
    yield from place_marks(scene, shots)
    if drawing == "cube-edges":
        yield style.Mark("joint", face=style.PAPER, edge=style.INK)
    if scene.system.filled:
        yield style.Mark("obstacle", face=style.WALL)
    if scene.system.empty:
        yield style.Mark("kept free", face=style.LINE)


def _text(scene: Scene, sites: Sequence[Site], *, drawing: str) -> str:
    """Return the layers from the top, each as rows of cells with x to the right and y upwards.

    Edges along an axis are in layers of their own, at their lower ends.
    """
    known = dict.fromkeys(style.known_places(scene), ".") | dict.fromkeys(scene.system.filled, "#")
    known |= style.marks_of(scene, sites)
    for place in known:
        middle_of(drawing, place)
    cells = {tuple(map(int, place)): known[place] for place in known if isinstance(place, tuple)}
    lows, highs = ([end(each) for each in zip(*cells, strict=True)] for end in (min, max))
    lines = []
    for up, axis in sorted({(-cell[2], cell[3:]) for cell in cells}):
        lines.append(f"z = {-up}" + "".join(f", along {'xyz'[each]}" for each in axis))
        for y in range(highs[1], lows[1] - 1, -1):
            row = [(x, y, -up, *axis) for x in range(lows[0], highs[0] + 1)]
            marks = [cells.get(cell) or _ground(drawing, scene, cell) for cell in row]
            lines.append("".join(mark.ljust(2) for mark in marks).rstrip())
    return "\n".join(lines)


def _ground(drawing: str, scene: Scene, cell: tuple[int, ...]) -> str:
    is_cell = drawing != "dodecahedra" or sum(cell) % 2 == 0
    return "." if is_cell and scene.system.has_place(cell) else " "


def _style(drawing: str) -> style.Style:
    faces = CELL_FACES[drawing][0]
    spot, outline = partial(_spot, drawing), outline_of(faces)
    look = PlaceShape(
        lambda _, place: spot(place), lambda _, __: outline, float(np.abs(outline).max()) + 0.1
    )
    is_edge = drawing == "cube-edges"
    ways = partial(way_in, drawing, lambda place: middle_of(drawing, place).tolist())
    moving = style.MovingPart(
        body=partial(_body, drawing=drawing),
        outline=outline,
        joints=is_edge,
        way=_swing if is_edge else ways,
    )
    return style.Style(
        text=partial(_text, drawing=drawing),
        frame=partial(frame_of, look),
        extent=partial(extent_of, look),
        draw=partial(_draw, drawing=drawing),
        marks=partial(_marks, drawing=drawing),
        moving=moving,
        solid=partial(_solid, drawing=drawing),
    )


SOLIDS: dict[str, style.Style] = {drawing: _style(drawing) for drawing in CELL_FACES}
"""The styles of lattices in three dimensions, by their names."""
