"""Vehicles on a graph, unlabelled and labelled, from the name of a graph, from files or at random.

Source: Abrams and Ghrist, example of automated guided vehicles.
"""

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.random_scenes import (
    SEED_MAX,
    WALK_KEY,
    Stream,
    open_part,
    random_graph,
    walk_length,
    walked,
)
from cubepath.protocol.scenes.registry import Family, Values, whole
from cubepath.protocol.systems import benchmarks, graphs
from cubepath.protocol.systems.graph import GraphSystem

_GRAPH = "grid6x6"
_YAML = (".yaml", ".yml")


def _agv(name: str, values: Values) -> Scene:
    """Build vehicles on a graph, from a file's starts and goals or from its first vertices."""
    labelled = name == "agv-labelled"
    if values["seed"]:
        return _random(name, values)
    _check_nothing_random(values)
    if values["scene"]:
        graph, starts, goals = _of_scene(values)
    else:
        graph = _graph(values)
        vertices = in_order(graph.vertices)
        count = whole({"n": values["n"] or "2"}, "n", least=1)
        if count > len(vertices):
            raise InputError(f"n={count}: the graph has {len(vertices)} vertices")
        starts = vertices[:count]
        # The last vertices in reverse, so labelled vehicles must pass one another.
        goals = tuple(reversed(vertices))[:count]
    system = _system(graph, len(starts), labelled=labelled)
    return _scene(name, system, starts, goals)


def _of_scene(values: Values) -> tuple[graphs.Graph, Sequence[Site], Sequence[Site]]:
    """Return the graph, starts and goals of a scene's file: of its first n vehicles, or of all."""
    path, on = Path(values["scene"]), values["graph"]
    task: graphs.PlannerInstance | benchmarks.BenchmarkTask
    if path.suffix == ".scen":
        task = benchmarks.task_from_scen(path)
        if Path(on).name != Path(task.map_name).name:
            raise InputError(f"{path}: on {task.map_name}, expected graph=FILE of that name")
        graph = _graph(values)
    elif path.suffix in _YAML:
        task = benchmarks.task_from_yaml(path, values["entry"])
        if Path(on).suffix not in _YAML:
            raise InputError(f"{path}: on {task.map_name}, expected graph=FILE.yaml with that map")
        graph = benchmarks.graph_from_yaml(Path(on), task.map_name)
    else:
        task = graphs.scenario_from_json(path)
        graph = _graph(values) if on else task.graph
    starts, goals = task.starts, task.goals
    if values["n"]:
        count = whole(values, "n", least=1)
        if count > len(starts):
            raise InputError(f"n={count}: the scene has {len(starts)} vehicles")
        starts, goals = starts[:count], goals[:count]
    if isinstance(task, benchmarks.BenchmarkTask):
        graphs.check_vehicles(
            str(path), graph, task.starts[: len(starts)], task.goals[: len(starts)]
        )
    return graph, starts, goals


def _graph(values: Values) -> graphs.Graph:
    name = values["graph"] or _GRAPH
    if Path(name).suffix in _YAML:
        return benchmarks.graph_from_yaml(Path(name), values["entry"])
    if values["entry"]:
        raise InputError(f"entry={values['entry']}: expected graph=FILE.yaml too")
    return graphs.graph_from_name(name)


def _check_nothing_random(values: Values) -> None:
    for key in ("open", "walk"):
        if values[key]:
            raise InputError(f"{key}={values[key]}: expected seed=NUMBER too")
    if random_graph(values["graph"]) is not None:
        raise InputError(f"graph={values['graph']}: expected seed=NUMBER too")


def _random(name: str, values: Values) -> Scene:
    """Build vehicles whose starts and goals are drawn, on a graph that may be drawn too."""
    if values["scene"]:
        raise InputError(
            f"seed={values['seed']}: starts and goals are those of the scene, expected graph=FILE"
            " for random ones"
        )
    seed = whole(values, "seed", least=0, most=SEED_MAX)
    named = values["graph"] or _GRAPH
    draw = random_graph(named)
    graph = _graph(values) if draw is None else draw(Stream(f"graph:{named}", seed))
    if values["open"]:
        graph = open_part(graph, values["open"], Stream("open", seed))
    vertices = in_order(graph.vertices)
    count = whole({"n": values["n"] or "2"}, "n", least=1)
    if count > len(vertices):
        raise InputError(f"n={count}: the graph has {len(vertices)} vertices")
    starts = tuple(islice(Stream("starts", seed).drawn(vertices), count))
    system = _system(graph, count, labelled=name == "agv-labelled")
    moves = walk_length(values, count)
    if moves is None:
        goals = tuple(islice(Stream("goals", seed).drawn(vertices), count))
    else:
        ends = walked(system, _sites(system, starts), moves, Stream("walk", seed))
        goals = tuple(map(system.place_of, ends))
    return _scene(name, system, starts, goals)


def _system(graph: graphs.Graph, count: int, *, labelled: bool) -> GraphSystem:
    return GraphSystem(
        graph.vertices, graph.edges, labels=count if labelled else None, compass=graph.compass
    )


def _sites(system: GraphSystem, vertices: Sequence[Site]) -> tuple[Site, ...]:
    """Return the sites of vehicles at these vertices, the first with the first label."""
    if system.labels is None:
        return tuple(vertices)
    return tuple((vertex, label) for label, vertex in enumerate(vertices))


def _scene(name: str, system: GraphSystem, starts: Sequence[Site], goals: Sequence[Site]) -> Scene:
    return Scene(
        spec=name,
        family=name,
        system=system,
        start=_sites(system, starts),
        goal=frozenset(_sites(system, goals)),
        goals=tuple((v,) for v in goals),
    )


_KEYS = {
    "graph": (
        "",
        "grid6x6, K5, C8, P9, S4, tree20, gnp20x0.2, regular20x3, a file: .map, .yaml, edge list",
    ),
    "n": ("", "number of vehicles, 2 or all of the scene"),
    "scene": ("", "a file with starts and goals: JSON, or .scen or POGEMA's .yaml for a graph"),
    "entry": ("", "of POGEMA's files: the scenario, or without one the map, by name or number"),
    "seed": ("", "of random starts and goals, and of a random graph"),
    "open": ("", "share of the vertices that are open; the largest connected part is taken"),
    "walk": WALK_KEY,
}


def _is_file(key: str, value: str) -> bool:
    if key == "graph":
        return bool(value) and not graphs.is_named_graph(value) and random_graph(value) is None
    return key == "scene" and bool(value)


FAMILIES = tuple(
    Family(name, f"{what} vehicles on a graph", _KEYS, _agv, GraphSystem, rule, is_file=_is_file)
    for name, what, rule in (("agv", "unlabelled", "tswap"), ("agv-labelled", "labelled", "pibt"))
)
