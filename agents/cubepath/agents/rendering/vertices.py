"""Vertices of a graph, joined by lines, as text and on axes.

It only draws what it is given. Vertices lie where the system says, or on a circle.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache, partial
from math import cos, pi, sin

import numpy as np

from cubepath.agents.rendering.pen import LINE, TILE, WALL, Box, Mark, Pen, Shot, Spot
from cubepath.agents.rendering.places import (
    PlacePen,
    PlaceShape,
    disc,
    disc_solid,
    draw_goals,
    draw_places,
    extent_of,
    frame_of,
    place_body,
    place_marks,
    place_pen,
)
from cubepath.agents.rendering.style import MovingPart, Style, known_places, marks_of, spot_of
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.core.system import Scene, System

_MANY = 40
"""With more vertices, the text of a graph of vehicles lists only modules and goals."""


def _middle(system: System, place: Site) -> Spot:
    found = spot_of(system, place) or _circle(system.places).get(place)
    if found is None:
        raise InputError(f"{place!r} cannot be drawn: it has no position and is none of the places")
    return found


@lru_cache(maxsize=64)
def _circle(vertices: tuple[Site, ...]) -> dict[Site, Spot]:
    """Return the vertices on a circle, clockwise from the top, far enough apart."""
    radius = max(1.0, len(vertices) * 1.5 / (2 * pi))
    turns = [pi / 2 - 2 * pi * number / len(vertices) for number in range(len(vertices))]
    return {
        vertex: (radius * cos(turn), radius * sin(turn))
        for vertex, turn in zip(vertices, turns, strict=True)
    }


_LOOK = PlaceShape(_middle, lambda kind, _: disc(kind), 0.7)


def _draw(
    pen: Pen,
    scene: Scene,
    sites: Sequence[Site],
    moved: Mapping[int, Site],
    words: bool | None,  # noqa: FBT001 - as `Style.draw` has it
) -> None:
    places = place_pen(pen, scene.system, _LOOK)
    _ground(places)
    draw_places(places, scene, sites, moved, words)


def _ground(pen: PlacePen) -> None:
    """Draw edges as lines and vertices as pale discs."""
    lines = [np.array([pen.middle(end) for end in edge]) for edge in pen.system.lines()]
    pen.strokes(lines, colors=LINE, linewidths=pen.line(0.05))
    width = pen.line(0.04)
    pen.draw("cell", pen.system.places, facecolors=TILE, edgecolors=LINE, linewidths=width)
    fixed = [pen.system.place_of(site) for site in pen.system.filled]
    pen.draw("module", fixed, facecolors=WALL)


def _behind(pen: Pen, scene: Scene) -> None:
    _ground(place_pen(pen, scene.system, _LOOK))


def _before(pen: Pen, scene: Scene) -> None:
    draw_goals(place_pen(pen, scene.system, _LOOK), scene, scene.start)


def _marks(scene: Scene, shots: Sequence[Shot], _box: Box) -> Iterator[Mark]:
    yield from place_marks(scene, shots, discs=True, round_goal=True)
    if scene.system.filled:
        yield Mark("fixed", face=WALL, is_round=True)


def _text(scene: Scene, sites: Sequence[Site]) -> str:
    """Return a line for each vertex, with its neighbours."""
    system = scene.system
    marks = marks_of(scene, sites)
    places = list(dict.fromkeys((*known_places(scene), *marks)))
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


GRAPH = Style(
    text=_text,
    frame=partial(frame_of, _LOOK),
    extent=partial(extent_of, _LOOK),
    draw=_draw,
    marks=_marks,
    moving=MovingPart(_behind, _before, partial(place_body, _LOOK), outline=disc("module")),
    solid=partial(disc_solid, _LOOK),
)
