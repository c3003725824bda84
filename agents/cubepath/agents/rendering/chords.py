"""Chords between points: the diagonals of a triangulation, as text and on axes.

It draws only what it is given.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import sqrt

import numpy as np

from cubepath.agents.rendering import style
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import CLOSED, Scene, System

_MARGIN, _THICK = 0.6, 0.13
_APART, _WIDER = 1.6, 2.5
"""The distance between points, in cells, if they are spread evenly; and if there are many."""
_DISC, _DOT = 0.28, 0.11
"""In cells: the radius of a point with its number in it, and of one without."""
_INSIDE, _OUTSIDE, _NAME, _AWAY = 0.62, 1.0, 0.3, 0.46
"""The size of a number in its point and beside it; in cells its room there, and how far off."""
_SIDES = 16
_FEW = 24
"""More points than this are many."""
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


def _spots(system: System) -> dict[Site, style.Spot]:
    """Return where the points lie, in cells."""
    known = np.array([style.spot_of(system, point) for point in system.positions])
    spread = known.max(axis=0) - known.min(axis=0)
    area = max(float(spread[0] * spread[1]), 1e-3 * float(spread.max()) ** 2)
    apart = _APART if len(known) <= _FEW else _WIDER
    unit = sqrt(area / len(known)) / apart or 1.0
    cells = (known - known.min(axis=0)) / unit
    return {point: (x, y) for point, (x, y) in zip(system.positions, cells.tolist(), strict=True)}


def _frame(scene: Scene, _also: Iterable[Site]) -> style.Box:
    return style.frame_around(_spots(scene.system).values(), _MARGIN)


def _draw(
    pen: style.Pen,
    scene: Scene,
    sites: Sequence[Site],
    moved: Mapping[int, Site],
    words: bool | None,  # noqa: FBT001 - as `Style.draw` has it
) -> None:
    """Draw chords in the colours of their modules, fixed edges dark, and the points on top.

    The goal lies below as pink bands. If a chord has just flipped, its quadrilateral is tinted, and
    the chord has a dark outline. `words` numbers the points.
    """
    system, written = scene.system, style.readable(pen, words)
    spots = _spots(system)

    def line(chord: Site) -> style.Points:
        return _line(spots, chord)

    colours = pen.palette(len(sites))
    hues = [colours[number] for number in moved]
    thick = _thickness(pen)
    for number, hue in zip(moved, hues, strict=True):
        (a, b), (c, d) = line(moved[number]), line(sites[number])
        pen.shapes([np.array([a, c, b, d])], facecolors=[hue], alpha=0.3, linewidths=0)
    _behind(pen, scene)
    stirred = [line(sites[number]) for number in moved]
    pen.strokes(stirred, colors=style.INK, linewidths=thick + 2 * pen.line(0.05))
    pen.strokes([line(site) for site in sites], colors=colours, linewidths=thick)
    _points(pen, scene, written=written)


def _line(spots: Mapping[Site, style.Spot], chord: Site) -> style.Points:
    return np.array([spots[end] for end in _ends(chord)])


def _thickness(pen: style.Pen) -> float:
    return pen.line(_THICK, 1.0, 6.0)


def _behind(pen: style.Pen, scene: Scene) -> None:
    """Draw the goal as bands, and the edges that stay."""
    spots, thick = _spots(scene.system), _thickness(pen)
    pen.strokes(
        [_line(spots, chord) for chord in scene.goal or ()],
        colors=style.PALE_GOAL,
        linewidths=(2.6 if len(spots) <= _FEW else 1.9) * thick,
        capstyle="round",
    )
    fixed = [_line(spots, chord) for chord in scene.system.filled]
    pen.strokes(fixed, colors=style.WALL, linewidths=0.6 * thick, capstyle="round")


def _closest(spots: Iterable[style.Spot]) -> float:
    """Return the least distance of two points, in cells."""
    known = np.array(list(spots))
    return min(
        float(np.hypot(*(known[number + 1 :] - known[number]).T).min())
        for number in range(len(known) - 1)
    )


def _beside(spots: Mapping[Site, style.Spot], box: style.Box) -> dict[Site, style.Spot]:
    """Return where the numbers of points are written that have no room for them inside.

    One after another they are put to the side where other points and numbers are farthest off.
    """
    left, right, low, high = box
    taken = [np.array(spot) for spot in spots.values()]
    found: dict[Site, style.Spot] = {}
    for own, (point, spot) in enumerate(spots.items()):
        sides = np.array(spot) + style.arcs([(0.0, 0.0)], _AWAY, corners=_SIDES)
        others = np.array([other for number, other in enumerate(taken) if number != own])
        room = np.hypot(*(sides[:, None] - others).T).min(axis=0)
        edges = np.stack(
            [sides[:, 0] - left, right - sides[:, 0], sides[:, 1] - low, high - sides[:, 1]]
        ).min(axis=0)
        # Rounded, so that the last bits of a distance do not decide.
        room = np.minimum(room, 2 * edges).round(6)
        x, y = sides[int(np.argmax(room))].tolist()
        found[point] = (x, y)
        taken.append(np.array((x, y)))
    return found


def _points(pen: style.Pen, scene: Scene, *, written: bool = True) -> None:
    """Draw the points, and their numbers where they are written: in them, or else beside them."""
    spots = _spots(scene.system)
    inside = written and _closest(spots.values()) >= 2 * _DISC
    pen.discs(spots.values(), _DISC if inside else _DOT, facecolors="white")
    names = spots if inside else _beside(spots, pen.box)
    for point, spot in names.items() if written else ():
        if not inside:
            pen.shapes([style.arcs([spot], _NAME)], facecolors="white", alpha=0.75, linewidths=0)
        pen.write(spot, str(point), None, size=_INSIDE if inside else _OUTSIDE)


def _body(scene: Scene, site: Site) -> style.Body:
    one, other = _line(_spots(scene.system), site).tolist()
    return style.Body("bar", (one[0], one[1]), (other[0], other[1]))


def _marks(scene: Scene, shots: Sequence[style.Shot], _box: style.Box) -> Iterator[style.Mark]:
    if scene.goal:
        yield style.Mark("goal", face=style.PALE_GOAL)
    if scene.system.filled:
        yield style.Mark("fixed edge", face=style.WALL)
    if any(moved for _, moved in shots):
        yield style.Mark("has just flipped", edge=style.INK)
        yield style.Mark("quadrilateral of a flip", face=style.GHOST)


def _ends(chord: Site) -> tuple[Site, Site]:
    if isinstance(chord, tuple) and len(chord) == 2:
        return chord[0], chord[1]
    raise InputError(f"a chord is a pair of points, found {chord!r}")


def _solid(system: System, site: Site) -> style.Solid:
    one, other = _ends(site)
    spots = _spots(system)
    return style.bar(spots[one], spots[other])


CHORDS = style.Style(
    text=_text,
    frame=_frame,
    extent=_frame,
    draw=_draw,
    marks=_marks,
    solid=_solid,
    moving=style.MovingPart(_body, _behind, _points, thick=_THICK),
)
