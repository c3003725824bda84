"""Graphs for vehicles: by name, from edge lists, movingai maps and scenario files.

Sources: the movingai grid format (Sturtevant, Benchmarks for Grid-Based Pathfinding), whose header
is read by key because some maps lack the type line; scenarios are the JSON files of the project's
own sample data (obstacles, starts, goals, moves).
"""

import re
from collections.abc import Iterable, Set as AbstractSet
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import Source, opened, read_text
from cubepath.protocol.core.parsing import read_json
from cubepath.protocol.core.sites import Site

Edge = tuple[Site, Site]


@dataclass(frozen=True, slots=True)
class Graph:
    """Vertices and edges; `compass` if vertices are (x, y) and edges join grid neighbours."""

    vertices: tuple[Site, ...]
    edges: tuple[Edge, ...]
    compass: bool = False


@dataclass(frozen=True, slots=True)
class PlannerInstance:
    """A planner's instance and, where given, its moves: each from one vertex to another.

    `rounds` says how many of the moves each of the planner's rounds has, in order, None if the file
    does not say; `planner_rounds` is how many rounds there are.
    """

    graph: Graph
    starts: tuple[Site, ...]
    goals: tuple[Site, ...]
    moves: tuple[Edge, ...]
    source: str
    planner_rounds: int | None = None
    rounds: tuple[int, ...] | None = None


def grid_graph(free: set[tuple[int, int]]) -> Graph:
    """Return the graph of the free cells (x, y), each joined to its free grid neighbours."""
    vertices = tuple(sorted(free))
    edges = tuple(
        ((x, y), other) for x, y in vertices for other in ((x + 1, y), (x, y + 1)) if other in free
    )
    return Graph(vertices, edges, compass=True)


_NAMED = re.compile(r"(grid([0-9]+)x([0-9]+)|([KCPS])([0-9]+))")


def is_named_graph(name: str) -> bool:
    """Return whether a graph is known by this name, which else is that of a file."""
    return _NAMED.fullmatch(name) is not None


def graph_from_name(name: str) -> Graph:
    """Return the graph that `name` stands for.

    ``grid6x4`` (6 wide, 4 high), ``K5`` complete, ``C8`` cycle, ``P9`` path, ``S4`` star with
    four leaves, or a file: ``.map`` movingai, ``.json`` scenario, anything else an edge list.
    """
    found = _NAMED.fullmatch(name)
    if found is None:
        path = Path(name)
        if path.suffix == ".map":
            return graph_from_map(path)
        if path.suffix == ".json":
            return scenario_from_json(path).graph
        return graph_from_edge_list(path)
    if found[2]:
        wide, high = int(found[2]), int(found[3])
        if not 2 <= wide * high <= _CELLS_MAX:
            raise InputError(f"graph={name}: expected a grid of 2 to {_CELLS_MAX} cells")
        return grid_graph({(x, y) for x in range(wide) for y in range(high)})
    kind, count = found[4], int(found[5])
    least = {"K": 2, "C": 3, "P": 2, "S": 1}[kind]
    most = 1000 if kind == "K" else _CELLS_MAX
    if not least <= count <= most:
        raise InputError(f"graph={name}: {kind} takes at least {least} and at most {most}")
    vertices: tuple[Site, ...] = tuple(range(count + 1 if kind == "S" else count))
    if kind == "K":
        edges: tuple[Edge, ...] = tuple((a, b) for a in range(count) for b in range(a + 1, count))
    elif kind == "C":
        edges = tuple((a, (a + 1) % count) for a in range(count))
    elif kind == "P":
        edges = tuple((a, a + 1) for a in range(count - 1))
    else:
        edges = tuple((0, leaf) for leaf in range(1, count + 1))
    return Graph(vertices, edges)


_CELLS_MAX = 1_000_000
"""The most cells of a grid: one distant coordinate must not exhaust the memory."""


def graph_from_edge_list(path: Path) -> Graph:
    """Read an edge list: two vertex names a line; ``#`` starts a comment; integers are numbers."""
    edges: list[Edge] = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        names = line.partition("#")[0].split()
        if not names:
            continue
        if len(names) != 2:
            raise InputError(f"{path}:{number}: expected two vertex names, found {len(names)}")
        one, other = (int(name) if re.fullmatch(r"-?\d+", name) else name for name in names)
        if one == other:
            raise InputError(
                f"{path}:{number}: edge {one!r} to itself, a vehicle moves between two"
            )
        edges.append((one, other))
    if not edges:
        raise InputError(f"{path}: no edge found")
    vertices = dict.fromkeys(vertex for edge in edges for vertex in edge)
    return Graph(tuple(vertices), tuple(edges))


def graph_from_map(source: Source) -> Graph:
    """Read a movingai map: ``.``, ``G`` and ``S`` are free; cell (x, y) is column x of row y."""
    with opened(source) as file:
        path, lines = file.path, file.text().splitlines()
    header: dict[str, str] = {}
    first = 0
    for line in lines:
        first += 1
        key, _, value = line.strip().partition(" ")
        if key == "map":
            break
        header[key] = value.strip()
    else:
        raise InputError(f"{path}: no line 'map' found, expected a movingai map")
    try:
        high, wide = int(header["height"]), int(header["width"])
    except (KeyError, ValueError):
        raise InputError(f"{path}: the header needs 'height N' and 'width N'") from None
    rows = lines[first : first + high]
    if len(rows) < high:
        raise InputError(f"{path}: {high} rows announced, found {len(rows)}")
    free = set()
    for y, row in enumerate(rows):
        if len(row) != wide:
            raise InputError(f"{path}:{first + y + 1}: {len(row)} cells, expected {wide}")
        free |= {(x, y) for x, cell in enumerate(row) if cell in ".GS"}
    if not free:
        raise InputError(f"{path}: no free cell")
    return grid_graph(free)


def graph_round(
    where: str, named: Iterable[tuple[int, int]], obstacles: AbstractSet[tuple[int, int]]
) -> Graph:
    """Return the free cells of the bounding box of all named cells, one cell larger on each side.

    `named` is not empty. Raises InputError, beginning with `where`, if the box is too large.
    """
    cells = list(named)
    low = min(x for x, _ in cells) - 1, min(y for _, y in cells) - 1
    high = max(x for x, _ in cells) + 1, max(y for _, y in cells) + 1
    return _box(where, low, high, obstacles)


def _box(
    where: str, low: tuple[int, int], high: tuple[int, int], obstacles: AbstractSet[tuple[int, int]]
) -> Graph:
    (left, bottom), (right, top) = low, high
    size = (right - left + 1) * (top - bottom + 1)
    if not 0 < size <= _CELLS_MAX:
        raise InputError(f"{where}: a grid of {size} cells, expected 1 to {_CELLS_MAX}")
    return grid_graph(
        {(x, y) for x in range(left, right + 1) for y in range(bottom, top + 1)} - obstacles
    )


class _ScenarioFile(msgspec.Struct, forbid_unknown_fields=True):
    starts: list[tuple[int, int]]
    goals: list[tuple[int, int]]
    obstacles: list[tuple[int, int]] = []
    moves: list[tuple[tuple[int, int], tuple[int, int]]] = []
    grid: tuple[int, int] | None = None
    source: str = ""
    planner_rounds: int | None = msgspec.field(default=None, name="peer_makespan")
    rounds: list[Annotated[int, msgspec.Meta(ge=0)]] | None = None


def _planner_rounds(path: Path, found: _ScenarioFile) -> int | None:
    """Return how many rounds the planner counts; InputError if the file contradicts itself."""
    if found.rounds is None:
        return found.planner_rounds
    moved, rounds = sum(found.rounds), len(found.rounds)
    if moved != len(found.moves):
        raise InputError(
            f"{path}: rounds of {moved} moves, expected as many as there are moves,"
            f" {len(found.moves)}"
        )
    if found.planner_rounds not in (None, rounds):
        raise InputError(
            f"{path}: peer_makespan {found.planner_rounds} and {rounds} rounds, expected the same"
            " number"
        )
    return rounds


def check_vehicles(
    where: str, graph: Graph, starts: Iterable[tuple[int, int]], goals: Iterable[tuple[int, int]]
) -> None:
    """Raise InputError, beginning with `where`, unless each cell is free and taken once."""
    free = set(graph.vertices)
    for what, cells in (("start", starts), ("goal", goals)):
        seen: set[tuple[int, int]] = set()
        for number, cell in enumerate(cells):
            if cell not in free:
                raise InputError(f"{where}: {what} {number} at {list(cell)} is no free cell")
            if cell in seen:
                raise InputError(f"{where}: {what} {number} at {list(cell)} is taken twice")
            seen.add(cell)


def scenario_from_json(source: Source) -> PlannerInstance:
    """Read a scenario file; a missing `grid` is the bounding box of all named cells, one larger.

    Raises InputError if starts or goals lie outside the free cells, or two vehicles share one.
    """
    with opened(source) as file:
        path, found = file.path, read_json(file, _ScenarioFile)
    obstacles = frozenset(found.obstacles)
    if found.grid is not None:
        graph = _box(str(path), (0, 0), (found.grid[0] - 1, found.grid[1] - 1), obstacles)
    else:
        named = [
            *found.starts,
            *found.goals,
            *found.obstacles,
            *(c for move in found.moves for c in move),
        ]
        if not named:
            raise InputError(f"{path}: no vehicle and no grid")
        graph = graph_round(str(path), named, obstacles)
    if len(found.starts) != len(found.goals):
        raise InputError(f"{path}: {len(found.starts)} starts and {len(found.goals)} goals")
    check_vehicles(str(path), graph, found.starts, found.goals)
    planner_rounds = _planner_rounds(path, found)
    return PlannerInstance(
        graph=graph,
        starts=tuple(found.starts),
        goals=tuple(found.goals),
        moves=tuple(found.moves),
        source=found.source,
        planner_rounds=planner_rounds,
        rounds=None if found.rounds is None else tuple(found.rounds),
    )
