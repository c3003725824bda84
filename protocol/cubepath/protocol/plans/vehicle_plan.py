"""Plans of vehicles with the planner's own rounds, in which some may follow or rotate.

As moves one after another (`Imported.moves`) a plan loses what its planner did at one time, and
vehicles that rotate on a cycle of vertices have no such order at all. Here both are kept.

Every move is checked; what a following vehicle may do is up to the coordinator.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from cubepath.protocol.core.sites import Site

Cell = tuple[int, int]


@dataclass(frozen=True, slots=True)
class VehicleMove:
    """A vehicle, by its number from 0, that goes along an edge; `round` is the planner's, from 1.

    The round is None where the plan only says in which order its moves are made.
    """

    vehicle: int
    source: Cell
    target: Cell
    round: int | None


@dataclass(frozen=True, slots=True, eq=False)
class VehiclePlan:
    """A plan of vehicles, legal from `starts` on if a vertex may be entered as it is left.

    `moves` are by rounds, and at each vertex in the order of the visits: who leaves it comes before
    who enters it. The moves of a rotation stand side by side, each before the one that enters what
    it leaves, but for the last. `rounds` is the planner's own count, None if the plan does not say.
    `called` is the planner's word for a vehicle. `edges` lists the edges of the workspace, which
    can take long; `unsolved` is one line on how the end differs from what the instance asks for, or
    None.
    """

    path: Path
    starts: tuple[Cell, ...]
    moves: tuple[VehicleMove, ...]
    rounds: int | None
    called: str
    edges: Callable[[], Sequence[tuple[Site, Site]]]
    unsolved: str | None = None

    @property
    def ends(self) -> tuple[Cell, ...]:
        """Where each vehicle ends."""
        at = list(self.starts)
        for move in self.moves:
            at[move.vehicle] = move.target
        return tuple(at)
