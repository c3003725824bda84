"""Published benchmarks of vehicles: movingai scenarios, and the maps and scenarios of POGEMA.

Sources: movingai.com/benchmarks/formats.html (Sturtevant, Benchmarks for Grid-Based Pathfinding);
`algorithms/experiments` of github.com/Cognitive-AI-Systems/pogema-benchmark, YAML of one shape, the
only one that is read: a map is a block of rows under its name, a scenario begins with `agents_xy`,
and has `targets_xy` and `map_name`. There a cell is (row, column).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import Source, opened, read_text
from cubepath.protocol.systems.graphs import Graph, grid_graph

Cell = tuple[int, int]


@dataclass(frozen=True, slots=True)
class BenchmarkTask:
    """Where vehicles start and where each is to go, as cells (x, y) of the map of this name."""

    starts: tuple[Cell, ...]
    goals: tuple[Cell, ...]
    map_name: str


def task_from_scen(source: Source) -> BenchmarkTask:
    """Read a movingai scenario; n vehicles use its first n lines.

    A line has bucket, map, the map's width and height, start x and y, goal x and y, and a length.
    """
    with opened(source) as file:
        path, lines = file.path, file.text().splitlines()
    starts, goals, map_name = [], [], ""
    numbered = ((number, line.strip()) for number, line in enumerate(lines, 1) if line.strip())
    for number, line in list(numbered)[1:]:
        words = line.split()
        if len(words) != 9 or not all(re.fullmatch(r"[0-9]{1,9}", word) for word in words[2:8]):
            found = repr(line if len(line) <= 40 else f"{line[:40]}...")
            raise InputError(
                f"{path}:{number}: found {found}, expected bucket, map, width, height,"
                " start x y, goal x y, length"
            )
        map_name = map_name or words[1]
        from_x, from_y, to_x, to_y = map(int, words[4:8])
        starts.append((from_x, from_y))
        goals.append((to_x, to_y))
    if not starts:
        raise InputError(f"{path}: no vehicle, expected a first line 'version 1' and one for each")
    return BenchmarkTask(tuple(starts), tuple(goals), map_name)


_MAP = re.compile(r"""^(["']?)([\w. -]+)\1:[ ]*\|[-+]?[ ]*\n((?:[ ]+\S+[ ]*\n)+)""", re.MULTILINE)
_SCENARIO = re.compile(
    r"""^([ ]*)(["']?)([\w.-]+)\2:[ ]*\n((?=\1[ ]+agents_xy:)(?:\1[ ]+\S.*\n)+)""", re.MULTILINE
)
_FREE, _OBSTACLE = ".@$!", "#"  # of the free cells, in some vehicles only start, end or pass


def graph_from_yaml(path: Path, entry: str) -> Graph:
    """Read one of POGEMA's maps, by its name or the number at its end."""
    maps = {found[2]: found[3] for found in _MAP.finditer(read_text(path) + "\n")}
    name = _entry(path, maps, entry, "map")
    rows = [line.strip() for line in maps[name].splitlines()]
    for row in rows:
        if len(row) != len(rows[0]) or set(row) - set(_FREE + _OBSTACLE):
            raise InputError(
                f"{path}: map {name}: found the row {row!r}, expected {len(rows[0])} cells"
                f" of {_FREE}{_OBSTACLE}"
            )
    free = {(x, y) for y, row in enumerate(rows) for x, cell in enumerate(row) if cell in _FREE}
    return grid_graph(free)


def task_from_yaml(path: Path, entry: str) -> BenchmarkTask:
    """Read one of POGEMA's scenarios, by its name or the number at its end."""
    scenarios = {found[3]: found[4] for found in _SCENARIO.finditer(read_text(path) + "\n")}
    name = _entry(path, scenarios, entry, "scenario")
    body, where = scenarios[name], f"{path}: scenario {name}"
    starts, goals = (_cells(where, body, key) for key in ("agents_xy", "targets_xy"))
    if len(starts) != len(goals):
        raise InputError(f"{where}: {len(starts)} starts and {len(goals)} goals")
    on = re.search(r"""^ *map_name: *(["']?)([\w. -]+)\1 *$""", body, re.MULTILINE)
    if on is None:
        raise InputError(f"{where}: no map_name, expected the name of its map")
    return BenchmarkTask(starts, goals, on[2])


def _entry(path: Path, entries: Mapping[str, str], entry: str, what: str) -> str:
    """Return the name that an entry stands for: itself, or the one that ends in it."""
    ending = re.compile(rf"(?:.*\D)?0*{entry}" if entry.isdecimal() else "")
    found = [name for name in entries if name == entry or ending.fullmatch(name)]
    if len(found) != 1:
        raise InputError(
            f"{path}: entry={entry}: {len(found)} of its {len(entries)} {what}s, expected one as"
            f" {next(iter(entries), 'in the YAML files of POGEMA')}"
        )
    return found[0]


def _cells(where: str, body: str, key: str) -> tuple[Cell, ...]:
    """Return the cells of a list of [row, column]."""
    listed = re.search(rf"^ *{key}: *([\[\]\s0-9,]+)$", body, re.MULTILINE)
    try:
        cells = msgspec.json.decode(listed[1] if listed else "", type=list[Cell])
    except msgspec.DecodeError:
        raise InputError(f"{where}: {key}: expected [[row, column], ...]") from None
    return tuple((column, row) for row, column in cells)
