"""CG:SHOP 2021, coordinated motion planning: an instance and the steps of a solution.

Source: the competition's own reader and validator, package cgshop2021-pyutils 0.1.1 on PyPI
(`instance/instance_reader.py`, `solution/solution_reader.py`, `solution/solution.py`)::

    {"name": "demo", "obstacles": [[1, 1]], "starts": [[0, 0], [1, 0]], "targets": [[1, 0], [2, 0]]}
    {"instance": "demo", "steps": [{"0": "E", "1": "E"}]}

A step is an object from robot numbers, as text, to N (0, 1), E (1, 0), S (0, -1) or W (-1, 0).
Robots that are not named wait. In the competition a robot may enter a cell in the step in which
another leaves it, in the same direction. Here the moves are made one after the other (see
`cubepath.protocol.plans.vehicles`), and the two directions may differ. The competition's plane is
unbounded: the workspace here is the bounding box of all named and visited cells, one cell larger on
each side.
"""

import re
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import msgspec

from cubepath.protocol.core.errors import InputError, errors_at
from cubepath.protocol.core.parsing import read_json
from cubepath.protocol.core.sites import site_text
from cubepath.protocol.plans import imported
from cubepath.protocol.plans.vehicles import Vehicles, off_targets, planned_path
from cubepath.protocol.systems.graphs import Graph, graph_round

_NUMBER = re.compile(r"[0-9]{1,9}")
_DIRECTIONS = {"N": (0, 1), "E": (1, 0), "S": (0, -1), "W": (-1, 0)}


class _Instance(msgspec.Struct):
    starts: list[imported.Cell]
    targets: list[imported.Cell]
    obstacles: list[imported.Cell]
    name: str | None = None


class _Solution(msgspec.Struct):
    instance: str
    steps: list[dict[str, str]]


def read_cgshop2021(request: imported.PlanRequest) -> imported.ImportedPath:
    """Read a solution, with its instance in a second file; errors as `ImportedPath` says."""
    path = request.path
    imported.no_system(request, "a CG:SHOP 2021 solution, whose instance says what the system is")
    companion = imported.only(request, "instance")
    instance, solution = _pair(request, companion)
    obstacles = frozenset(instance.obstacles)
    with errors_at(str(companion)):
        vehicles = Vehicles(instance.starts, lambda cell: cell not in obstacles, called="robot")
    rounds = (
        (f"{path}: steps[{number}]", partial(_targets, step, vehicles.at))
        for number, step in enumerate(solution.steps)
    )
    return planned_path(
        path,
        vehicles,
        rounds,
        count=len(solution.steps),
        graph=partial(_graph, companion, instance, solution),
        goals=instance.targets,
        unsolved=lambda: off_targets(vehicles.at, instance.targets, "robot"),
    )


def _graph(companion: Path, instance: _Instance, solution: _Solution) -> Graph:
    """Return the workspace, all of whose moves must have been checked."""
    named = [*instance.starts, *instance.targets, *instance.obstacles]
    at = list(instance.starts)
    for step in solution.steps:
        for robot, cell in _targets(step, at).items():
            at[robot] = cell
            named.append(cell)
    return graph_round(str(companion), named, frozenset(instance.obstacles))


def _pair(request: imported.PlanRequest, companion: Path) -> tuple[_Instance, _Solution]:
    """Return instance and solution; InputError if they do not belong together."""
    path = request.path
    instance = read_json(companion, _Instance)
    solution = read_json(request.file, _Solution)
    if instance.name not in (None, solution.instance):
        raise InputError(
            f"{path}: a solution of {solution.instance!r}, but {companion} is {instance.name!r}"
        )
    if len(instance.starts) != len(instance.targets):
        raise InputError(
            f"{companion}: {len(instance.starts)} starts and {len(instance.targets)} targets"
        )
    return instance, solution


def _targets(step: Mapping[str, str], at: Sequence[imported.Cell]) -> dict[int, imported.Cell]:
    """Return where the robots of a step go, by number; `at` is where each robot is."""
    found: dict[int, imported.Cell] = {}
    for name, letter in step.items():
        if not (_NUMBER.fullmatch(name) and int(name) < len(at)):
            raise InputError(f"robot {site_text(name)}: expected a number, 0 to {len(at) - 1}")
        if letter not in _DIRECTIONS:
            raise InputError(f"robot {name} goes {site_text(letter)}, expected N, E, S or W")
        robot = int(name)
        if robot in found:
            raise InputError(f"robot {robot} is named twice, expected once")
        x, y = at[robot]
        dx, dy = _DIRECTIONS[letter]
        found[robot] = (x + dx, y + dy)
    return dict(sorted(found.items()))
