"""Cells in rows: hexagons, squares, and maps of squares, as text and on axes.

It draws only what it is given. On a map y counts downwards, vehicles are discs, and cells that are
no places are walls.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from math import ceil, floor, pi, sqrt

import numpy as np

from cubepath.agents.rendering import style
from cubepath.agents.rendering.places import (
    FREE_MAX,
    PlacePen,
    PlaceShape,
    disc,
    place_marks,
    place_style,
    vehicle_solid,
)
from cubepath.agents.rendering.ways import way_in
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import CLOSED, EMPTY, FILLED, Scene, System

_GROUND = {EMPTY: ".", FILLED: "#", CLOSED: " "}
_MARGIN = 0.6
_ACROSS = 0.93
"""Across a hexagon in three dimensions, in cells."""


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


HEXAGONS = place_style(
    PlaceShape(_HEXAGON_ROWS.middle, lambda kind, _: _hexagon(kind), _MARGIN),
    partial(_lattice_ground, _HEXAGON_ROWS),
    lambda spot: style.disc_at(spot, _ACROSS),
    text=partial(_text, hexagons=True, on_map=False),
    marks=partial(_marks, rows=_HEXAGON_ROWS, on_map=False),
    way=partial(way_in, "hexagons", _HEXAGON_ROWS.spot),
)
SQUARES = place_style(
    PlaceShape(_SQUARE_ROWS.middle, lambda kind, _: _square(kind), _MARGIN),
    partial(_lattice_ground, _SQUARE_ROWS),
    style.box_at,
    text=partial(_text, hexagons=False, on_map=False),
    marks=partial(_marks, rows=_SQUARE_ROWS, on_map=False),
    way=partial(way_in, "squares", _SQUARE_ROWS.spot),
)
MAP = place_style(
    PlaceShape(
        _MAP_ROWS.middle, lambda kind, _: disc(kind) if kind == "module" else _square(kind), _MARGIN
    ),
    partial(_map_ground, _MAP_ROWS),
    vehicle_solid,
    text=partial(_text, hexagons=False, on_map=True),
    marks=partial(_marks, rows=_MAP_ROWS, on_map=True),
)
