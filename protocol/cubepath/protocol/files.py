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

from cubepath.protocol.catalogue import LATTICES, Catalogue, Cell, Generator
from cubepath.protocol.errors import InputError
from cubepath.protocol.graph_system import GraphSystem
from cubepath.protocol.graphs import read_text
from cubepath.protocol.lattice_system import LatticeSystem
from cubepath.protocol.sites import Site, in_order, site_from_json
from cubepath.protocol.systems import Scene, System

FORMAT = "cubepath-system-1"


class _GeneratorTable(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    name: str
    support: list[list[int]]
    trace: list[list[int]]
    before: list[list[int]]
    after: list[list[int]]
    goes: list[tuple[list[int], list[int]]]
    free: list[list[int]] = []
    guards: list[tuple[list[int], list[int]]] = []


class _LatticeTable(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    name: str
    generators: list[_GeneratorTable]
    workspace: list[Any] | None = None
    filled: list[Any] = []
    empty: list[Any] = []


class _GraphTable(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    vertices: list[Any]
    edges: list[tuple[Any, Any]]
    compass: bool = False
    labels: Annotated[int, msgspec.Meta(ge=1)] | None = None


class _SceneFile(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    format: str
    start: list[Any]
    name: str = ""
    family: str = ""
    goal: list[Any] | None = None
    goals: list[list[Any]] = []
    lattice: _LatticeTable | None = None
    graph: _GraphTable | None = None


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
    if (found.lattice is None) == (found.graph is None):
        raise InputError("expected one of the tables [lattice] and [graph]")
    start = _sites(found.start)
    goals = tuple(_sites(known) for known in found.goals)
    return Scene(
        spec=found.name or where,
        family=found.family,
        system=_lattice(found.lattice) if found.lattice else _graph(found.graph),
        start=start,
        goal=None if found.goal is None else frozenset(_sites(found.goal)),
        goals=goals * len(start) if len(goals) == 1 else goals,
    )


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
            goes=tuple((tuple(a), tuple(b)) for a, b in generator.goes),
            free=_cells(generator.free),
            guards=tuple((tuple(a), tuple(b)) for a, b in generator.guards),
        )
        for generator in table.generators
    )
    return LatticeSystem(
        Catalogue(lattice, generators),
        workspace=None if table.workspace is None else _sites(table.workspace),
        filled=_sites(table.filled),
        empty=_sites(table.empty),
    )


def _graph(table: _GraphTable | None) -> GraphSystem:
    if table is None:
        raise InputError("no [graph]")
    return GraphSystem(
        _sites(table.vertices),
        [(site_from_json(one), site_from_json(other)) for one, other in table.edges],
        labels=table.labels,
        compass=table.compass,
    )


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
            table: dict[str, Any] = {"name": system.catalogue.lattice.name}
            if system.workspace is not None:
                table["workspace"] = _json(in_order(system.workspace))
            for key, sites in (("filled", system.filled), ("empty", system.empty)):
                if sites:
                    table[key] = _json(in_order(sites))
            table["generators"] = [_generator(each) for each in system.catalogue.generators]
            return {"lattice": table}
        case GraphSystem():
            table = {
                "compass": system.compass,
                "vertices": _json(system.vertices),
                "edges": _json(system.edges),
            }
            if system.labels is not None:
                table["labels"] = system.labels
            return {"graph": table}
        case _:
            raise InputError(f"{type(system).__name__} cannot be written as a file")


def _generator(generator: Generator) -> dict[str, Any]:
    keys = ("support", "trace", "before", "after", "goes", "free", "guards")
    found = {key: _json(getattr(generator, key)) for key in keys}
    return {"name": generator.name, **{key: value for key, value in found.items() if value}}


def _json(value: object) -> Any:
    if isinstance(value, tuple):
        return [_json(item) for item in value]
    return value
