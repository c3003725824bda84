"""Chords between points: the diagonals of a triangulation, as text and on axes.

Room: agents. It only draws what it is given.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import sqrt

import numpy as np

from cubepath.agents.rendering.layout import spot_of
from cubepath.agents.rendering.marks import Mark, Shot
from cubepath.agents.rendering.pen import (
    GHOST,
    INK,
    PALE_GOAL,
    WALL,
    Box,
    Pen,
    Points,
    Spot,
    palette,
)
from cubepath.agents.rendering.style import Style, readable
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import CLOSED, Scene, System

_MARGIN = 0.6
_APART = 1.6
"""The distance between points, in cells, if they are spread evenly."""
_TABLE_MAX = 40
"""With more points than this, text lists the chords instead of a table."""


def _text(scene: Scene, sites: Sequence[Site]) -> str:
    """Return a table with a row and a column for each point, and a mark for each chord.

    A module is ``o``, or ``@`` if the goal has it; a missing chord of the goal is ``+``. A fixed
    edge is ``#``, and a possible chord ``.``. With many points, the text lists only the chords: a
    line for each point, with the points that it is joined to.
    """
    system = scene.system
    goal = scene.goal or frozenset()
    marks = dict.fromkeys(goal, "+") | {site: "@" if site in goal else "o" for site in sites}
    marks |= dict.fromkeys(system.filled, "#")
    points = sorted(system.positions, key=_number)
    wide = max(len(str(point)) for point in points)
    lines = []
    if len(points) > _TABLE_MAX:
        for one in points:
            joined = [f"{marks[one, b]}{b}" for b in points if (one, b) in marks]
            if joined:
                lines.append(f"{one!s:>{wide}}: {' '.join(joined)}")
        return "\n".join(lines)
    for one in points[:-1]:
        row = [
            " " if points.index(other) <= points.index(one) else _mark(system, marks, (one, other))
            for other in points
        ]
        lines.append(f"{one!s:>{wide}} " + " ".join(f"{mark:>{wide}}" for mark in row))
    head = " ".join(f"{point!s:>{wide}}" for point in points)
    return "\n".join([f"{'':>{wide}} {head}", *(line.rstrip() for line in lines)])


def _number(point: Site) -> tuple[bool, str, int]:
    return (True, "", point) if isinstance(point, int) else (False, str(point), 0)


def _mark(system: System, marks: Mapping[Site, str], chord: Site) -> str:
    return marks.get(chord) or (" " if system.background(chord) == CLOSED else ".")


def _spots(system: System) -> dict[Site, Spot]:
    """Return where the points lie, in cells."""
    known = np.array([spot_of(system, point) for point in system.positions])
    spread = known.max(axis=0) - known.min(axis=0)
    area = max(float(spread[0] * spread[1]), 1e-3 * float(spread.max()) ** 2)
    unit = sqrt(area / len(known)) / _APART or 1.0
    cells = (known - known.min(axis=0)) / unit
    return {point: (x, y) for point, (x, y) in zip(system.positions, cells.tolist(), strict=True)}


def _frame(scene: Scene, _also: Iterable[Site]) -> Box:
    """Return left, right, low and high of the points, in cells."""
    known = np.array(list(_spots(scene.system).values()))
    (left, low), (right, high) = known.min(axis=0) - _MARGIN, known.max(axis=0) + _MARGIN
    return float(left), float(right), float(low), float(high)


def _draw(
    pen: Pen,
    scene: Scene,
    sites: Sequence[Site],
    moved: Mapping[int, Site],
    words: bool | None,  # noqa: FBT001 - as `Style.draw` has it
) -> None:
    """Draw chords in the colours of their modules, fixed edges dark, and the points on top.

    The goal lies below as pink bands. If a chord has just flipped, its quadrilateral is tinted, and
    the chord has a dark outline. `words` numbers the points.
    """
    system, written = scene.system, readable(pen, words)
    spots = _spots(system)

    def line(chord: Site) -> Points:
        return np.array([spots[end] for end in _ends(chord)])

    colours = palette(len(sites))
    hues = [colours[number] for number in moved]
    thick = min(max(0.13 * pen.scale, 1.2), 6.0)
    for number, hue in zip(moved, hues, strict=True):
        (a, b), (c, d) = line(moved[number]), line(sites[number])
        pen.shapes([np.array([a, c, b, d])], facecolors=[hue], alpha=0.3, linewidths=0)
    pen.strokes(
        [line(chord) for chord in scene.goal or ()],
        colors=PALE_GOAL,
        linewidths=2.6 * thick,
        capstyle="round",
    )
    fixed = [line(chord) for chord in system.filled]
    pen.strokes(fixed, colors=WALL, linewidths=0.6 * thick, capstyle="round")
    stirred = [line(sites[number]) for number in moved]
    pen.strokes(stirred, colors=INK, linewidths=thick + 2 * pen.line(0.05))
    pen.strokes([line(site) for site in sites], colors=colours, linewidths=thick)
    size = 0.28 if written else 0.1
    pen.discs(spots.values(), size, facecolors="white")
    if written:
        for point, spot in spots.items():
            pen.write(spot, str(point), (1.0, 1.0, 1.0), size=0.62)


def _marks(scene: Scene, shots: Sequence[Shot], _box: Box) -> Iterator[Mark]:
    if scene.goal:
        yield Mark("goal", face=PALE_GOAL)
    if scene.system.filled:
        yield Mark("fixed edge", face=WALL)
    if any(moved for _, moved in shots):
        yield Mark("has just flipped", edge=INK)
        yield Mark("quadrilateral of a flip", face=GHOST)


def _ends(chord: Site) -> tuple[Site, Site]:
    if isinstance(chord, tuple) and len(chord) == 2:
        return chord[0], chord[1]
    raise InputError(f"a chord is a pair of points, found {chord!r}")


CHORDS = Style(text=_text, frame=_frame, extent=_frame, draw=_draw, marks=_marks)
