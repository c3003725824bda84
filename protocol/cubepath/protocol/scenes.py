"""Scenes by name: what `name:key=value,...` or the path of a TOML file stands for.

The built-in families are hex, hex-open, agv, agv-labelled and arm; each is a short function here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from cubepath.protocol.catalogue import HEX_DIRECTIONS, Cell, arm_catalogue, hex_catalogue
from cubepath.protocol.errors import InputError
from cubepath.protocol.graph_system import GraphSystem
from cubepath.protocol.graphs import Graph, graph_from_name, scenario_from_json
from cubepath.protocol.lattice_system import LatticeSystem
from cubepath.protocol.sites import Site, in_order
from cubepath.protocol.systems import Scene

Values = Mapping[str, str]
MODULES_MAX = 100_000
"""The largest number of modules, or of anything else, that a spec may ask for."""


@dataclass(frozen=True, slots=True)
class Family:
    """A built-in family of scenes: its keys with their defaults and one line on each."""

    name: str
    summary: str
    keys: Mapping[str, tuple[str, str]]
    build: Callable[[str, Values], Scene]
    rule: str
    """The rule that reaches the default goal."""


def scene_from_spec(spec: str) -> Scene:
    """Return the scene that `spec` names; InputError says what is wrong with it."""
    name, _, rest = spec.partition(":")
    family = FAMILIES.get(name)
    if family is None and spec.endswith(".toml"):
        from cubepath.protocol.files import read_scene  # noqa: PLC0415 - files reads scenes too

        return read_scene(Path(spec))
    if family is None:
        names = ", ".join(FAMILIES)
        raise InputError(f"unknown system {name!r}, expected one of {names} or a .toml file")
    values = {key: default for key, (default, _) in family.keys.items()}
    given: dict[str, str] = {}
    for part in rest.split(",") if rest else []:
        key, equals, value = part.partition("=")
        if not equals or key not in values:
            keys = ", ".join(values)
            raise InputError(
                f"{spec}: cannot read {part!r}, expected KEY=VALUE with a key of {keys}"
            )
        if key in given:
            raise InputError(f"{spec}: key {key!r} stands twice")
        values[key] = given[key] = value
    shown = ",".join(f"{key}={given[key]}" for key in values if key in given)
    scene = family.build(name, values)
    return replace(scene, spec=f"{name}:{shown}" if shown else name)


def _integer(values: Values, key: str, *, least: int) -> int:
    text = values[key]
    try:
        number = int(text)
    except ValueError:
        number = None
    if number is None or not least <= number <= MODULES_MAX:
        raise InputError(
            f"{key}={text}: expected a whole number of at least {least}, at most {MODULES_MAX}"
        )
    return number


def _hex(name: str, values: Values) -> Scene:
    """Build a chain of hexagons that is to become another chain.

    The start runs along direction 0 from cell (0, 0). The goal begins at its end; `bend` is the
    angle between the two chains, 60 or 120 degrees on either side, or 0 for a slide along the
    same line, `shift` cells ahead.
    """
    count = _integer(values, "n", least=1)
    bend = values["bend"]
    turns = {"0": 0, "120": 1, "60": 2, "-60": 4, "-120": 5}
    if bend not in turns:
        raise InputError(f"bend={bend}: expected one of {', '.join(turns)}")
    start: tuple[Cell, ...] = tuple((position, 0) for position in range(count))
    ahead = HEX_DIRECTIONS[turns[bend]]
    if turns[bend] == 0:
        first = _integer(values, "shift", least=0)
        if first > count:
            raise InputError(f"shift={first}: expected at most n={count}")
    else:
        first = count - 1
    goals: tuple[Cell, ...] = tuple(
        (first + step * ahead[0], step * ahead[1]) for step in range(count)
    )
    workspace = None
    if name == "hex-open":
        # Pieces may break off and walk away, so this catalogue needs walls.
        margin = 3
        cells = [*start, *goals]
        workspace = [
            (q, r)
            for q in range(min(c[0] for c in cells) - margin, max(c[0] for c in cells) + margin + 1)
            for r in range(min(c[1] for c in cells) - margin, max(c[1] for c in cells) + margin + 1)
        ]
    system = LatticeSystem(hex_catalogue(keeps_topology=name == "hex"), workspace=workspace)
    return Scene(
        spec=name,
        family=name,
        system=system,
        start=start,
        goal=frozenset(goals),
        goals=(goals,) * count,
    )


def _arm(name: str, values: Values) -> Scene:
    """Build a positive arm of n segments, first straight up, that is to spell the word `goal`."""
    count = _integer(values, "n", least=1)
    word = values["goal"] or "x" * count
    if len(word) != count or set(word) - {"x", "y"}:
        raise InputError(f"goal={word}: expected {count} letters x and y")
    goal = arm_sites(word)
    return Scene(
        spec=name,
        family=name,
        system=LatticeSystem(arm_catalogue()),
        start=arm_sites("y" * count),
        goal=frozenset(goal),
        goals=tuple((site,) for site in goal),
    )


def arm_sites(word: str) -> tuple[Site, ...]:
    """Return the lattice edges of the positive arm that spells `word` from the origin."""
    x = y = 0
    found: list[Site] = []
    for letter in word:
        found.append((x, y, 0 if letter == "x" else 1))
        x, y = (x + 1, y) if letter == "x" else (x, y + 1)
    return tuple(found)


def _agv(name: str, values: Values) -> Scene:
    """Build vehicles on a graph, from a file's starts and goals or from its first vertices."""
    labelled = name == "agv-labelled"
    scenario = None
    graph: Graph | None = None
    if values["scene"]:
        scenario = scenario_from_json(Path(values["scene"]))
        graph = scenario.graph
    if graph is None or values["graph"]:
        graph = graph_from_name(values["graph"] or "grid6x6")
    if scenario is not None:
        starts, goals = scenario.starts, scenario.goals
        if values["n"]:
            count = _integer(values, "n", least=1)
            if count > len(starts):
                raise InputError(f"n={count}: the scene has {len(starts)} vehicles")
            starts, goals = starts[:count], goals[:count]
    else:
        vertices = in_order(graph.vertices)
        count = _integer({"n": values["n"] or "2"}, "n", least=1)
        if count > len(vertices):
            raise InputError(f"n={count}: the graph has {len(vertices)} vertices")
        starts = vertices[:count]
        # The last vertices in reverse, so that labelled vehicles have to pass one another.
        goals = tuple(reversed(vertices))[:count]
    system = GraphSystem(
        graph.vertices,
        graph.edges,
        labels=len(starts) if labelled else None,
        compass=graph.compass,
    )
    if labelled:
        start: tuple[Site, ...] = tuple((v, label) for label, v in enumerate(starts))
        goal: frozenset[Site] = frozenset((v, label) for label, v in enumerate(goals))
    else:
        start, goal = starts, frozenset(goals)
    return Scene(
        spec=name,
        family=name,
        system=system,
        start=start,
        goal=goal,
        goals=tuple((v,) for v in goals),
    )


_hex_keys = {
    "n": ("7", "number of modules"),
    "bend": ("120", "angle between the two chains: 60, 120, -60, -120, or 0 for a slide"),
    "shift": ("1", "for bend=0: how far ahead the goal lies, 0 to n"),
}
_agv_keys = {
    "graph": (
        "",
        "grid6x6, K5, C8, P9, S4 or a file: a movingai .map, or an edge list of two names a line",
    ),
    "n": ("", "number of vehicles, 2 or all of the scene"),
    "scene": ("", "a JSON file with starts and goals"),
}
FAMILIES: dict[str, Family] = {
    family.name: family
    for family in (
        Family(
            "hex",
            "hexagonal pivots that keep the topology (catalogue 1)",
            {**_hex_keys, "n": ("12", "number of modules")},
            _hex,
            "chain",
        ),
        Family(
            "hex-open",
            "hexagonal pivots that may split the aggregate (catalogue 2), in a bounded workspace",
            _hex_keys,
            _hex,
            "chain",
        ),
        Family("agv", "unlabelled vehicles on a graph", _agv_keys, _agv, "tswap"),
        Family("agv-labelled", "labelled vehicles on a graph", _agv_keys, _agv, "pibt"),
        Family(
            "arm",
            "positive articulated arm on lattice edges",
            {
                "n": ("5", "number of segments"),
                "goal": ("", "word of the goal, from the base; all x when left out"),
            },
            _arm,
            "word",
        ),
    )
}
