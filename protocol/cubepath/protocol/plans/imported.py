"""What is read from another program's plan: its moves one after another, and its scene.

Moves are checked as they are made, from the start on; nothing is shortened here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import InputFile, Source, opened
from cubepath.protocol.core.json_keys import check_keys
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.moves import PathMove
from cubepath.protocol.plans.vehicle_plan import VehiclePlan

_T = TypeVar("_T")


def _solved() -> None:
    return None


@dataclass(frozen=True, slots=True)
class Request:
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
class Imported:
    """A path that another program has planned.

    `moves` yields each move as soon as it is checked, and raises InputError at the first invalid
    one. `rounds` is the planner's own count of rounds, None if the file does not say. `scene`
    builds the system with the start, which can take long. `labelled_goals` is true if its vehicles
    have no labels, but each has its own goal. `unsolved` may be called after the last move: it
    returns a line on where the plan does not end as its instance requires, None if it does or
    nothing is required. `vehicles` may be called instead of iterating `moves`, once: it returns the
    plan with the planner's rounds and whatever rotates in them, and raises InputError as `moves`
    does; None if the plan is not of vehicles on a grid.
    """

    moves: Iterator[PathMove]
    rounds: int | None
    scene: Callable[[], Scene]
    labelled_goals: bool = False
    unsolved: Callable[[], str | None] = _solved
    vehicles: Callable[[], VehiclePlan] | None = None


def decode_file(source: Source, type_: type[_T]) -> _T:
    """Return the JSON document in a file; InputError names the file and the place in it."""
    with opened(source) as file:
        path, text = file.path, file.whole()
    try:
        found = msgspec.json.decode(text, type=type_)
        check_keys(text, where=f"{path}:")
    except RecursionError:
        raise InputError(f"{path}: lists in lists, nested too deeply") from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: {error}") from None
    return found


def only(request: Request, what: str) -> Path:
    """Return the one companion file of the plan; InputError if there is none or several."""
    if not request.companions:
        raise InputError(f"{request.path}: says nothing of its {what}: expected --with FILE")
    if len(request.companions) > 1:
        raise InputError(
            f"{request.companions[1]}: a second file beside the plan,"
            f" expected one --with: its {what}"
        )
    return request.companions[0]


def none_beside(request: Request) -> None:
    """Raise InputError if there are companion files, which the format does not use."""
    if request.companions:
        raise InputError(
            f"{request.companions[0]}: {request.path} says all itself, expected no --with"
        )


def no_system(request: Request, what: str) -> None:
    """Raise InputError if a system is given for a plan that defines its own."""
    if request.system is not None:
        raise InputError(f"{request.path}: {what}, expected no --system")


def text(site: Site) -> str:
    """Return a site as it is written in a file."""
    return msgspec.json.encode(site).decode()
