"""A state of a few keepers and modules, and what can be said in it: for their exploration."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias

from cubepath.agents.keepers.journal import Record, commit_in
from cubepath.agents.keepers.keeper import Keeper, name_of
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.wire.free_messages import (
    Attempt,
    Commit,
    Decision,
    Entered,
    EnterRequest,
    Forwarded,
    Forwards,
    Inquiry,
    Replies,
    Settled,
)
from cubepath.protocol.wire.keys import Tiles

Part: TypeAlias = Attempt | EnterRequest | Forwarded | Decision | Inquiry | Settled | Entered


class Letter(NamedTuple):
    """A part of a message under way; modules are numbered from -1 down."""

    sender: int
    to: int
    part: Part


class Dealt(Tiles):
    """Every place is a tile of its own, and these keepers have them."""

    def __init__(self, system: System, keeper_of: dict[Site, int]) -> None:
        """Deal the places so."""
        super().__init__(system, max(keeper_of.values()) + 1)
        self.tile_of = lru_cache(str)
        self._dealt = {str(place): keeper for place, keeper in keeper_of.items()}

    def keeper_of_tile(self, tile: str) -> int:
        """Return the number of the keeper that has a tile."""
        return self._dealt[tile]


class Log:
    """A journal whose records are never changed, so that copies of a keeper share them."""

    def __init__(self, records: tuple[Record, ...] = ()) -> None:
        """Begin with these."""
        self.all = records

    def __deepcopy__(self, memo: dict[int, Any]) -> Log:
        """Return another log with the same records."""
        return Log(self.all)

    def append(self, record: Record) -> None:
        """Add a record."""
        self.all = (*self.all, record)

    def records(self) -> Iterator[Record]:
        """Yield all records, in their order."""
        return iter(self.all)

    def commit(self, serial: int) -> Commit:
        """Return the commit of this serial number, from 1."""
        found = [moved for each in self.all for moved in [commit_in(each)] if moved is not None]
        return next(moved for moved in found if moved.serial == serial)

    @property
    def grown(self) -> bool:
        """Return that it is never compacted."""
        return False

    def compact(self, records: Iterable[Record]) -> None:
        """Replace all records by these."""
        self.all = tuple(records)


class Module(NamedTuple):
    """What a module knows; in no phase but its own does it say anything."""

    phase: str
    """entering, idle, pending, or dead."""
    incarnation: int
    epoch: int
    number: int
    site: Site
    left: int
    """How many attempts it may still begin."""
    says: tuple[int, ...] = ()
    """The numbers of the letters that it says until it is answered."""


class Faults(NamedTuple):
    """How many of each may still happen."""

    double: int = 0
    loss: int = 0
    module: int = 0
    """Crashes of modules, which come back without memory, or do not."""
    keeper: int = 0
    """Crashes of keepers, which come back from their journals."""


class World(NamedTuple):
    """A global state; keepers, histories and letters by number."""

    keepers: tuple[int, ...]
    modules: tuple[Module, ...]
    under_way: frozenset[int]
    history: int
    faults: Faults


@dataclass(frozen=True, slots=True)
class Scenario:
    """Who is where, who may attempt what, and what may go wrong."""

    scene: Scene
    keeper_of: dict[Site, int]
    targets: Callable[[int, Site], Iterable[tuple[Site, tuple[tuple[Site, Site | None], ...]]]]
    """By module and site, where it may attempt to go, with its guards."""
    others: Callable[[int, Module], Iterable[Attempt]] = lambda *_: ()
    """Other attempts that it may make."""
    attempts: int = 1
    faults: Faults = Faults()  # noqa: RUF009 - a tuple
    enters: bool = False
    """Whether modules begin outside."""


def letters_of(keeper: Keeper) -> Iterator[Letter]:
    """Yield what a keeper has to say to others that are explored."""
    for message in keeper.outgoing():
        if isinstance(message, Forwards):
            for part in message.parts:
                yield Letter(keeper.me, message.to, part)
        elif isinstance(message, Replies):
            for told in message.parts:
                yield Letter(keeper.me, -message.process - 1, told)


def unchanged(world: World) -> World:
    return world


def with_module(world: World, number: int, module: Module) -> World:
    modules = (*world.modules[:number], module, *world.modules[number + 1 :])
    return world._replace(modules=modules)


def words_of(letter: Letter) -> str:
    def who(number: int) -> str:
        return f"keeper {number}" if number >= 0 else f"module {-number - 1}"

    part = letter.part
    about: tuple[object, ...] = ()
    if not isinstance(part, Entered | EnterRequest):
        about = name_of(part.attempt if isinstance(part, Forwarded) else part)
    if isinstance(part, Decision):
        about = (*about, part.reason or "committed")
    return f"{who(letter.sender)} to {who(letter.to)}: {type(part).__name__} {about}"
