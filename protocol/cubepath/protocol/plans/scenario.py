"""Scenarios: a grid with starts, goals and, once a planner has run, moves.

These are the JSON files of the project's own sample data, an object with "starts"; see
docs/files.md. A vehicle enters only an empty cell, so the moves as listed are one path; where the
file has the planner's rounds, a vehicle moves after the one whose cell it enters, in whatever order
the file lists them, and `ImportedPath.vehicles` reads what rotates in them too.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import cast

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.path_files.moves import PathMove
from cubepath.protocol.plans.imported import (
    Cell,
    ImportedPath,
    PlanRequest,
    VehiclePlan,
    no_system,
    none_beside,
    text,
)
from cubepath.protocol.plans.vehicles import Turned, Vehicles, moves_of_rounds, vehicles_scene
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.systems.graphs import PlannerInstance, scenario_from_json


def read_scenario(request: PlanRequest) -> ImportedPath:
    """Read a scenario; InputError as `ImportedPath` says."""
    none_beside(request)
    no_system(request, "a scenario, which says itself what its system is")
    path, scenario = request.path, scenario_from_json(request.file)
    return ImportedPath(
        _moves(path, scenario),
        scenario.planner_rounds,
        lambda: vehicles_scene(str(path), scenario.graph, scenario.starts, scenario.goals),
        labelled_goals=True,
        unsolved=lambda: _unsolved(path, scenario),
        vehicles=lambda: _plan(path, scenario),
    )


def _plan(path: Path, scenario: PlannerInstance) -> VehiclePlan:
    """Return the plan with its rounds; without any, the moves are checked one after another."""
    starts = tuple(map(_cell, scenario.starts))
    if scenario.rounds is None:
        for _ in _moves(path, scenario):
            pass
    moves = moves_of_rounds(_turned(path, scenario))
    if scenario.rounds is None:
        moves = tuple(replace(move, round=None) for move in moves)
    edges, rounds = scenario.graph.edges, scenario.planner_rounds
    unsolved = _unsolved(path, scenario)
    return VehiclePlan(path, starts, moves, rounds, "vehicle", lambda: edges, unsolved)


def _turned(path: Path, scenario: PlannerInstance) -> Iterator[list[Turned]]:
    """Yield the moves of each round, or each move by itself where there are no rounds."""
    free = set(scenario.graph.vertices)
    vehicles = Vehicles(list(map(_cell, scenario.starts)), free.__contains__, called="vehicle")
    on = {cell: who for who, cell in enumerate(vehicles.at)}
    left = iter(scenario.moves)
    sizes = (1,) * len(scenario.moves) if scenario.rounds is None else scenario.rounds
    for number, size in enumerate(sizes, 1):
        where = f"{path}: round {number}"
        targets: dict[int, Cell] = {}
        for source, target in islice(left, size):
            who = on.get(_cell(source))
            if who is None:
                raise InputError(f"{where}: {text(source)} is empty, expected a vehicle")
            if who in targets:
                raise InputError(f"{where}: vehicle {who} moves twice, expected once")
            if source == target:
                raise InputError(f"{where}: vehicle {who} stays at {text(source)}, expected a move")
            targets[who] = _cell(target)
        try:
            turned = vehicles.turn(dict(sorted(targets.items())))
        except InputError as error:
            raise InputError(f"{where}, {error}") from None
        for _, source, _ in turned:
            del on[source]
        on.update((target, who) for who, _, target in turned)
        yield turned


def _cell(site: Site) -> Cell:
    return cast("Cell", site)  # as a scenario has them


def _unsolved(path: Path, scenario: PlannerInstance) -> str | None:
    """Return how the moves miss the goals, which belong to all vehicles together, as for `agv`.

    A scenario without moves is a starting point, not a plan.
    """
    if not scenario.moves:
        return None
    at = {cell: who for who, cell in enumerate(scenario.starts)}
    moves = iter(scenario.moves)
    for number, size in enumerate(scenario.rounds or (1,) * len(scenario.moves), 1):
        # All of a round leave before any enters, as they may rotate.
        going: list[tuple[Site, int]] = []
        for source, target in islice(moves, size):
            if source not in at:
                where = f"{path}: round {number}: {text(source)}"
                raise InputError(f"{where} is empty at its beginning, expected a vehicle")
            going.append((target, at.pop(source)))
        at.update(going)
    goals = set(scenario.goals)
    off = sorted((who, cell) for cell, who in at.items() if cell not in goals)
    if not off:
        return None
    who, cell = off[0]
    many = "ends" if len(off) == 1 else "end"
    return (
        f"{len(off)} of {len(at)} vehicles {many} off the goals, the first is vehicle {who}: it"
        f" ends at {text(cell)}, its own goal is {text(scenario.goals[who])}"
    )


def _moves(path: Path, scenario: PlannerInstance) -> Iterator[PathMove]:
    """Yield the moves of a scenario's vehicles, each checked on the grid, from the starts on."""
    taken, free = set(scenario.starts), set(scenario.graph.vertices)
    edges = set(scenario.graph.edges)
    actions: dict[tuple[Site, ...], Action] = {}
    for number, (source, target) in _ordered(scenario, taken):
        try:
            for cell in (source, target):
                _expect(cell in free, f"{text(cell)} is an obstacle or outside, expected free")
            adjacent = (source, target) in edges or (target, source) in edges
            _expect(adjacent, "no edge of the grid, expected a step to a neighbouring cell")
            _expect(source in taken, f"{text(source)} is empty, expected a vehicle")
            _expect(target not in taken, f"{text(target)} is occupied, expected it empty")
        except InputError as error:
            where = f"{path}: move {number}, {text(source)} to {text(target)}"
            raise InputError(f"{where}: {error}") from None
        taken.remove(source)
        taken.add(target)
        ends = in_order((source, target))
        # The system of a single edge defines the action; a large grid's would take long to build.
        action = actions.get(ends) or GraphSystem(ends, [(source, target)]).action("edge", ends)
        actions[ends] = action
        yield PathMove(action, GeneratorPlacement("edge", ends), frozenset({source}))


def _ordered(
    scenario: PlannerInstance, taken: Container[Site]
) -> Iterator[tuple[int, tuple[Site, Site]]]:
    """Yield the moves with their numbers; in a round a cell is left before it is entered.

    The moves of a round are simultaneous, so the order in which the file lists them says nothing.
    The caller keeps up to date which cells are `taken`.
    """
    left = enumerate(scenario.moves, 1)
    for size in scenario.rounds or (1,) * len(scenario.moves):
        waiting: dict[Site, tuple[int, tuple[Site, Site]]] = {}
        for move in islice(left, size):
            source, target = move[1]
            if target in taken and target not in waiting:
                waiting[target] = move
                continue
            yield move
            while source in waiting:
                follower = waiting.pop(source)
                yield follower
                source = follower[1][0]
        yield from waiting.values()  # nobody left the cell, or they rotate


def _expect(holds: bool, otherwise: str) -> None:  # noqa: FBT001 - reads as a sentence
    if not holds:
        raise InputError(otherwise)
