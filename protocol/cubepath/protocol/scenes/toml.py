"""Scenes as TOML: every system can be written as one file and read back to the same system.

Sites are written as in JSON. The format is `cubepath-system-1`; see docs/files.md. The content of a
system's table is defined by its class.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import tomli_w

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.input_files import read_text
from cubepath.protocol.core.parsing import converted, given_values, mistake_of, parsed_toml
from cubepath.protocol.core.sites import Site, in_order, sites_from_json, to_json
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.scenes.families.own import OWN_KINDS
from cubepath.protocol.scenes.registry import PAGE_KEYS, SCENE_KEYS, kinds

FORMAT = "cubepath-system-1"
_RULE = re.compile(r"[\w-]+(:\w+=[\w.+-]*(,\w+=[\w.+-]*)*)?")


class _SceneFile(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    format: str
    start: list[Any]
    name: str = ""
    family: str = ""
    goal: list[Any] | None = None
    goals: list[Any] | None = None
    rule: str = ""


def read_scene(path: Path | str, values: str = "") -> Scene:
    """Read a scene from a TOML file; InputError names the file and what is wrong in it.

    `values` are those of the keys of a page, as ``n=4,scene=gap``.

    >>> from pathlib import Path
    >>> _ = Path("three.toml").write_text(scene_to_toml(scene_from_spec("hex:n=3")))
    >>> read_scene("three.toml").start
    ((0, 0), (1, 0), (2, 0))
    """
    return scene_from_toml(read_text(path), str(path), values, folder=Path(path).parent)


def scene_from_toml(
    text: str, where: str, values: str = "", *, folder: Path | None = None
) -> Scene:
    """Read a scene from TOML text; `where` names the text in errors, `values` are those of keys.

    `folder` is where files lie that the text may name; without it none are read.

    >>> text = scene_to_toml(scene_from_spec("hex:n=3"))
    >>> scene_from_toml(text, "a copy").start
    ((0, 0), (1, 0), (2, 0))
    """
    try:
        table = parsed_toml(text)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    if "format" not in table:
        raise InputError(f"{where}: no scene, expected format = {FORMAT!r} in its first lines")
    if table["format"] != FORMAT:
        raise InputError(f"{where}: format is {table['format']!r}, expected {FORMAT!r}")
    chosen = ""
    try:
        if folder is not None and "pathfinder" in table:
            from cubepath.protocol.scenes.pathfinder import pathfinder_scene  # noqa: PLC0415 - seldom

            given_values(values, {}, "keys")
            return pathfinder_scene(table, where, folder)
        kind = _kind_of(table)
        system: System | None = None
        if values or _is_page(table):
            from cubepath.protocol.scenes.pages import expanded  # noqa: PLC0415 - seldom needed

            table, system, chosen = expanded(table, text, values)
        scene = _scene(table, where, kind, system)
    except InputError as error:
        what = str(error).removeprefix(f"{where}: ")
        scene_of = f"scene {chosen}: " if chosen else ""
        raise InputError(f"{where}: {scene_of}{what}") from error  # it may have a picture
    return replace(scene, spec=f"{scene.spec}:{values}") if values else scene


def _is_page(table: Mapping[str, Any]) -> bool:
    """Return whether there is anything to expand, so that others need not wait for that code."""
    lattice = table.get("lattice")
    values = [table.get(key) for key in ("start", "goal")]
    if isinstance(lattice, dict):
        values += [value for key, value in lattice.items() if key not in ("name", "generators")]
        drawn = lattice.get("generators")
        for each in drawn if isinstance(drawn, list) else []:
            values += [each.get("before")] if isinstance(each, dict) else []
    keys = any(key in table for key in PAGE_KEYS)
    return keys or any(isinstance(value, str | dict) for value in values)


def _kind_of(table: Mapping[str, Any]) -> type[System]:
    """Return the kind of the system in a file; InputError for a key that is unknown."""
    own = OWN_KINDS.keys() >= table.keys() - {*SCENE_KEYS, *PAGE_KEYS}
    known: Mapping[str, type[System]] = OWN_KINDS if own else kinds()
    tables = ", ".join(f"[{name}]" for name in known)
    for stray in sorted(table.keys() - {*known, *SCENE_KEYS, *PAGE_KEYS}):
        near = did_you_mean(stray, [*known, *SCENE_KEYS, *PAGE_KEYS])
        keys = ", ".join((*SCENE_KEYS, *PAGE_KEYS, tables))
        raise InputError(f"unknown key {stray!r}{near}, expected one of {keys}")
    names = [name for name in known if name in table]
    if len(names) != 1:
        raise InputError(f"expected one of the tables {tables}")
    return known[names[0]]


def _scene(table: dict[str, Any], where: str, kind: type[System], system: System | None) -> Scene:
    found = converted({key: table[key] for key in SCENE_KEYS if key in table}, _SceneFile, "")
    if found.rule and not _RULE.fullmatch(found.rule):  # an input must not name code
        raise InputError(f"rule: expected the name of a rule, not of a file, found {found.rule!r}")
    system = system or _system(kind, table[kind.table])
    start = _modules(system, "start", found.start)
    goal = None if found.goal is None else _modules(system, "goal", found.goal)
    if goal is not None and len(set(goal)) < len(goal):
        twice = next(site for site in goal if goal.count(site) > 1)
        raise InputError(f"goal: {twice!r} stands twice")
    if found.goals is not None:
        goals = _goals(system, found.goals)
    else:  # each module knows the whole goal
        goals = () if goal is None or system.labels is not None else (goal,)
    scene = Scene(
        spec=found.name or where,
        family=found.family,
        system=system,
        start=start,
        goal=None if goal is None else frozenset(goal),
        goals=goals * len(start) if len(goals) == 1 else goals,
        rule=found.rule,
    )
    if found.goals is None and goal is not None and system.labels is not None:
        own = {system.label_of(site): (system.place_of(site),) for site in goal}
        scene = replace(scene, goals=tuple(own.get(system.label_of(site), ()) for site in start))
    return scene


def _goals(system: System, lists: list[Any]) -> tuple[tuple[Site, ...], ...]:
    for number, each in enumerate(lists):
        if not isinstance(each, list):
            form = "a list of sites for each module, or one such list for all, [[SITE, ...]]"
            raise InputError(f"goals[{number}]: expected {form}, found {each!r}")
    return tuple(_modules(system, f"goals[{number}]", each) for number, each in enumerate(lists))


def _modules(system: System, key: str, values: Iterable[object]) -> tuple[Site, ...]:
    try:
        return system.modules_among(sites_from_json(values))
    except InputError as error:
        raise InputError(f"{key}: {error}") from None


def _system(kind: type[System], table: object) -> System:
    try:
        return kind.from_table(converted(table, dict[str, Any], kind.table))
    except msgspec.ValidationError as error:
        raise InputError(f"{kind.table}: {mistake_of(error)}") from None


def scene_to_toml(scene: Scene) -> str:
    """Write a scene as TOML text; `scene_from_toml` gives an equal scene back.

    >>> print(scene_to_toml(scene_from_spec("agv:graph=P2,n=1")).splitlines()[1])
    name = "agv:graph=P2,n=1"
    """
    table: dict[str, Any] = {
        "format": FORMAT,
        "name": scene.spec,
        "family": scene.family,
        "start": to_json(scene.start),
    }
    if scene.goal is not None:
        table["goal"] = to_json(in_order(scene.goal))
    if scene.goals or scene.goal:
        # Modules that all know the same goal (a chain's cells) share one entry.
        distinct = tuple(dict.fromkeys(scene.goals))
        table["goals"] = to_json(distinct if len(distinct) == 1 else scene.goals)
    if scene.rule:
        table["rule"] = scene.rule
    return tomli_w.dumps(table | {scene.system.table: scene.system.to_table()})
