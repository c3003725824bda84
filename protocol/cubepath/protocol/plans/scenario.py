"""Scenarios: a grid with starts, goals and, once a planner has run, moves.

These are the JSON files of the project's own sample data, an object with "starts"; see
docs/files.md. A vehicle enters only an empty cell, so the moves as listed are one path; where the
file has the planner's rounds, a vehicle moves after the one whose cell it enters, in whatever order
the file lists them, and `ImportedPath.vehicles` reads what rotates in them too.
"""

from collections.abc import Iterable, Iterator
from functools import partial
from itertools import islice
from pathlib import Path
from typing import cast

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import site_text
from cubepath.protocol.plans.imported import Cell, ImportedPath, PlanRequest, no_system, none_beside
from cubepath.protocol.plans.vehicles import Vehicles, planned_path
from cubepath.protocol.systems.graphs import Edge, PlannerInstance, scenario_from_json


def read_scenario(request: PlanRequest) -> ImportedPath:
    """Read a scenario; InputError as `ImportedPath` says."""
    none_beside(request)
    no_system(request, "a scenario, which says itself what its system is")
    path, scenario = request.path, scenario_from_json(request.file)
    free = frozenset(scenario.graph.vertices)
    starts, goals = (cast("list[Cell]", list(each)) for each in (scenario.starts, scenario.goals))
    vehicles = Vehicles(starts, free.__contains__, called="vehicle")
    return planned_path(
        path,
        vehicles,
        ((where, partial(_targets, vehicles, moves)) for where, moves in _rounds(path, scenario)),
        count=scenario.planner_rounds if scenario.rounds is None else len(scenario.rounds),
        graph=lambda: scenario.graph,
        goals=goals,
        unsolved=lambda: _unsolved(vehicles, goals) if scenario.moves else None,
    )


def _rounds(path: Path, scenario: PlannerInstance) -> Iterator[tuple[str, list[Edge]]]:
    """Yield the moves of each round, or each move by itself where there are no rounds."""
    left = iter(scenario.moves)
    if scenario.rounds is None:
        yield from ((f"{path}: move {number}", [move]) for number, move in enumerate(left, 1))
    else:
        for number, size in enumerate(scenario.rounds, 1):
            yield f"{path}: round {number}", list(islice(left, size))


def _targets(vehicles: Vehicles, moves: Iterable[Edge]) -> dict[int, Cell]:
    """Return where the vehicles of a round go."""
    found: dict[int, Cell] = {}
    for source, target in cast("Iterable[tuple[Cell, Cell]]", moves):
        vehicle = vehicles.on.get(source)
        if vehicle is None:
            raise InputError(f"{site_text(source)} is empty, expected a vehicle")
        if vehicle in found:
            raise InputError(f"vehicle {vehicle} moves twice, expected once")
        if source == target:
            raise InputError(f"vehicle {vehicle} stays at {site_text(source)}, expected a move")
        found[vehicle] = target
    return found


def _unsolved(vehicles: Vehicles, goals: list[Cell]) -> str | None:
    """Return how the moves miss the goals, which belong to all vehicles together, as for `agv`.

    A scenario without moves is a starting point, not a plan.
    """
    goal = frozenset(goals)
    off = [(vehicle, cell) for vehicle, cell in enumerate(vehicles.at) if cell not in goal]
    if not off:
        return None
    vehicle, cell = off[0]
    many = "ends" if len(off) == 1 else "end"
    return (
        f"{len(off)} of {len(vehicles.at)} vehicles {many} off the goals, the first is vehicle"
        f" {vehicle}: it ends at {site_text(cell)}, its own goal is {site_text(goals[vehicle])}"
    )
