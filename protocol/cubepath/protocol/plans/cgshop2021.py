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

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TypeVar

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.moves import PathMove
from cubepath.protocol.plans.imported import (
    Cell,
    ImportedPath,
    PlanRequest,
    VehiclePlan,
    decode_file,
    no_system,
    only,
    text,
)
from cubepath.protocol.plans.vehicles import (
    Vehicles,
    fits,
    moves_of_rounds,
    off_targets,
    vehicles_scene,
)
from cubepath.protocol.systems.graphs import Graph, graph_round

_T = TypeVar("_T")
_NUMBER = re.compile(r"[0-9]{1,9}")
_DIRECTIONS = {"N": (0, 1), "E": (1, 0), "S": (0, -1), "W": (-1, 0)}
_MIRRORED = {
    "N and S exchanged, y downwards": {**_DIRECTIONS, "N": (0, -1), "S": (0, 1)},
    "W and E exchanged, x leftwards": {**_DIRECTIONS, "W": (1, 0), "E": (-1, 0)},
    "x and y exchanged": {letter: (y, x) for letter, (x, y) in _DIRECTIONS.items()},
}
"""Other readings of the directions that a plan may have been written with."""


class _Instance(msgspec.Struct):
    starts: list[Cell]
    targets: list[Cell]
    obstacles: list[Cell]
    name: str | None = None


class _Solution(msgspec.Struct):
    instance: str
    steps: list[dict[str, str]]


def read_cgshop2021(request: PlanRequest) -> ImportedPath:
    """Read a solution, with its instance in a second file; errors as `ImportedPath` says."""
    path = request.path
    no_system(request, "a CG:SHOP 2021 solution, whose instance says what the system is")
    companion = only(request, "instance")
    instance, solution = _pair(request, companion)
    obstacles = frozenset(instance.obstacles)

    def is_free(cell: Cell) -> bool:
        return cell not in obstacles

    graph = partial(_graph, companion, instance, solution)
    try:
        vehicles = Vehicles(instance.starts, is_free, called="robot")
    except InputError as error:
        raise InputError(f"{companion}: {error}") from None

    def made(go: Callable[[Mapping[int, Cell]], list[_T]]) -> Iterator[list[_T]]:
        for number, step in enumerate(solution.steps):
            try:
                yield go(_targets(step, vehicles.at))
            except InputError as error:
                mirrored = _mirrored(instance, solution, is_free)
                raise InputError(f"{path}: steps[{number}], {error}{mirrored}") from None

    def unsolved() -> str | None:
        off = off_targets(vehicles.at, instance.targets, "robot")
        return None if off is None else f"{off}{_mirrored(instance, solution, is_free)}"

    def scene() -> Scene:
        return vehicles_scene(str(path), graph(), instance.starts, instance.targets)

    def plan() -> VehiclePlan:
        moves = moves_of_rounds(made(vehicles.turn))
        rounds, edges = len(solution.steps), lambda: graph().edges
        starts = tuple(instance.starts)
        return VehiclePlan(path, starts, moves, rounds, "robot", edges, unsolved())

    moves: Iterator[PathMove] = chain.from_iterable(made(vehicles.go))
    rounds = len(solution.steps)
    return ImportedPath(moves, rounds, scene, labelled_goals=True, unsolved=unsolved, vehicles=plan)


def _graph(companion: Path, instance: _Instance, solution: _Solution) -> Graph:
    """Return the workspace, all of whose moves must have been checked."""
    named = [*instance.starts, *instance.targets, *instance.obstacles]
    at = list(instance.starts)
    for step in solution.steps:
        for who, cell in _targets(step, at).items():
            at[who] = cell
            named.append(cell)
    return graph_round(str(companion), named, frozenset(instance.obstacles))


def _pair(request: PlanRequest, companion: Path) -> tuple[_Instance, _Solution]:
    """Return instance and solution; InputError if they do not belong together."""
    path = request.path
    instance = decode_file(companion, _Instance)
    solution = decode_file(request.file, _Solution)
    if instance.name not in (None, solution.instance):
        raise InputError(
            f"{path}: a solution of {solution.instance!r}, but {companion} is {instance.name!r}"
        )
    if len(instance.starts) != len(instance.targets):
        raise InputError(
            f"{companion}: {len(instance.starts)} starts and {len(instance.targets)} targets"
        )
    return instance, solution


def _mirrored(instance: _Instance, solution: _Solution, is_free: Callable[[Cell], bool]) -> str:
    """Return which directions would make a plan solve its instance, for the end of a line."""
    for how, directions in _MIRRORED.items():

        def rounds(
            vehicles: Vehicles, directions: Mapping[str, Cell] = directions
        ) -> Iterator[Mapping[int, Cell]]:
            return (_targets(step, vehicles.at, directions) for step in solution.steps)

        if fits(instance.starts, is_free, rounds, instance.targets):
            return f"; it solves the instance with {how}"
    return ""


def _targets(
    step: Mapping[str, str], at: Sequence[Cell], directions: Mapping[str, Cell] = _DIRECTIONS
) -> dict[int, Cell]:
    """Return where the robots of a step go, by number; `at` is where each robot is."""
    found: dict[int, Cell] = {}
    for name, letter in step.items():
        if not (_NUMBER.fullmatch(name) and int(name) < len(at)):
            raise InputError(f"robot {text(name)}: expected a number, 0 to {len(at) - 1}")
        if letter not in _DIRECTIONS:
            raise InputError(f"robot {name} goes {text(letter)}, expected N, E, S or W")
        who = int(name)
        if who in found:
            raise InputError(f"robot {who} is named twice, expected once")
        x, y = at[who]
        dx, dy = directions[letter]
        found[who] = (x + dx, y + dy)
    return dict(sorted(found.items()))
