"""Cells in rows: hexagons, squares, and maps of squares, as text and on axes.

It draws only what it is given. On a map y counts downwards, vehicles are discs, and cells that are
no places are walls.
"""

from cmath import phase
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from math import ceil, floor, pi, sqrt

import numpy as np

from cubepath.agents.rendering import style
from cubepath.agents.rendering.places import (
    FREE_MAX,
    PlacePen,
    PlaceShape,
    disc,
    disc_solid,
    draw_goals_alone,
    draw_places,
    extent_of,
    frame_of,
    hexagon_solid,
    place_body,
    place_marks,
    place_pen,
    square_solid,
)
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import HEX_DIRECTIONS
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import CLOSED, EMPTY, FILLED, Scene, System

_GROUND = {EMPTY: ".", FILLED: "#", CLOSED: " "}
_MARGIN = 0.6


@dataclass(frozen=True, slots=True)
class _Rows:
    """The layout of rows of cells: shifted against the row below or not, upwards or downwards."""

    slant: float
    stretch: float
    up: int

    def middle(self, _system: System, place: Site) -> style.Spot:
        return self.spot(place)

    def spot(self, place: Site) -> style.Spot:
        x, y = style.cell_of(place)
        return x + self.slant * y, self.up * y * self.stretch

    def cells(self, system: System, box: style.Box) -> list[tuple[int, int]]:
        """Return the cells in a box; on an endless lattice, one more on each side."""
        left, right, low, high = _wider(system, box)
        return [
            (column, self.up * row)
            for row in range(ceil(low / self.stretch), floor(high / self.stretch) + 1)
            for column in range(ceil(left - self.slant * row), floor(right - self.slant * row) + 1)
        ]

    def shows(self, system: System, box: style.Box, place: Site) -> bool:
        """Return whether a cell is one of those in a box."""
        left, right, low, high = _wider(system, box)
        x, y = self.spot(place)
        return left <= x <= right and low <= y <= high


def _wider(system: System, box: style.Box) -> style.Box:
    left, right, low, high = box
    more = 0 if system.bounded else 1
    return left - more, right + more, low - more, high + more


_HEXAGON_ROWS, _SQUARE_ROWS, _MAP_ROWS = _Rows(0.5, sqrt(3) / 2, 1), _Rows(0, 1, 1), _Rows(0, 1, -1)


@cache
def _hexagon(kind: str) -> style.Points:
    size = {"module": 0.93, "goal": 0.86, "cell": 1.0}[kind]
    return style.arcs([(0, 0)], size / sqrt(3), corners=6, first=pi / 6)


@cache
def _square(kind: str) -> style.Points:
    corner = 0.05 if kind == "cell" else 0.14
    half = 0.47 if kind == "cell" else 0.44
    inner = half - corner
    return style.arcs([(inner, inner), (-inner, inner), (-inner, -inner), (inner, -inner)], corner)


def _free_cells(pen: PlacePen, cells: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    free = [cell for cell in cells if pen.system.has_place(cell)]
    if len(free) <= FREE_MAX:
        pen.draw("cell", free, facecolors=style.TILE, edgecolors="white", linewidths=pen.line(0.06))
    return free


def _lattice_ground(rows: _Rows, pen: PlacePen) -> None:
    """Draw free cells pale, and the obstacles of either kind."""
    system = pen.system
    cells = [style.cell_of(site) for site in system.empty | system.filled]
    left, right, low, high = pen.box
    # Too many to be drawn would take long only to be found.
    if system.bounded or (right - left) * (high - low) / rows.stretch <= FREE_MAX + len(cells):
        cells = rows.cells(system, pen.box)
        _free_cells(pen, cells)
    pen.draw("module", [cell for cell in cells if cell in system.empty], facecolors=style.LINE)
    pen.draw("module", [cell for cell in cells if cell in system.filled], facecolors=style.WALL)


def _map_ground(rows: _Rows, pen: PlacePen) -> None:
    """Draw free cells pale and others dark; walls where neighbours do not meet."""
    system = pen.system
    cells = rows.cells(system, pen.box)
    free = _free_cells(pen, cells)
    pen.draw("cell", [cell for cell in cells if not system.has_place(cell)], facecolors=style.WALL)
    pen.strokes(_walls(system, free), colors=style.WALL, linewidths=pen.line(0.1))


def _walls(system: System, free: Iterable[tuple[int, int]]) -> list[style.Points]:
    return [
        np.array([(x + 0.5, -y - 0.5), (x + dx - 0.5, -y - dy + 0.5)])
        for x, y in free
        for dx, dy in ((1, 0), (0, 1))
        if system.has_place((x + dx, y + dy)) and (x + dx, y + dy) not in system.sensed((x, y))
    ]


def _draw_cells(
    pen: style.Pen,
    scene: Scene,
    sites: Sequence[Site],
    moved: Mapping[int, Site],
    words: bool | None,  # noqa: FBT001 - as `Style.draw` has it
    *,
    look: PlaceShape,
    rows: _Rows,
    on_map: bool,
) -> None:
    places = place_pen(pen, scene.system, look)
    (_map_ground if on_map else _lattice_ground)(rows, places)
    draw_places(places, scene, sites, moved, words)


def _behind(pen: style.Pen, scene: Scene, *, look: PlaceShape, rows: _Rows, on_map: bool) -> None:
    (_map_ground if on_map else _lattice_ground)(rows, place_pen(pen, scene.system, look))


def _hexagon_pivot(action: Action, source: Site, target: Site) -> style.Pivot | None:
    """Return how a hexagon turns about a corner of the one module that the move needs beside it.

    Two neighbouring hexagons have two common neighbours. If just one of them is on throughout the
    action, the module rolls along it: it turns about the corner where the three meet.
    """
    beside = _neighbours(source) & _neighbours(target)
    still = [cell for cell in beside if _stays_on(action, cell)]
    if target not in _neighbours(source) or len(still) != 1:
        return None
    one, other, third = (complex(*_HEXAGON_ROWS.spot(cell)) for cell in (source, target, still[0]))
    about = (one + other + third) / 3
    return _turned(about, phase((other - about) / (one - about)))


def _square_pivot(action: Action, source: Site, target: Site) -> style.Pivot | None:
    """Return how a square turns about a corner of a module that the move needs beside it.

    One that comes to a cell diagonally across turns by half, around the one module that stays on
    beside both cells. One that comes to the next cell turns by a quarter, along two modules that
    stay on at one side, if the move needs the two cells at the other side free, which it sweeps;
    otherwise it slides.
    """
    one, other = complex(*style.cell_of(source)), complex(*style.cell_of(target))
    way, middle = other - one, (one + other) / 2
    if abs(way.real) == abs(way.imag) == 1:
        sides = [complex(one.real, other.imag), complex(other.real, one.imag)]
        still = [_stays_on(action, _cell_at(side)) for side in sides]
        if still[0] == still[1]:
            return None
        free = sides[still[0]]
        return _turned(middle, 2 * phase((free - middle) / (one - middle)))
    if abs(way) != 1:
        return None
    for aside in (1j * way, -1j * way):
        along, across = ([_cell_at(each + to) for each in (one, other)] for to in (aside, -aside))
        if all(_stays_on(action, cell) for cell in along) and all(
            _stays_off(action, cell) for cell in across
        ):
            about = middle + aside / 2
            return _turned(about, phase((other - about) / (one - about)))
    return None


def _turned(about: complex, angle: float) -> style.Pivot:
    return style.Pivot((about.real, about.imag), angle)


def _cell_at(spot: complex) -> Site:
    return round(spot.real), round(spot.imag)


def _stays_on(action: Action, cell: Site) -> bool:
    return cell in action.ends[0] and cell in action.ends[1]


def _stays_off(action: Action, cell: Site) -> bool:
    on = action.ends[0] | action.ends[1] | action.free
    return cell in action.support and cell not in on


def _neighbours(cell: Site) -> frozenset[Site]:
    x, y = style.cell_of(cell)
    return frozenset((x + dx, y + dy) for dx, dy in HEX_DIRECTIONS)


def _marks(
    scene: Scene, shots: Sequence[style.Shot], box: style.Box, *, rows: _Rows, on_map: bool
) -> Iterator[style.Mark]:
    yield from place_marks(scene, shots, discs=on_map)
    system = scene.system
    if on_map:
        cells = rows.cells(system, box)
        free = [cell for cell in cells if system.has_place(cell)]
        if len(free) < len(cells) or _walls(system, free):
            yield style.Mark("wall", face=style.WALL)
        return
    if any(rows.shows(system, box, site) for site in system.filled):
        yield style.Mark("obstacle", face=style.WALL)
    if any(rows.shows(system, box, site) for site in system.empty):
        yield style.Mark("kept free", face=style.LINE)


def _text(scene: Scene, sites: Sequence[Site], *, hexagons: bool, on_map: bool) -> str:
    """Return rows of cells; hexagons stand in rows offset by half a cell."""
    system = scene.system
    marks = style.marks_of(scene, sites)
    width = max(len(mark.rstrip("*")) for mark in marks.values())
    # On an endless lattice, leave room for one more module on every side of the scene.
    margin = 0 if system.bounded else 1
    rows, columns = set(), set()
    for places, free in ((style.known_places(scene), margin), (marks, 0)):
        for cell in map(style.cell_of, places):
            # A hexagon (q, r) lies in row r, at 2 q + r half cells; a square (x, y) at 2 x.
            middle = 2 * cell[0] + (cell[1] if hexagons else 0)
            rows |= {cell[1] - free, cell[1] + free}
            columns |= {middle - 2 * free, middle + 2 * free}
    first, last = min(columns), max(columns)
    half = (width + 2) // 2 if hexagons else (width + 1) / 2
    wall = "#" if on_map else " "
    lines = []
    # Maps count downwards, lattices upwards.
    for row in sorted(range(min(rows), max(rows) + 1), reverse=not on_map):
        line = ""
        for column in range(first, last + 1):
            inner = column - row if hexagons else column
            if inner % 2:
                continue
            place = (inner // 2, row)
            mark = marks.get(place)
            if mark is None:
                mark = _GROUND[system.background(place)].replace(" ", wall)
            stands = mark.rstrip("*").rjust(width)
            line = line.ljust(int((column - first) * half)) + stands + mark[len(mark.rstrip("*")) :]
        lines.append(line.rstrip())
    return "\n".join(lines)


def _style(
    look: PlaceShape, rows: _Rows, *, hexagons: bool = False, on_map: bool = False
) -> style.Style:
    moving = style.MovingPart(
        behind=partial(_behind, look=look, rows=rows, on_map=on_map),
        before=partial(draw_goals_alone, look=look),
        body=partial(place_body, look),
        outline=look.outline("module", None),
    )
    if not on_map:  # vehicles drive
        moving = replace(moving, pivot=_hexagon_pivot if hexagons else _square_pivot)
    return style.Style(
        text=partial(_text, hexagons=hexagons, on_map=on_map),
        frame=partial(frame_of, look),
        extent=partial(extent_of, look),
        draw=partial(_draw_cells, look=look, rows=rows, on_map=on_map),
        marks=partial(_marks, rows=rows, on_map=on_map),
        moving=moving,
        solid=partial(disc_solid if on_map else hexagon_solid if hexagons else square_solid, look),
    )


HEXAGONS = _style(
    PlaceShape(_HEXAGON_ROWS.middle, lambda kind, _: _hexagon(kind), _MARGIN),
    _HEXAGON_ROWS,
    hexagons=True,
)
SQUARES = _style(
    PlaceShape(_SQUARE_ROWS.middle, lambda kind, _: _square(kind), _MARGIN), _SQUARE_ROWS
)
MAP = _style(
    PlaceShape(
        _MAP_ROWS.middle, lambda kind, _: disc(kind) if kind == "module" else _square(kind), _MARGIN
    ),
    _MAP_ROWS,
    on_map=True,
)
