"""What a module senses, drawn as text: the cells around it and who stands on them.

Only of systems whose places are cells of the plane.
"""

from __future__ import annotations

from collections.abc import Mapping

from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.core.system import System

_SHIFTED, _STRAIGHT, _DOWNWARDS = "hexagons", "squares", "map"
"""The drawings whose places are cells; rows of hexagons are shifted against each other."""
_MARKS = {"empty": ".", "filled": "#", "closed": "#"}


def picture_of(system: System, module: int, site: Site, sensed: Mapping[str, str]) -> str | None:
    """Return the places that a module at `site` senses, in lines; None if they are no cells.

    `sensed` has what is at each place, as `Side` has it. Modules are their numbers, the one at
    `site` in brackets. Rows go upwards, on a map downwards.
    """
    place = system.place_of(site)
    own = _cell(place)
    if system.drawing not in (_SHIFTED, _STRAIGHT, _DOWNWARDS) or own is None:
        return None
    marks: dict[tuple[int, int], str] = {}
    for near in system.sensed(place):
        if near is None:
            continue
        cell = _cell(near)
        if cell is None:
            return None
        what = sensed.get(site_text(near), "empty")
        marks[cell] = _MARKS.get(what) or what.split()[0].removeprefix("module_")
    marks[own] = f"({module})"
    return _rows(marks, shifted=system.drawing == _SHIFTED, down=system.drawing == _DOWNWARDS)


def _cell(place: Site) -> tuple[int, int] | None:
    match place:
        case (int(x), int(y)):
            return x, y
        case _:
            return None


def _rows(marks: Mapping[tuple[int, int], str], *, shifted: bool, down: bool) -> str:
    """Return the rows; a cell takes as many characters as the widest mark, and one more."""
    half = (max(map(len, marks.values())) + 2) // 2
    middles = {(x, y): 2 * x + (y if shifted else 0) for x, y in marks}
    first = min(middles.values())
    lines: list[str] = []
    rows = [y for _, y in marks]
    for row in sorted(range(min(rows), max(rows) + 1), reverse=not down):
        line = ""
        for (x, y), mark in sorted(marks.items()):
            if y == row:
                line = line.ljust((middles[x, y] - first) * half) + mark.center(2 * half - 1)
        lines.append(line.rstrip())
    return "\n".join(lines)
