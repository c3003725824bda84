"""Vehicles on a graph, unlabelled and labelled, from the name of a graph or from files.

Source: Abrams and Ghrist, example of automated guided vehicles.
"""

from __future__ import annotations

from pathlib import Path

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.family import Family, Values, whole
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.systems.graphs import Graph, graph_from_name, scenario_from_json


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
            count = whole(values, "n", least=1)
            if count > len(starts):
                raise InputError(f"n={count}: the scene has {len(starts)} vehicles")
            starts, goals = starts[:count], goals[:count]
    else:
        vertices = in_order(graph.vertices)
        count = whole({"n": values["n"] or "2"}, "n", least=1)
        if count > len(vertices):
            raise InputError(f"n={count}: the graph has {len(vertices)} vertices")
        starts = vertices[:count]
        # The last vertices in reverse, so labelled vehicles must pass one another.
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


_KEYS = {
    "graph": (
        "",
        "grid6x6, K5, C8, P9, S4 or a file: a movingai .map, or an edge list of two names a line",
    ),
    "n": ("", "number of vehicles, 2 or all of the scene"),
    "scene": ("", "a JSON file with starts and goals"),
}
FAMILIES = (
    Family("agv", "unlabelled vehicles on a graph", _KEYS, _agv, GraphSystem, "tswap"),
    Family("agv-labelled", "labelled vehicles on a graph", _KEYS, _agv, GraphSystem, "pibt"),
)
