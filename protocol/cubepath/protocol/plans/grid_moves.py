"""Plans of vehicles on a grid as arrays, carried out by compiled code.

Whether the moves of a round are legal, and in which order they are made, is what
`cubepath.protocol.plans.vehicles.Vehicles` decides one by one, and this for a whole plan. It does
not say what is wrong with a plan: then nothing is returned, and `Vehicles` finds it.
"""

from collections.abc import Collection, Sequence
from itertools import chain
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.path_files import supports
from cubepath.protocol.path_files.numbered import NumberedPath
from cubepath.protocol.plans.imported import Cell, VehicleMove

Numbers = NDArray[np.int32]
Cells = NDArray[np.int64]


class GridMoves(NamedTuple):
    """The moves that a plan lists, round by round.

    `sources` and `targets` are the cells that are left and entered, shape (moves, 2). Round r from
    1 ends before move ``ends[r - 1]``, shape (rounds,).
    """

    sources: Cells
    targets: Cells
    ends: Cells


class CarriedPlan(NamedTuple):
    """The moves of a plan in the order in which they are made, all of shape (moves,).

    `vehicles` is who moves, `sources` and `targets` are places in `cells`, which are in canonical
    order, and `rounds` counts from 1. `at` is where the vehicles end.
    """

    vehicles: Numbers
    sources: Numbers
    targets: Numbers
    rounds: Cells
    cells: list[Cell]
    at: list[Cell]

    def vehicle_moves(self, *, by_round: bool) -> tuple[VehicleMove, ...]:
        """Return the moves one by one, each with its round if the plan has rounds."""
        cell = self.cells.__getitem__
        rounds = self.rounds.tolist() if by_round else [None] * len(self.rounds)
        ends = (map(cell, places.tolist()) for places in (self.sources, self.targets))
        return tuple(map(VehicleMove, self.vehicles.tolist(), *ends, rounds))

    def numbered(self) -> NumberedPath:
        """Return the path of vehicles without labels: an action for each edge, as it first comes.

        The actions are those of `cubepath.protocol.systems.graph.along_edge`.
        """
        low, high = np.minimum(self.sources, self.targets), np.maximum(self.sources, self.targets)
        keys = low.astype(np.int64) * len(self.cells) + high
        met, first, numbers = np.unique(keys, return_index=True, return_inverse=True)
        order = np.argsort(first)
        rank = np.empty(len(met), dtype=np.int32)
        rank[order] = np.arange(len(met), dtype=np.int32)
        sites = np.stack([low[first[order]], high[first[order]]], axis=1)
        ends = [(self.cells[one], self.cells[other]) for one, other in sites.tolist()]
        says = supports.TRACE
        rows = supports.SupportRows(
            np.arange(0, 2 * len(met) + 1, 2, dtype=np.int32),
            sites.ravel(),
            np.tile(np.array([says | supports.FIRST, says | supports.SECOND], np.int8), len(met)),
            np.zeros(len(met) + 1, dtype=np.int32),
            np.zeros((0, 2), dtype=np.int32),
            np.ones(len(met), dtype=np.bool_),
        )
        table = supports.Supports(rows, self.cells)
        return NumberedPath(
            supports.TabledActions(table, lambda number: f"edge at {site_text(ends[number])}"),
            [GeneratorPlacement("edge", each) for each in ends],
            [True] * len(met),
            rank[numbers],
            (self.sources > self.targets).astype(np.int8),
            table=table,
        )


def cells_of(cells: Sequence[Cell] | chain[Cell]) -> Cells:
    """Return cells as an array of shape (cells, 2); OverflowError beyond 64 bits."""
    return np.fromiter(chain.from_iterable(cells), dtype=np.int64).reshape(-1, 2)


def carry_out(
    starts: Sequence[Cell], vertices: Collection[Site], plan: GridMoves, *, rotate: bool
) -> CarriedPlan | None:
    """Return a plan's moves as made from the starts, None if one is illegal on these vertices.

    The order is that of `Vehicles.go`, or where vehicles may `rotate` that of `Vehicles.turn`.
    """
    cells = sorted(cast("Collection[Cell]", vertices))
    places = cells_of(cells)
    least, most = places.min(axis=0), places.max(axis=0)
    named = np.stack([plan.sources, plan.targets])
    steps = np.abs(named[0] - named[1]).sum(axis=1)
    if (steps != 1).any() or ((named < least) | (named > most)).any():
        return None
    box = np.full(most - least + 1, -1, dtype=np.int32)
    box[tuple((places - least).T)] = np.arange(len(cells))
    sources, targets = np.ascontiguousarray(box[tuple((named - least).T)].T)
    if (targets < 0).any():
        return None
    on, leaving, into = np.full((3, len(cells)), -1, dtype=np.int32)
    on[box[tuple((cells_of(starts) - least).T)]] = np.arange(len(starts))
    order, vehicles = np.empty((2, len(sources)), dtype=np.int32)
    carry = _carry.for_work(3 * len(sources), by_entries=True)
    if not carry(sources, targets, plan.ends, rotate, on, leaving, into, order, vehicles):
        return None
    at = list(starts)
    for place in np.flatnonzero(on >= 0).tolist():
        at[on[place]] = cells[place]
    sizes = np.diff(plan.ends, prepend=0)
    rounds = np.repeat(np.arange(1, len(sizes) + 1), sizes)
    return CarriedPlan(vehicles, sources[order], targets[order], rounds, cells, at)


@compiled
def _carry(  # noqa: C901, PLR0917 - one pass over each round; arguments by position
    sources: Numbers,
    targets: Numbers,
    ends: Cells,
    rotate: bool,  # noqa: FBT001
    on: Numbers,
    leaving: Numbers,
    into: Numbers,
    order: Numbers,
    vehicles: Numbers,
) -> bool:
    """Make the moves, and write their order and who makes them; return whether all are legal.

    `on` has for each cell the vehicle there; `leaving` and `into` have room for the move of this
    round that leaves the cell, and for the one that enters it. All are -1 where there is none.
    """
    begin = 0
    for number in range(len(ends)):
        end = ends[number]
        for move in range(begin, end):
            source, target = sources[move], targets[move]
            if source < 0 or on[source] < 0 or leaving[source] >= 0 or into[target] >= 0:
                return False
            leaving[source] = move
            into[target] = move
        for move in range(begin, end):
            target = targets[move]
            if on[target] >= 0 and (
                leaving[target] < 0 or targets[leaving[target]] == sources[move]
            ):
                return False
        up = begin
        for first in range(2 * begin, 2 * end):
            # First the rows of followers behind a move into an empty cell, and then the rotations.
            move = begin + (first - 2 * begin) % max(end - begin, 1)
            rotates = first - 2 * begin >= end - begin
            if rotates and up < end and not rotate:
                return False
            if rotates or on[targets[move]] < 0:
                while move >= 0 and leaving[sources[move]] >= 0:
                    order[up] = move
                    up += 1
                    leaving[sources[move]] = -1
                    move = into[sources[move]]
        for index in range(begin, end):
            vehicles[index] = on[sources[order[index]]]
            on[sources[order[index]]] = -1
        for index in range(begin, end):
            target = targets[order[index]]
            on[target] = vehicles[index]
            into[target] = -1
        begin = end
    return True
