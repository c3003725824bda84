"""Modules drawn place by place, on lattices, maps and graphs; and graphs themselves.

The system says where the vertices of a graph lie; otherwise they lie on a circle. What no other
style can draw is drawn as a graph, too.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from math import cos, pi, sin
from typing import Any

import numpy as np

from cubepath.agents.rendering import style
from cubepath.agents.rendering.ways import Way
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.core.system import Scene, System

FREE_MAX = 8000
"""The most free cells that are drawn, one by one; with more, none is drawn."""
_LARGE = 12
"""Workspaces of at most this many cells per side are always shown whole."""
_DISC = 0.76
"""Across a vehicle in three dimensions, in cells."""


@dataclass(frozen=True, slots=True)
class PlaceShape:
    """The middle of a place, y upwards, and the shape of the place around it.

    The shape depends on the kind: "module", "goal" or "cell". `margin` is the distance from the
    middles of the places to the edge of a frame.
    """

    middle: Callable[[System, Site], style.Spot]
    outline: Callable[[str, Site], style.Points]
    margin: float


@dataclass(frozen=True, slots=True)
class PlacePen(style.Pen):
    """Draws places of a system."""

    system: System
    look: PlaceShape

    def middle(self, place: Site) -> style.Spot:
        """Return the middle of a place."""
        return self.look.middle(self.system, place)

    def draw(self, kind: str, places: Collection[Site], **paint: Any) -> None:
        """Draw each place as a shape of the given kind."""
        self.shapes([self.shape(kind, place) for place in places], **paint)

    def shape(self, kind: str, place: Site) -> style.Points:
        """Return the outline of a shape of the given kind at a place, shape (n, 2)."""
        return self.look.outline(kind, place) + self.middle(place)

    def posed(self, number: int, points: style.Points) -> style.Points:
        """Return points of a module, shape (n, 2), where it is on its way."""
        pose = self.poses.get(number)
        return points if pose is None else pose(np.pad(points, ((0, 0), (0, 1))))[:, :2]

    def posed_middle(self, number: int, place: Site) -> style.Spot:
        """Return the middle of a module where it is on its way."""
        x, y = self.posed(number, np.array([self.middle(place)]))[0].tolist()
        return x, y


def place_pen(pen: style.Pen, system: System, look: PlaceShape) -> PlacePen:
    """Return a pen for the places of a system on the same axes."""
    return PlacePen(pen.canvas, pen.box, pen.scale, pen.theme, system, look, poses=pen.poses)


@cache
def disc(kind: str) -> style.Points:
    """Return the outline of a round place."""
    return style.arcs([(0, 0)], {"module": 0.38, "goal": 0.48, "cell": 0.36}[kind])


def frame_of(look: PlaceShape, scene: Scene, also: Iterable[Site]) -> style.Box:
    """Return the frame around the places of a scene and some further sites.

    On an endless lattice there is room for one more module on every side of the scene, so modules
    that walk along its edge do not change the frame.
    """
    system = scene.system
    near = look.margin
    far = near + (0 if system.bounded else 1)
    known = np.array([look.middle(system, place) for place in style.known_places(scene)])
    others = [look.middle(system, system.place_of(site)) for site in also]
    low = np.min([known.min(axis=0) - far, *(np.array(point) - near for point in others)], axis=0)
    high = np.max([known.max(axis=0) + far, *(np.array(point) + near for point in others)], axis=0)
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def extent_of(look: PlaceShape, scene: Scene, visited: Iterable[Site]) -> style.Box:
    """Return the frame around start, goal and the visited places, with a cell to spare.

    A workspace that is not much larger is shown whole, and so are obstacles that are not far.
    """
    system = scene.system
    sites = (*scene.start, *(scene.goal or ()), *visited)
    known = np.array([look.middle(system, system.place_of(site)) for site in sites])
    near = look.margin + 1
    left, low = known.min(axis=0) - near
    right, high = known.max(axis=0) + near
    if system.places:
        whole = frame_of(look, scene, sites)
        if system.bounded:
            left, right = max(left, whole[0]), min(right, whole[1])
            low, high = max(low, whole[2]), min(high, whole[3])
        wide, tall = whole[1] - whole[0], whole[3] - whole[2]
        small = max(wide, tall) - 2 * look.margin < _LARGE
        if small or (right - left) * (high - low) > wide * tall / 2:
            return whole
    return float(left), float(right), float(low), float(high)


def draw_places(
    pen: PlacePen,
    scene: Scene,
    sites: Sequence[Site],
    moved: Mapping[int, Site],
    words: bool | None,  # noqa: FBT001 - as `Style.draw` has it
) -> None:
    """Draw the modules, the goal and, if there is room, labels or numbers on the modules."""
    system = scene.system
    colours = pen.palette(len(sites))
    left = {number: system.place_of(site) for number, site in moved.items()}
    places = [system.place_of(site) for site in sites]
    places = [left[n] if n in pen.poses else place for n, place in enumerate(places)]
    draw_modules(pen, left, places, colours, ways=True)
    draw_goals(pen, scene, sites)
    if style.readable(pen, words) and pen.theme.modules is None:
        for number, site in enumerate(sites):
            label = system.label_of(site)
            word = str(number if label is None else label)
            pen.write(pen.posed_middle(number, places[number]), word, colours[number])


def draw_goals(pen: PlacePen, scene: Scene, sites: Sequence[Site]) -> None:
    """Draw the outlines of the goal; with labels in the colours of the modules that belong there.

    `sites` are those of the modules by number, at any time: modules keep their labels.
    """
    system, goals, colours = scene.system, list(scene.goal or ()), style.palette(len(sites))
    by_label = {system.label_of(site): colours[number] for number, site in enumerate(sites)}
    labels = [system.label_of(site) for site in goals]
    hues = [style.GOAL if label is None else by_label[label] for label in labels]
    at = [system.place_of(site) for site in goals]
    pen.draw("goal", at, facecolors="none", edgecolors=hues, linewidths=pen.line(0.09))


def draw_modules(
    pen: PlacePen,
    left: Mapping[int, Site],
    places: Sequence[Site],
    colours: Sequence[style.Colour],
    *,
    ways: bool,
) -> None:
    """Draw modules by number, with an outline and a trace for those that left another place.

    `places` are where modules are, or where those were that are on their way.
    """
    hues = [colours[number] for number in left]
    pen.draw("module", list(left.values()), facecolors=hues, alpha=0.3, linewidths=0)
    if ways:
        lines = [
            np.array(
                [pen.middle(place), *pen.posed(number, np.array([pen.middle(places[number])]))]
            )
            for number, place in left.items()
        ]
        pen.strokes(lines, colors=hues, linewidths=0.1 * pen.scale, alpha=0.6)
    rim = pen.theme.rim
    shapes = [pen.posed(n, pen.shape("module", place)) for n, place in enumerate(places)]
    pen.shapes(shapes, facecolors=colours, edgecolors=rim, linewidths=0.03 * pen.scale)
    stirred = [shapes[number] for number in left]
    pen.shapes(stirred, facecolors="none", edgecolors=style.INK, linewidths=pen.line(0.08))


def place_marks(
    scene: Scene, shots: Sequence[style.Shot], *, discs: bool = False, round_goal: bool = False
) -> Iterator[style.Mark]:
    """Yield the marks that `draw_places` makes, without those of the ground.

    `discs` says that modules are discs, `round_goal` that outlines of the goal are round as well.
    """
    if scene.goal and scene.system.labels is None:
        yield style.Mark("goal", edge=style.GOAL, is_round=round_goal)
    elif scene.goal:
        yield style.Mark("goal of the module of its colour", edge=style.WALL, is_round=round_goal)
    yield from style.moves_marks(shots, is_round=discs)


def place_style(
    look: PlaceShape,
    ground: Callable[[PlacePen], None],
    solid: Callable[[style.Spot], style.Solid],
    *,
    text: style.Text,
    marks: style.Marks,
    way: Callable[[Action, Site, Site], Way] = lambda *_: (),
) -> style.Style:
    """Return the style that draws modules place by place, on a ground and below the goal."""

    def middle(system: System, site: Site) -> style.Spot:
        return look.middle(system, system.place_of(site))

    def body(scene: Scene, site: Site) -> style.Body:
        at = middle(scene.system, site)
        return style.Body("cell", at, at)

    def behind(pen: style.Pen, scene: Scene) -> None:
        ground(place_pen(pen, scene.system, look))

    def draw(
        pen: style.Pen,
        scene: Scene,
        sites: Sequence[Site],
        moved: Mapping[int, Site],
        words: bool | None,  # noqa: FBT001 - as `Style.draw` has it
    ) -> None:
        behind(pen, scene)
        draw_places(place_pen(pen, scene.system, look), scene, sites, moved, words)

    def before(pen: style.Pen, scene: Scene) -> None:
        draw_goals(place_pen(pen, scene.system, look), scene, scene.start)

    return style.Style(
        text=text,
        frame=partial(frame_of, look),
        extent=partial(extent_of, look),
        draw=draw,
        marks=marks,
        moving=style.MovingPart(
            body, behind, before, outline=look.outline("module", None), way=way
        ),
        solid=lambda system, site: solid(middle(system, site)),
    )


def vehicle_solid(spot: style.Spot) -> style.Solid:
    """Return the solid of a vehicle, on a map or on a graph."""
    return style.disc_at(spot, _DISC)


_MANY = 40
"""With more vertices, the text of a graph of vehicles lists only modules and goals."""


def _middle(system: System, place: Site) -> style.Spot:
    found = style.spot_of(system, place)
    if found is None and system.dimension in (2, 3):
        found = style.flat(system.coordinates(place))
        # Cells of several orbits have the same coordinates, as edges at one vertex do.
        tail = place[system.dimension :] if isinstance(place, tuple) else ()
        found = found[0] + 0.35 * sum(tail), found[1]
    found = found or _circle(system.places).get(place)
    if found is None:
        raise InputError(f"{place!r} cannot be drawn: it has no position and is none of the places")
    return found


@lru_cache(maxsize=64)
def _circle(vertices: tuple[Site, ...]) -> dict[Site, style.Spot]:
    """Return the vertices on a circle, clockwise from the top, far enough apart."""
    radius = max(1.0, len(vertices) * 1.5 / (2 * pi))
    turns = [pi / 2 - 2 * pi * number / len(vertices) for number in range(len(vertices))]
    return {
        vertex: (radius * cos(turn), radius * sin(turn))
        for vertex, turn in zip(vertices, turns, strict=True)
    }


_LOOK = PlaceShape(_middle, lambda kind, _: disc(kind), 0.7)


def _ground(pen: PlacePen) -> None:
    """Draw edges as lines and vertices as pale discs."""
    lines = [np.array([pen.middle(end) for end in edge]) for edge in pen.system.lines()]
    pen.strokes(lines, colors=style.LINE, linewidths=pen.line(0.05))
    width = pen.line(0.04)
    pen.draw(
        "cell", pen.system.places, facecolors=style.TILE, edgecolors=style.LINE, linewidths=width
    )
    fixed = [pen.system.place_of(site) for site in pen.system.filled]
    pen.draw("module", fixed, facecolors=style.WALL)


def _marks(scene: Scene, shots: Sequence[style.Shot], _box: style.Box) -> Iterator[style.Mark]:
    yield from place_marks(scene, shots, discs=True, round_goal=True)
    if scene.system.filled:
        yield style.Mark("fixed", face=style.WALL, is_round=True)


def _text(scene: Scene, sites: Sequence[Site]) -> str:
    """Return a line for each vertex, with its neighbours."""
    system = scene.system
    marks = style.marks_of(scene, sites)
    places = list(dict.fromkeys((*style.known_places(scene), *marks)))
    if system.graph is not None:
        every = system.graph.vertices
        places = [place for place in every if len(every) <= _MANY or place in marks]
    names = [_name(place) for place in places]
    wide, width = max(map(len, names)), max(map(len, marks.values()))
    lines = []
    for place, name in zip(places, names, strict=True):
        near = " ".join(_name(other) for other in system.sensed(place) if other is not None)
        lines.append(f"{name:>{wide}}: {marks.get(place, '.'):<{width}} - {near}")
    return "\n".join(lines)


def _name(place: Site) -> str:
    return place if isinstance(place, str) else site_text(place)


GRAPH = place_style(_LOOK, _ground, vehicle_solid, text=_text, marks=_marks)


def _marks_of_unknown(
    scene: Scene, shots: Sequence[style.Shot], box: style.Box
) -> Iterator[style.Mark]:
    yield from _marks(scene, shots, box)
    yield style.Mark(f"drawn as a graph, not as {scene.system.drawing!r}")


UNKNOWN = replace(GRAPH, marks=_marks_of_unknown)
"""That of a graph, for what no style can draw."""
