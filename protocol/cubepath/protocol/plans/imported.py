"""What is read from another program's plan: its moves one after another, and its scene.

Moves are checked as they are made, from the start on; nothing is shortened here.

Written as moves one after another (`ImportedPath.moves`), a plan of vehicles loses its planner's
rounds, and vehicles that rotate on a cycle of vertices have no such order at all. So both forms are
kept. Every move is checked; the coordinator decides what a following vehicle may do.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import InputFile
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.moves import PathMove

Cell = tuple[int, int]


class VehicleMove(msgspec.Struct, frozen=True, gc=False, forbid_unknown_fields=True):
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


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """A request to a reader: a plan, its companion files, and the values of the format's keys."""

    file: InputFile
    companions: Sequence[Path] = ()
    values: Mapping[str, str] = field(default_factory=dict[str, str])
    system: str | None = None

    @property
    def path(self) -> Path:
        """Return the path of the plan."""
        return self.file.path


@dataclass(frozen=True, slots=True)
class ImportedPath:
    """A path that another program has planned.

    `moves` yields each move as soon as it is checked, and raises InputError at the first invalid
    one. `rounds` is the planner's own count of rounds, None if the file does not say. `scene`
    builds the system with the start, which can take long. `labelled_goals` is true if its vehicles
    have no labels, but each has its own goal. `unsolved` may be called after the last move: it
    returns a line on where the plan does not end as its instance requires, None if it does or
    nothing is required. `vehicles` may be called instead of iterating `moves`, once: it returns the
    plan with the planner's rounds and whatever rotates in them, and raises InputError as `moves`
    does; None if the plan is not of vehicles on a grid. `round_sizes` may be called after the last
    move: it returns the number of moves in each round of the planner, nothing if the plan has no
    rounds.
    """

    moves: Iterator[PathMove]
    rounds: int | None
    scene: Callable[[], Scene]
    labelled_goals: bool = False
    unsolved: Callable[[], str | None] = lambda: None
    vehicles: Callable[[], VehiclePlan] | None = None
    round_sizes: Callable[[], Sequence[int]] = tuple


def only(request: PlanRequest, what: str) -> Path:
    """Return the one companion file of the plan; InputError if there is none or several."""
    if not request.companions:
        raise InputError(f"{request.path}: says nothing of its {what}: expected --with FILE")
    if len(request.companions) > 1:
        raise InputError(
            f"{request.companions[1]}: a second file beside the plan,"
            f" expected one --with: its {what}"
        )
    return request.companions[0]


def none_beside(request: PlanRequest) -> None:
    """Raise InputError if there are companion files, which the format does not use."""
    if request.companions:
        raise InputError(
            f"{request.companions[0]}: {request.path} needs no other file, expected no --with"
        )


def no_system(request: PlanRequest, what: str) -> None:
    """Raise InputError if a system is given for a plan that defines its own."""
    if request.system is not None:
        raise InputError(f"{request.path}: {what}, expected no --system")
