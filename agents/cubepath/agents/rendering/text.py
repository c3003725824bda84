"""Where the modules are, as text: the "ansi" render mode.

Room: agents; draws what it is given and asks nobody.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from cubepath.agents.rendering import chords, letters
from cubepath.agents.rendering.joints import MARK, marked, segments
from cubepath.agents.rendering.layout import cell_of, is_endless, known_places, label_of, tips_of
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.core.system import CLOSED, EMPTY, FILLED, Scene, System
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.systems.listed import TabledSystem

MODULE_MARK, ARRIVED_MARK, GOAL_MARK = "o", "@", "+"
"""How an unlabelled module shows in text, off and on a goal cell, and a goal cell without one."""
_GROUND = {EMPTY: ".", FILLED: "#", CLOSED: " "}
_OWN = {"chords": chords.text, "letters": letters.text}
"""What is not written place by place."""
_MANY = 40
"""From so many vertices on a general graph is told by its modules and goals alone."""


def draw_text(scene: Scene, sites: Sequence[Site]) -> str:
    """Return a picture in plain text of modules at `sites`, by number.

    A module is ``o``, or ``@`` on a cell of the goal; a free cell of the goal is ``+``, any other
    ``.``, and an occupied obstacle or a hole in a map ``#``. A labelled module shows its label,
    with ``*`` behind it at its own goal. Hexagons stand in rows offset by half a cell; segments of
    an arm are ``---`` and ``|`` between vertices, ``===`` and ``H`` where the goal wants them, and
    ``...`` and ``:`` where the goal is not there yet; a marked vertex is ``*``. A general graph has
    a line for each vertex, with its neighbours. The frame holds start, goal and finite workspaces,
    so that pictures of one run line up as long as modules stay in it. Chords and letters are
    written as `chords.text` and `letters.text` say.
    """
    drawing = scene.system.drawing
    if drawing == "edges":
        return _edges_text(scene, sites)
    if drawing in _OWN and isinstance(scene.system, TabledSystem):
        return _OWN[drawing](scene, scene.system, sites)
    if drawing == "graph":
        return _graph_text(scene, sites)
    return _cells_text(scene, sites)


def _marks(scene: Scene, sites: Sequence[Site]) -> dict[Site, str]:
    """Return what to write at each place that has a module or is of the goal."""
    system, goal = scene.system, scene.goal or frozenset()
    marks = {system.place_of(site): GOAL_MARK for site in goal}
    for site in sites:
        label, arrived = label_of(system, site), site in goal
        if label is None:
            mark = ARRIVED_MARK if arrived else MODULE_MARK
        else:
            mark = f"{label}*" if arrived else str(label)
        marks[system.place_of(site)] = mark
    return marks


def _cells_text(scene: Scene, sites: Sequence[Site]) -> str:
    system = scene.system
    hexagons = system.drawing == "hexagons"
    marks = _marks(scene, sites)
    width = max(len(mark.rstrip("*")) for mark in marks.values())
    # On an endless lattice, room for one module more on every side of the scene.
    margin = 1 if is_endless(system) else 0
    rows, columns = set(), set()
    for places, free in ((known_places(scene), margin), (marks, 0)):
        for cell in map(cell_of, places):
            # A hexagon (q, r) lies in row r, at 2 q + r half cells; a square (x, y) at 2 x.
            middle = 2 * cell[0] + (cell[1] if hexagons else 0)
            rows |= {cell[1] - free, cell[1] + free}
            columns |= {middle - 2 * free, middle + 2 * free}
    first, last = min(columns), max(columns)
    half = (width + 2) // 2 if hexagons else (width + 1) / 2
    wall = "#" if isinstance(system, GraphSystem) else " "
    lines = []
    for row in _downwards(system, min(rows), max(rows)):
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


def _downwards(system: System, lowest: int, highest: int) -> Iterable[int]:
    """Return the rows from top to bottom: maps count downwards, lattices upwards."""
    if isinstance(system, GraphSystem):
        return range(lowest, highest + 1)
    return range(highest, lowest - 1, -1)


def _edges_text(scene: Scene, sites: Sequence[Site]) -> str:
    marks = _marks(scene, sites)
    flat = {MODULE_MARK: "---", ARRIVED_MARK: "===", GOAL_MARK: "..."}
    upright = {MODULE_MARK: "|", ARRIVED_MARK: "H", GOAL_MARK: ":"}
    filled = dict.fromkeys(scene.system.filled, "#")
    tips = [tip for edge in (*known_places(scene), *marks) for tip in tips_of(edge)]
    left, right = min(x for x, _ in tips), max(x for x, _ in tips)
    low, high = min(y for _, y in tips), max(y for _, y in tips)
    busy = {tip for edge in (*segments(sites).sites, *filled) for tip in tips_of(edge)}
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


def _graph_text(scene: Scene, sites: Sequence[Site]) -> str:
    system = scene.system
    marks = _marks(scene, sites)
    places = list(dict.fromkeys((*known_places(scene), *marks)))
    if isinstance(system, GraphSystem):
        places = [
            place for place in system.vertices if len(system.vertices) <= _MANY or place in marks
        ]
    names = [_name(place) for place in places]
    wide, width = max(map(len, names)), max(map(len, marks.values()))
    lines = []
    for place, name in zip(places, names, strict=True):
        near = " ".join(_name(other) for other in system.sensed(place) if other is not None)
        lines.append(f"{name:>{wide}}: {marks.get(place, '.'):<{width}} - {near}")
    return "\n".join(lines)


def _name(place: Site) -> str:
    return place if isinstance(place, str) else site_text(place)
