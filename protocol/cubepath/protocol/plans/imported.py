"""What is read from another program's plan: its moves one after another, and where it plays.

Room: protocol. Moves are checked as they are made, from the start on; nothing is shortened here.
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

_T = TypeVar("_T")


def _solved() -> None:
    return None


@dataclass(frozen=True, slots=True)
class Request:
    """What a reader is asked for: a plan, the files it is about, and the values of its keys."""

    file: InputFile
    companions: Sequence[Path] = ()
    values: Mapping[str, str] = field(default_factory=dict[str, str])
    system: str | None = None

    @property
    def path(self) -> Path:
        """Return where the plan is."""
        return self.file.path


@dataclass(frozen=True, slots=True)
class Imported:
    """A path that another program has planned.

    `moves` yields each move as soon as it is checked, and raises InputError at the first that is
    not as it must be. `rounds` is how many rounds the planner has counted itself, None where the
    file does not say. `scene` builds the system with the start, which can take long; its vehicles
    have `labelled_goals` where they bear no labels but each is to end where it does. `unsolved`,
    asked once all moves have come, says in a line where the plan does not end as its instance asks,
    None where it does or nothing is asked.
    """

    moves: Iterator[PathMove]
    rounds: int | None
    scene: Callable[[], Scene]
    labelled_goals: bool = False
    unsolved: Callable[[], str | None] = _solved


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
    """Return the one file that the plan is about; InputError where there is none, or are more."""
    if not request.companions:
        raise InputError(f"{request.path}: says nothing of its {what}: expected --with FILE")
    if len(request.companions) > 1:
        raise InputError(
            f"{request.companions[1]}: a second file beside the plan,"
            f" expected one --with: its {what}"
        )
    return request.companions[0]


def none_beside(request: Request) -> None:
    """Raise InputError where files are given that the format has no use for."""
    if request.companions:
        raise InputError(
            f"{request.companions[0]}: {request.path} says all itself, expected no --with"
        )


def no_system(request: Request, what: str) -> None:
    """Raise InputError where a system is named beside a plan that says itself what it is."""
    if request.system is not None:
        raise InputError(f"{request.path}: {what}, expected no --system")


def text(site: Site) -> str:
    """Return a site as people read it in a file."""
    return msgspec.json.encode(site).decode()
