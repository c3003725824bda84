"""Scenes as TOML: every system can be written as one file and read back to the same system.

Sites are written as JSON would write them. The format is `cubepath-system-1`; see docs/files.md.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import msgspec
import tomli_w

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import HEXAGONS, LATTICES, Catalogue, Cell, Generator, Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order, site_from_json, site_text
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.scenes.families.connected_hexagons import ConnectedHexagons
from cubepath.protocol.systems.flips import FlipSystem
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.systems.graphs import read_text
from cubepath.protocol.systems.lattice import LatticeSystem
from cubepath.protocol.systems.listed import TabledSystem

FORMAT = "cubepath-system-1"


class _GeneratorTable(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    name: str
    support: list[list[int]]
    trace: list[list[int]]
    before: list[list[int]]
    after: list[list[int]]
    motion: list[tuple[list[int], list[int]]] = msgspec.field(name="goes")
    free: list[list[int]] = []
    guards: list[tuple[list[int], list[int]]] = []


class _LatticeTable(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    name: str
    generators: list[_GeneratorTable]
    workspace: list[Any] | None = None
    filled: list[Any] = []
    empty: list[Any] = []
    connected: bool = False


class _GraphTable(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    vertices: list[Any]
    edges: list[tuple[Any, Any]]
    compass: bool = False
    labels: Annotated[int, msgspec.Meta(ge=1)] | None = None


class _PointsTable(msgspec.Struct, forbid_unknown_fields=True):
    points: list[tuple[int, int]]


class _MoveTable(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    generator: str
    at: Any
    support: list[Any]
    trace: list[Any]
    before: list[Any]
    after: list[Any]
    motion: list[tuple[Any, Any]] = msgspec.field(name="goes")
    free: list[Any] = []
    guards: list[tuple[Any, Any]] = []


class _ListTable(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    drawing: str
    moves: list[_MoveTable]
    letters: list[str] = []
    fixed: list[Any] = []
    positions: list[tuple[Any, float, float]] = []


class _SceneFile(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    format: str
    start: list[Any]
    name: str = ""
    family: str = ""
    goal: list[Any] | None = None
    goals: list[list[Any]] = []
    lattice: _LatticeTable | None = None
    graph: _GraphTable | None = None
    listed: _ListTable | None = None
    triangulation: _PointsTable | None = None


def read_scene(path: Path) -> Scene:
    """Read a scene from a TOML file; InputError names the file and what is wrong in it."""
    return scene_from_toml(read_text(path), str(path))


def scene_from_toml(text: str, where: str) -> Scene:
    """Read a scene from TOML text; `where` names the text in errors."""
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{where}: not TOML: {error}") from None
    if table.get("format") != FORMAT:
        raise InputError(f"{where}: format is {table.get('format')!r}, expected {FORMAT!r}")
    try:
        found = msgspec.convert(table, _SceneFile)
        return _scene(found, where)
    except msgspec.ValidationError as error:
        raise InputError(f"{where}: {error}") from None
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _scene(found: _SceneFile, where: str) -> Scene:
    names = ("lattice", "graph", "listed", "triangulation")
    if sum(getattr(found, name) is not None for name in names) != 1:
        raise InputError(f"expected one of the tables {', '.join(f'[{name}]' for name in names)}")
    start = _sites(found.start)
    goals = tuple(_sites(known) for known in found.goals)
    return Scene(
        spec=found.name or where,
        family=found.family,
        system=_system(found),
        start=start,
        goal=None if found.goal is None else frozenset(_sites(found.goal)),
        goals=goals * len(start) if len(goals) == 1 else goals,
    )


def _system(found: _SceneFile) -> System:
    if found.lattice is not None:
        return _lattice(found.lattice)
    if found.graph is not None:
        return _graph(found.graph)
    if found.listed is not None:
        return _listed(found.listed)
    if found.triangulation is not None:
        return FlipSystem(found.triangulation.points)
    raise InputError("no system")


def _sites(values: Iterable[Any]) -> tuple[Site, ...]:
    return tuple(site_from_json(value) for value in values)


def _cells(values: Iterable[list[int]]) -> tuple[Cell, ...]:
    return tuple(tuple(value) for value in values)


def _lattice(table: _LatticeTable) -> LatticeSystem:
    lattice = LATTICES.get(table.name)
    if lattice is None:
        names = ", ".join(LATTICES)
        raise InputError(f"unknown lattice {table.name!r}, expected one of {names}")
    generators = tuple(
        Generator(
            name=generator.name,
            support=_cells(generator.support),
            trace=_cells(generator.trace),
            before=_cells(generator.before),
            after=_cells(generator.after),
            motion=tuple((tuple(a), tuple(b)) for a, b in generator.motion),
            free=_cells(generator.free),
            guards=tuple((tuple(a), tuple(b)) for a, b in generator.guards),
        )
        for generator in table.generators
    )
    if table.connected and lattice is not HEXAGONS:
        raise InputError(f"connected: expected lattice 'hexagons', found {table.name!r}")
    build = ConnectedHexagons if table.connected else LatticeSystem
    return build(
        Catalogue(lattice, generators),
        workspace=None if table.workspace is None else _sites(table.workspace),
        filled=_sites(table.filled),
        empty=_sites(table.empty),
    )


def _graph(table: _GraphTable) -> GraphSystem:
    return GraphSystem(
        _sites(table.vertices),
        [(site_from_json(one), site_from_json(other)) for one, other in table.edges],
        labels=table.labels,
        compass=table.compass,
    )


def _listed(table: _ListTable) -> TabledSystem:
    return TabledSystem(
        [_move(each) for each in table.moves],
        letters=table.letters,
        fixed=_sites(table.fixed),
        drawing=table.drawing,
        positions={site_from_json(place): (x, y) for place, x, y in table.positions},
    )


def _move(table: _MoveTable) -> Move:
    at = site_from_json(table.at)
    action = Action(
        _sites(table.support),
        _sites(table.trace),
        _sites(table.before),
        _sites(table.after),
        free=_sites(table.free),
        guards=_pairs(table.guards),
        label=f"{table.generator} at {site_text(at)}",
    )
    return Move(action, table.generator, at, tuple(_pairs(table.motion)))


def _pairs(values: Iterable[tuple[Any, Any]]) -> list[tuple[Site, Site]]:
    return [(site_from_json(one), site_from_json(other)) for one, other in values]


def scene_to_toml(scene: Scene) -> str:
    """Write a scene as TOML text; `scene_from_toml` gives an equal scene back."""
    table: dict[str, Any] = {
        "format": FORMAT,
        "name": scene.spec,
        "family": scene.family,
        "start": _json(scene.start),
    }
    if scene.goal is not None:
        table["goal"] = _json(in_order(scene.goal))
    if scene.goals:
        # Modules that all know the same goal (a chain's cells) share one entry.
        distinct = tuple(dict.fromkeys(scene.goals))
        table["goals"] = _json(distinct if len(distinct) == 1 else scene.goals)
    return tomli_w.dumps(table | _system_table(scene.system))


def _system_table(system: System) -> dict[str, Any]:
    match system:
        case LatticeSystem():
            return {"lattice": _lattice_table(system)}
        case GraphSystem():
            return {"graph": _graph_table(system)}
        case FlipSystem():
            return {"triangulation": {"points": _json(system.plane.points)}}
        case TabledSystem():
            return {"listed": _list_table(system)}
        case _:
            raise InputError(f"{type(system).__name__} cannot be written as a file")


def _lattice_table(system: LatticeSystem) -> dict[str, Any]:
    table: dict[str, Any] = {"name": system.catalogue.lattice.name}
    if system.workspace is not None:
        table["workspace"] = _json(in_order(system.workspace))
    for key, sites in (("filled", system.filled), ("empty", system.empty)):
        if sites:
            table[key] = _json(in_order(sites))
    if isinstance(system, ConnectedHexagons):
        table["connected"] = True
    table["generators"] = [_generator(each) for each in system.catalogue.generators]
    return table


def _graph_table(system: GraphSystem) -> dict[str, Any]:
    table = {
        "compass": system.compass,
        "vertices": _json(system.vertices),
        "edges": _json(system.edges),
    }
    if system.labels is not None:
        table["labels"] = system.labels
    return table


def _list_table(system: TabledSystem) -> dict[str, Any]:
    table: dict[str, Any] = {"drawing": system.drawing}
    if system.letters:
        table["letters"] = list(system.letters)
    if system.filled:
        table["fixed"] = _json(in_order(system.filled))
    if system.positions:
        table["positions"] = [
            [_json(place), *map(float, system.positions[place])]
            for place in in_order(system.positions)
        ]
    table["moves"] = [_listed_move(move) for move in system.listed]
    return table


def _generator(generator: Generator) -> dict[str, Any]:
    found = {
        "support": _json(generator.support),
        "trace": _json(generator.trace),
        "before": _json(generator.before),
        "after": _json(generator.after),
        "goes": _json(generator.motion),
        "free": _json(generator.free),
        "guards": _json(generator.guards),
    }
    return {"name": generator.name, **{key: value for key, value in found.items() if value}}


def _listed_move(move: Move) -> dict[str, Any]:
    action = move.action
    sources = frozenset(source for source, _ in move.motion)
    ends = action.ends if sources <= action.ends[0] else action.ends[::-1]
    found = {
        "support": _json(in_order(action.support)),
        "trace": _json(in_order(action.trace)),
        "before": _json(in_order(ends[0])),
        "after": _json(in_order(ends[1])),
        "goes": _json(move.motion),
    }
    if action.free:
        found["free"] = _json(in_order(action.free))
    if action.guards:
        found["guards"] = _json(in_order(action.guards))
    return {"generator": move.generator, "at": _json(move.at), **found}


def _json(value: object) -> Any:
    if isinstance(value, tuple):
        return [_json(item) for item in value]
    return value
