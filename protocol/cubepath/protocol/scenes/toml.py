"""Scenes as TOML: every system can be written as one file and read back to the same system.

Sites are written as in JSON. The format is `cubepath-system-1`; see docs/files.md. The content of a
system's table is defined by its class.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec
import tomli_w

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import read_text
from cubepath.protocol.core.parsing import parsed_toml
from cubepath.protocol.core.sites import Site, in_order, sites_from_json, to_json
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.scenes.families.own import OWN_KINDS
from cubepath.protocol.scenes.registry import SCENE_KEYS, kinds

FORMAT = "cubepath-system-1"


class _SceneFile(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    format: str
    start: list[Any]
    name: str = ""
    family: str = ""
    goal: list[Any] | None = None
    goals: list[list[Any]] = []


def read_scene(path: Path | str) -> Scene:
    """Read a scene from a TOML file; InputError names the file and what is wrong in it.

    >>> from pathlib import Path
    >>> _ = Path("three.toml").write_text(scene_to_toml(scene_from_spec("hex:n=3")))
    >>> read_scene("three.toml").start
    ((0, 0), (1, 0), (2, 0))
    """
    return scene_from_toml(read_text(path), str(path))


def scene_from_toml(text: str, where: str) -> Scene:
    """Read a scene from TOML text; `where` names the text in errors.

    >>> text = scene_to_toml(scene_from_spec("hex:n=3"))
    >>> scene_from_toml(text, "a copy").start
    ((0, 0), (1, 0), (2, 0))
    """
    try:
        table = parsed_toml(text)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    if table.get("format") != FORMAT:
        raise InputError(f"{where}: format is {table.get('format')!r}, expected {FORMAT!r}")
    try:
        return _scene(table, where)
    except msgspec.ValidationError as error:
        raise InputError(f"{where}: {error}") from None
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _scene(table: dict[str, Any], where: str) -> Scene:
    own = all(key in OWN_KINDS for key in table.keys() - set(SCENE_KEYS))
    known: Mapping[str, type[System]] = OWN_KINDS if own else kinds()
    found = msgspec.convert(
        {key: value for key, value in table.items() if key not in known}, _SceneFile
    )
    names = [name for name in known if name in table]
    if len(names) != 1:
        raise InputError(f"expected one of the tables {', '.join(f'[{name}]' for name in known)}")
    system = _system(known[names[0]], table[names[0]])
    start = _modules(system, "start", found.start)
    goals = tuple(
        _modules(system, f"goals[{number}]", each) for number, each in enumerate(found.goals)
    )
    goal = None if found.goal is None else _modules(system, "goal", found.goal)
    if goal is not None and len(set(goal)) < len(goal):
        twice = next(site for site in goal if goal.count(site) > 1)
        raise InputError(f"goal: {twice!r} stands twice")
    return Scene(
        spec=found.name or where,
        family=found.family,
        system=system,
        start=start,
        goal=None if goal is None else frozenset(goal),
        goals=goals * len(start) if len(goals) == 1 else goals,
    )


def _modules(system: System, key: str, values: Iterable[object]) -> tuple[Site, ...]:
    try:
        return system.modules_among(sites_from_json(values))
    except InputError as error:
        raise InputError(f"{key}: {error}") from None


def _system(kind: type[System], table: object) -> System:
    try:
        return kind.from_table(msgspec.convert(table, dict[str, Any]))
    except msgspec.ValidationError as error:
        # The error gives the place in the whole file.
        what, at, place = str(error).rpartition(" - at `$")
        if not at:
            what, place = str(error), "`"
        raise InputError(f"{what} - at `$.{kind.table}{place}") from None


def scene_to_toml(scene: Scene) -> str:
    """Write a scene as TOML text; `scene_from_toml` gives an equal scene back."""
    table: dict[str, Any] = {
        "format": FORMAT,
        "name": scene.spec,
        "family": scene.family,
        "start": to_json(scene.start),
    }
    if scene.goal is not None:
        table["goal"] = to_json(in_order(scene.goal))
    if scene.goals:
        # Modules that all know the same goal (a chain's cells) share one entry.
        distinct = tuple(dict.fromkeys(scene.goals))
        table["goals"] = to_json(distinct if len(distinct) == 1 else scene.goals)
    return tomli_w.dumps(table | {scene.system.table: scene.system.to_table()})
