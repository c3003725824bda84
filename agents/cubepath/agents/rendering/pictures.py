"""Pictures of where the modules are: pixels, and drawings on matplotlib's axes.

Room: agents; draws what it is given and asks nobody. matplotlib is imported when something is
drawn and no earlier, through its objects only: no pyplot, so no window and no global state.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from math import ceil, cos, floor, pi, sin, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.rendering import chords, letters
from cubepath.agents.rendering.joints import Segments, segments
from cubepath.agents.rendering.layout import cell_of, is_endless, known_places, label_of, tips_of
from cubepath.agents.rendering.pen import (
    GOAL,
    INK,
    LINE,
    PALE_GOAL,
    TILE,
    WALL,
    Box,
    Colour,
    Pen,
    Points,
    arcs,
    palette,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.systems.lattice import LatticeSystem
from cubepath.protocol.systems.listed import TabledSystem

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["GOAL", "INK", "WALL", "draw_on", "draw_pixels", "frame", "palette"]

_ROOM = 10.5
"""Points per cell from which a number on a module can be read."""
_MOST = 8000
"""So many free cells are drawn one by one, of more none."""
_FRAMES = {"chords": chords.frame, "letters": letters.frame}
_DRAWINGS = {"chords": chords.draw, "letters": letters.draw}
"""What is not drawn place by place."""


def draw_pixels(scene: Scene, sites: Sequence[Site], *, height: int = 360) -> NDArray[np.uint8]:
    """Return a picture as pixels, uint8, shape (height, width, 3).

    The width is even and follows from the scene alone, so that all frames of a film are of one
    size. Where modules leave the frame of start and goal, the picture shows more and all smaller.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    left, right, low, high = frame(scene)
    width = 2 * round(height * min(max((right - left) / (high - low), 0.5), 3.0) / 2)
    figure = Figure(figsize=(width / 100, height / 100), dpi=100, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    draw_on(figure.add_axes((0, 0, 1, 1)), scene, sites)
    canvas.draw()  # type: ignore[no-untyped-call]  # so is it in matplotlib
    pixels = canvas.buffer_rgba()  # type: ignore[no-untyped-call]  # as above
    return np.array(pixels, dtype=np.uint8)[:, :, :3].copy()


def frame(scene: Scene, also: Iterable[Site] = ()) -> Box:
    """Return what a picture shows at least, in cells: the scene, and the sites in `also`.

    On an endless lattice there is room for one module more on every side of the scene, so that
    modules which walk along its edge do not change the frame.
    """
    system = scene.system
    if isinstance(system, TabledSystem) and system.drawing in _FRAMES:
        return _FRAMES[system.drawing](system)
    near = {"edges": 0.7, "graph": 0.7}.get(system.drawing, 0.6)
    far = near + (1 if is_endless(system) else 0)
    known = np.array([_middle(system, place) for place in known_places(scene)])
    others = [_middle(system, system.place_of(site)) for site in also]
    low = np.min([known.min(axis=0) - far, *(np.array(point) - near for point in others)], axis=0)
    high = np.max([known.max(axis=0) + far, *(np.array(point) + near for point in others)], axis=0)
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def draw_on(
    axes: Axes,
    scene: Scene,
    sites: Sequence[Site],
    *,
    moved: Mapping[int, Site] | None = None,
    also: Iterable[Site] = (),
    numbers: bool | None = None,
) -> None:
    """Draw modules at `sites`, by number, on matplotlib's `axes`, which must have their place.

    Modules are coloured by number (`palette`). Cells of the goal have a red outline, in labelled
    systems one in the colour of the module that is to come there; edges of it lie on a pink band.
    Vertices that are marked are dark discs, with a ring where the mark has just come or gone.
    `moved` says of modules that have just moved from which site: they get a dark outline and leave
    a pale trace. The frame holds start, goal, finite workspaces and the sites in `also`. `numbers`
    writes each module's label, or its number, on it; left out, where there is room to read it.
    """
    system = scene.system
    pen = _pen(axes, scene, (*sites, *also))
    if isinstance(system, TabledSystem) and system.drawing in _DRAWINGS:
        words = numbers if numbers is not None else pen.scale >= _ROOM
        _DRAWINGS[system.drawing](pen, scene, system, sites, moved or {}, words=words)
        return
    {"edges": _edges_ground, "graph": _graph_ground}.get(system.drawing, _cells_ground)(pen)
    if system.drawing == "edges":
        _draw_arms(pen, scene, segments(sites, moved))
        return
    colours = palette(len(sites))
    goals = list(scene.goal or ())
    at = [system.place_of(site) for site in goals]
    left = {number: system.place_of(site) for number, site in (moved or {}).items()}
    places = [system.place_of(site) for site in sites]
    _draw_modules(pen, left, places, colours)
    labels = [label_of(system, site) for site in goals]
    hues = [GOAL if label is None else colours[label % len(colours)] for label in labels]
    pen.draw("goal", at, facecolors="none", edgecolors=hues, linewidths=pen.line(0.09))
    if numbers or (numbers is None and pen.scale >= _ROOM):
        for number, site in enumerate(sites):
            label = label_of(system, site)
            word = str(number if label is None else label)
            pen.write(_middle(system, places[number]), word, colours[number])


def _draw_arms(pen: _Pen, scene: Scene, arms: Segments) -> None:
    """Draw segments on lattice edges, their joints, and the vertices that are marked."""
    pen.draw("goal", segments(list(scene.goal or ())).sites, facecolors=PALE_GOAL)
    _draw_modules(pen, arms.moved, arms.sites, palette(len(arms.sites)))
    pen.discs((tip for edge in arms.sites for tip in tips_of(edge)), 0.1, facecolors="white")
    pen.discs(arms.marked, 0.17, facecolors=INK)
    pen.discs(arms.changed, 0.25, facecolors="none")


def _draw_modules(
    pen: _Pen, left: Mapping[int, Site], places: Sequence[Site], colours: Sequence[Colour]
) -> None:
    """Draw modules by number, with an outline and a trace for those that left another place."""
    _draw_trace(pen, left, places, colours)
    pen.draw("module", places, facecolors=colours, edgecolors="white", linewidths=0.03 * pen.scale)
    stirred = [places[number] for number in left]
    pen.draw("module", stirred, facecolors="none", edgecolors=INK, linewidths=pen.line(0.08))


def _draw_trace(
    pen: _Pen, left: Mapping[int, Site], places: Sequence[Site], colours: Sequence[Colour]
) -> None:
    """Draw the places that modules have just left and, but for edges, the way from there."""
    hues = [colours[number] for number in left]
    pen.draw("module", list(left.values()), facecolors=hues, alpha=0.3, linewidths=0)
    if pen.system.drawing != "edges":
        ways = [
            np.array([_middle(pen.system, place), _middle(pen.system, places[number])])
            for number, place in left.items()
        ]
        pen.strokes(ways, colors=hues, linewidths=0.1 * pen.scale, alpha=0.6)


def _middle(system: System, place: Site) -> tuple[float, float]:
    """Return where the middle of a place lies in a picture, y upwards."""
    if system.drawing == "graph":
        return _at_vertex(system, place)
    cell = cell_of(place)
    x, y = cell[0], cell[1]
    if system.drawing == "hexagons":
        return x + y / 2, y * sqrt(3) / 2
    if system.drawing == "edges":
        _, (right, top) = tips_of(place)
        return (x + right) / 2, (y + top) / 2
    return (x, -y) if isinstance(system, GraphSystem) else (x, y)


def _at_vertex(system: System, place: Site) -> tuple[float, float]:
    match system:
        case GraphSystem():
            return _circle(system.vertices)[place]
        case TabledSystem():
            return system.positions.get(place) or _circle(system.places)[place]
        case _:
            raise InputError(f"{type(system).__name__} cannot be drawn as a graph")


@lru_cache(maxsize=64)
def _circle(vertices: tuple[Site, ...]) -> dict[Site, tuple[float, float]]:
    """Return the vertices on a circle, clockwise from the top, far enough from one another."""
    radius = max(1.0, len(vertices) * 1.5 / (2 * pi))
    turns = [pi / 2 - 2 * pi * number / len(vertices) for number in range(len(vertices))]
    return {
        vertex: (radius * cos(turn), radius * sin(turn))
        for vertex, turn in zip(vertices, turns, strict=True)
    }


@dataclass(frozen=True, slots=True)
class _Pen(Pen):
    """Draws places of a system."""

    system: System

    def draw(self, kind: str, places: Collection[Site], **style: Any) -> None:
        """Draw each place as a shape of the given kind: "module", "goal" or "cell"."""
        self.shapes([_shape(self.system, kind, place) for place in places], **style)


def _pen(axes: Axes, scene: Scene, sites: Iterable[Site]) -> _Pen:
    """Set the axes up to show the scene and these sites; an endless lattice fills all of them."""
    left, right, low, high = frame(scene, sites)
    seen = axes.get_window_extent()
    if is_endless(scene.system):
        wide = max(right - left, (high - low) * seen.width / seen.height)
        tall = wide * seen.height / seen.width
        left, right = (left + right - wide) / 2, (left + right + wide) / 2
        low, high = (low + high - tall) / 2, (low + high + tall) / 2
    axes.set(xlim=(left, right), ylim=(low, high), aspect="equal")
    axes.set_axis_off()
    pixels = min(seen.width / (right - left), seen.height / (high - low))
    scale = pixels * 72 / axes.figure.dpi
    return _Pen(axes, (left, right, low, high), scale, scene.system)


def _shape(system: System, kind: str, place: Site) -> Points:
    outline = _outline(system.drawing, isinstance(system, GraphSystem), kind)
    if system.drawing == "edges" and cell_of(place)[2] == 1:
        outline = outline[:, ::-1]
    return outline + _middle(system, place)


@cache
def _outline(drawing: str, graph: bool, kind: str) -> Points:  # noqa: FBT001 - a key of the cache
    """Return the outline of a shape about the origin; a lattice edge lies flat."""
    if drawing == "hexagons":
        size = {"module": 0.93, "goal": 0.86, "cell": 1.0}[kind]
        return arcs([(0, 0)], size / sqrt(3), corners=6, first=pi / 6)
    if drawing == "edges":
        half = {"module": 0.15, "goal": 0.26, "cell": 0.02}[kind]
        return arcs([(0.5, 0), (-0.5, 0)], half, first=-pi / 2)
    if drawing == "graph" or (graph and kind == "module"):
        return arcs([(0, 0)], {"module": 0.38, "goal": 0.48, "cell": 0.36}[kind])
    corner = 0.05 if kind == "cell" else 0.14
    half = 0.47 if kind == "cell" else 0.44
    inner = half - corner
    return arcs([(inner, inner), (-inner, inner), (-inner, -inner), (inner, -inner)], corner)


def _cells_ground(pen: _Pen) -> None:
    """Draw free cells pale and obstacles dark; walls where neighbours on a map do not meet."""
    system = pen.system
    left, right, low, high = pen.box
    if is_endless(system):
        left, right, low, high = left - 1, right + 1, low - 1, high + 1
    graph = isinstance(system, GraphSystem)
    slant, stretch = (0.5, sqrt(3) / 2) if system.drawing == "hexagons" else (0.0, 1.0)
    cells = [
        (column, -row if graph else row)
        for row in range(ceil(low / stretch), floor(high / stretch) + 1)
        for column in range(ceil(left - slant * row), floor(right - slant * row) + 1)
    ]
    free = [cell for cell in cells if system.has_place(cell)]
    if len(free) <= _MOST:
        pen.draw("cell", free, facecolors=TILE, edgecolors="white", linewidths=pen.line(0.06))
    if graph:
        pen.draw("cell", [cell for cell in cells if not system.has_place(cell)], facecolors=WALL)
        pen.strokes(_walls(system, free), colors=WALL, linewidths=pen.line(0.1))
    elif isinstance(system, LatticeSystem):
        pen.draw("module", [cell for cell in cells if cell in system.empty], facecolors=LINE)
        pen.draw("module", [cell for cell in cells if cell in system.filled], facecolors=WALL)


def _walls(system: System, free: Iterable[tuple[int, int]]) -> list[Points]:
    return [
        np.array([(x + 0.5, -y - 0.5), (x + dx - 0.5, -y - dy + 0.5)])
        for x, y in free
        for dx, dy in ((1, 0), (0, 1))
        if system.has_place((x + dx, y + dy)) and (x + dx, y + dy) not in system.sensed((x, y))
    ]


def _edges_ground(pen: _Pen) -> None:
    """Draw the edges of the lattice pale, and those that are obstacles dark."""
    system = pen.system
    left, right, low, high = pen.box
    edges = [
        (x, y, axis)
        for x in range(floor(left), ceil(right))
        for y in range(floor(low), ceil(high))
        for axis in (0, 1)
    ]
    free = [edge for edge in edges if system.has_place(edge)]
    pen.draw("cell", free if len(free) <= _MOST else [], facecolors=LINE)
    pen.draw("module", [edge for edge in edges if edge in system.filled], facecolors=WALL)


def _graph_ground(pen: _Pen) -> None:
    """Draw edges as lines and vertices as pale discs; edges of a list are where modules go."""
    system = pen.system
    ways: dict[tuple[Site, Site], None] = {}
    places: Sequence[Site] = ()
    if isinstance(system, GraphSystem):
        places, ways = system.vertices, dict.fromkeys(system.edges)
    elif isinstance(system, TabledSystem):
        places = system.places
        motion = (ends for move in system.listed for ends in move.motion)
        ways = {(system.place_of(a), system.place_of(b)): None for a, b in motion}
    lines = [np.array([_middle(system, end) for end in edge]) for edge in ways]
    pen.strokes(lines, colors=LINE, linewidths=pen.line(0.05))
    width = pen.line(0.04)
    pen.draw("cell", places, facecolors=TILE, edgecolors=LINE, linewidths=width)
