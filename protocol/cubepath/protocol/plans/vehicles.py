"""Vehicles on the cells of a grid whose planner moves many of them in one round.

Other planners let a vehicle enter a cell in the round in which another leaves it. Here a cell is
empty before it is entered, so such moves do not commute and are made one after the other: in a row
of followers the first goes first. Moves without such an order are refused: vehicles that swap, and
vehicles that rotate on a cycle of cells, since none of them can begin; `Vehicles.turn` takes those.

No labels are needed to tell the vehicles apart. If two moves along an edge cancel, nothing has
moved at either end between them, so both are moves of the same vehicle, and each vehicle ends where
its plan ends.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TypeVar

from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.moves import PathMove
from cubepath.protocol.plans.imported import Cell, ImportedPath, VehicleMove, VehiclePlan
from cubepath.protocol.systems.graph import GraphSystem, along_edge
from cubepath.protocol.systems.graphs import Graph

_T = TypeVar("_T")
Turned = tuple[int, Cell, Cell]
"""A vehicle, and the cells that it leaves and enters in a round."""


class Vehicles:
    """Vehicles 0, 1, ... on distinct cells (x, y); `called` is the planner's word for one."""

    def __init__(
        self, starts: Sequence[Cell], is_free: Callable[[Cell], bool], *, called: str
    ) -> None:
        """Put every vehicle on its start; InputError if two share one or it is not free."""
        self.at = list(starts)
        """Where each vehicle is."""
        self._is_free = is_free
        self.called = called
        self.on: dict[Cell, int] = {}
        """Which vehicle is on a cell."""
        self._made: dict[tuple[Cell, Cell], PathMove] = {}
        for number, cell in enumerate(starts):
            if not is_free(cell):
                raise InputError(
                    f"{called} {number} starts at {site_text(cell)}, an obstacle or outside"
                )
            other = self.on.setdefault(cell, number)
            if other != number:
                raise InputError(
                    f"{called} {other} and {called} {number} start at {site_text(cell)}"
                )

    def go(self, targets: Mapping[int, Cell]) -> list[PathMove]:
        """Take these vehicles to their cells in one round; return the moves in an admissible order.

        The order is by number, each vehicle followed by its followers. InputError names the first
        vehicle whose move is impossible, and why; then no vehicle has moved.
        """
        movers, order, rings = self._round(targets)
        if rings:
            raise InputError(self._no_order(movers, rings[0]))
        return [self._make(vehicle, movers[vehicle]) for vehicle in order]

    def turn(self, targets: Mapping[int, Cell]) -> list[Turned]:
        """Do the same where vehicles may rotate; return vehicle, source and target of each move.

        The vehicles that rotate come last, cycle by cycle, each after the one whose cell it enters
        but for the first.
        """
        movers, order, rings = self._round(targets)
        order += [vehicle for ring in rings for vehicle in ring]
        moves = [(vehicle, self.at[vehicle], movers[vehicle]) for vehicle in order]
        for _, source, _ in moves:
            del self.on[source]
        for vehicle, _, cell in moves:
            self.at[vehicle] = cell
            self.on[cell] = vehicle
        return moves

    def _round(
        self, targets: Mapping[int, Cell]
    ) -> tuple[dict[int, Cell], list[int], list[list[int]]]:
        """Return who moves where, those that have an order in it, and those that rotate."""
        at, on, is_free = self.at, self.on, self._is_free
        movers = {vehicle: cell for vehicle, cell in targets.items() if cell != at[vehicle]}
        into: dict[Cell, int] = {}
        for vehicle, cell in movers.items():
            source, there = at[vehicle], on.get(cell)
            if (
                abs(cell[0] - source[0]) + abs(cell[1] - source[1]) != 1
                or cell in into
                or not is_free(cell)
                or (there is not None and movers.get(there, source) == source)
            ):
                try:
                    self._check(vehicle, cell, movers, into)
                except InputError as error:
                    raise InputError(f"{self._move(vehicle, cell)}: {error}") from None
            into[cell] = vehicle
        order: list[int] = []
        for vehicle, cell in movers.items():
            follower: int | None = vehicle if cell not in on else None
            while follower is not None:
                order.append(follower)
                follower = into.get(at[follower])
        rings: list[list[int]] = []
        if len(order) < len(movers):
            ordered = set(order)
            for first in movers:
                ring, follower = list[int](), first
                while follower not in ordered:
                    ring.append(follower)
                    ordered.add(follower)
                    follower = into[at[follower]]
                if ring:
                    rings.append(ring)
        return movers, order, rings

    def _check(
        self, vehicle: int, cell: Cell, movers: Mapping[int, Cell], into: Mapping[Cell, int]
    ) -> None:
        """Raise InputError for what makes a move impossible, as `go` has found."""
        x, y = self.at[vehicle]
        if abs(cell[0] - x) + abs(cell[1] - y) != 1:
            raise InputError("no edge of the grid, expected a step to a neighbour")
        if not self._is_free(cell):
            raise InputError(f"{site_text(cell)} is an obstacle or outside, expected free")
        there = self.on.get(cell)
        if there is not None and there not in movers:
            raise InputError(
                f"{site_text(cell)} is occupied by {self.called} {there}, which stays: expected it"
                " empty or left in this round"
            )
        if there is not None and movers[there] == self.at[vehicle]:
            raise InputError(
                f"{self.called} {there} comes the other way: expected no two to swap places"
            )
        if cell in into:
            raise InputError(
                f"{self.called} {into[cell]} enters {site_text(cell)} too, expected one"
            )

    def _no_order(self, movers: Mapping[int, Cell], ring: Sequence[int]) -> str:
        first, *others = ring
        cycle = [first, *reversed(others)]
        names = f"{', '.join(map(str, cycle[:-1]))} and {cycle[-1]}"
        return (
            f"{self._move(first, movers[first])}: {self.called}s {names} rotate, each into the cell"
            " that the next one leaves: expected one of these cells to be empty, or no order of"
            " their moves is legal; 'cubepath improve --following mapf' takes plans that rotate"
        )

    def _move(self, vehicle: int, cell: Cell) -> str:
        return f"{self.called} {vehicle}, {site_text(self.at[vehicle])} to {site_text(cell)}"

    def _make(self, vehicle: int, cell: Cell) -> PathMove:
        source = self.at[vehicle]
        self.at[vehicle] = cell
        del self.on[source]
        self.on[cell] = vehicle
        made = self._made.get((source, cell))
        if made is None:
            # Cells are pairs of numbers, whose own order is the canonical one.
            ends = (source, cell) if source < cell else (cell, source)
            made = PathMove(
                along_edge(*ends), GeneratorPlacement("edge", ends), frozenset((source,))
            )
            self._made[source, cell] = made
        return made


def off_targets(at: Sequence[Cell], targets: Sequence[Cell], called: str) -> str | None:
    """Return how many vehicles end off their targets, and the first of them; None if none."""
    off = [
        vehicles
        for vehicles, ends in enumerate(zip(at, targets, strict=True))
        if ends[0] != ends[1]
    ]
    if not off:
        return None
    first = off[0]
    many = "ends off its target" if len(off) == 1 else "end off their targets"
    return (
        f"{len(off)} of {len(at)} {called}s {many}, the first is {called} {first}: it ends at"
        f" {site_text(at[first])}, expected {site_text(targets[first])}"
    )


def vehicles_scene(
    spec: str, graph: Graph, starts: Sequence[Site], goals: Sequence[Site] | None
) -> Scene:
    """Return the scene of unlabelled vehicles on a graph; `goals` is None if none are known."""
    return Scene(
        spec=spec,
        family="agv",
        system=GraphSystem(graph.vertices, graph.edges, compass=graph.compass),
        start=tuple(starts),
        goal=None if goals is None else frozenset(goals),
        goals=() if goals is None else tuple((goal,) for goal in goals),
    )


def planned_path(
    path: Path,
    vehicles: Vehicles,
    rounds: Iterable[tuple[str, Callable[[], Mapping[int, Cell]]]],
    *,
    count: int | None,
    graph: Callable[[], Graph],
    goals: Sequence[Cell] | None,
    unsolved: Callable[[], str | None],
) -> ImportedPath:
    """Return a plan by its rounds, each with where it stands in the file, and who goes where in it.

    The latter is asked for when the rounds before have been made. `count` is the planner's number
    of rounds, None if each round is a move and the plan does not say more.
    """
    starts = tuple(vehicles.at)
    sizes = list[int]()

    def made(go: Callable[[Mapping[int, Cell]], list[_T]]) -> Iterator[list[_T]]:
        for where, targets in rounds:
            try:
                moves = go(targets())
            except InputError as error:
                raise InputError(f"{where}, {error}") from None
            sizes.append(len(moves))
            yield moves

    def plan() -> VehiclePlan:
        moves = tuple(
            VehicleMove(vehicle, source, target, None if count is None else number)
            for number, turned in enumerate(made(vehicles.turn), 1)
            for vehicle, source, target in turned
        )
        edges = lambda: graph().edges  # noqa: E731 - built late, which can take long
        return VehiclePlan(path, starts, moves, count, vehicles.called, edges, unsolved())

    return ImportedPath(
        chain.from_iterable(made(vehicles.go)),
        count,
        lambda: vehicles_scene(str(path), graph(), starts, goals),
        labelled_goals=True,
        unsolved=unsolved,
        vehicles=plan,
        round_sizes=lambda: sizes,
    )
