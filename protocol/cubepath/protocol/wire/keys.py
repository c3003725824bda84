"""Keys, tiles and regions: where messages about a place are published, and which keeper has it.

Tiles are the small regions that places lie in. Every process derives them from the system and the
number of keepers alone. A tile is a reach wide or a little more, so a move concerns few of them,
and a lost keeper stops few modules.

A message for places is published on the key of the region in which they lie. A process listens to
the regions in which its modules stand, and gives each module only what is addressed to its place. A
key is exact and ends with its sender, so that a router can restrict who may publish on it; only the
coordinator publishes messages for a single process. A coordinator listens to all:

    cubepath/RUN/to/0,1/process_3 what process 3 says to places in the region 0,1
    cubepath/RUN/reports/process_3 for anyone who gathers
    cubepath/RUN/go/coordinator from the coordinator, to all processes
    cubepath/RUN/go/process_3 the same, to one of them
    cubepath/RUN/** everything of a run
"""

import re
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from typing import Any, ClassVar
from zlib import crc32

from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System
from cubepath.protocol.wire.access import KEEPERS_MAX
from cubepath.protocol.wire.messages import (
    Bundle,
    Certified,
    ChosenActions,
    Claim,
    Cube,
    Edges,
    Go,
    Message,
    Note,
    Observations,
    Presence,
    Ready,
    Refused,
    Reports,
    Reset,
    Retransmit,
    Summary,
    Verdict,
    Waiting,
    kind_of,
)

_SIDE = 4
"""Side of a tile in cells, in a plane."""
_ROW = 16
"""Places in a tile, where places have only numbers."""
_NAME = re.compile(r"-?[0-9]+(,-?[0-9]+)?")


class Tiles:
    """The tiles of a system, dealt to this many keepers."""

    keepers_max: ClassVar[int] = KEEPERS_MAX
    """A run has at most this many."""

    def __init__(self, system: System, keepers: int) -> None:
        """Deal tiles to keepers by their names, evenly and at random, the same everywhere."""
        self.keepers = keepers
        self._system = system
        self._places: dict[Site, int] = {}
        if system.letters:  # a place alone is no site, and only sites have numbers
            self._places = {place: number for number, place in enumerate(system.places)}
        self.tile_of = lru_cache(maxsize=1 << 16)(self._tile_of)

    def _tile_of(self, place: Site) -> str:
        """Return the name of the tile that a place lies in, one chunk of a key expression."""
        numbers = self._numbers(place)
        return _square(numbers[:2]) if len(numbers) > 1 else str(numbers[0] // _ROW)

    def _numbers(self, place: Site) -> Sequence[int]:
        system = self._system
        if system.graph is not None:
            # A vertex that is named by two whole numbers is one of a grid, or drawn as if it were.
            if isinstance(place, tuple) and len(place) == 2 and {*map(type, place)} == {int}:
                return place
            return (system.graph.index[place],)
        if self._places:
            return (self._places[place],)
        return system.encode_site(place)

    @staticmethod
    def is_name(tile: str) -> bool:
        """Return whether a text is a tile's name: others could be keys of others, or no keys."""
        return _NAME.fullmatch(tile) is not None

    def keeper_of_tile(self, tile: str) -> int:
        """Return the number of the keeper that has a tile."""
        return crc32(tile.encode()) % self.keepers

    def keeper_of(self, place: Site) -> int:
        """Return the number of the keeper that has a place."""
        return self.keeper_of_tile(self.tile_of(place))

    def unit_of(self, site: Site) -> Site:
        """Return the unit of a site: with labels its place, otherwise itself."""
        return site if self._system.labels is None else self._system.place_of(site)


def _square(numbers: Iterable[int]) -> str:
    return ",".join(str(number // _SIDE) for number in numbers)


ROOT = "cubepath"


def addressees(system: System, message: Message) -> tuple[Site, ...]:
    """Return the places that a message of a module is addressed to."""
    match message:
        case Presence(site=site):
            return system.listeners(system.place_of(site))
        case Note(site=site) | Claim(site=site):
            return system.reach(system.place_of(site))
        case Verdict(to=to):
            return tuple(to)
        case _:
            return ()


@lru_cache(maxsize=16)
def regions_near(system: System) -> Callable[[Site, bool], frozenset[str]]:
    """Return a cached function from a place to the regions that a module there speaks to.

    Its second argument says whether they are those that sense the place, or those within reach.
    """

    @lru_cache(maxsize=1 << 14)
    def near(place: Site, sensed: bool) -> frozenset[str]:  # noqa: FBT001 - a cache key
        places = system.listeners(place) if sensed else system.reach(place)
        return frozenset(map(system.region, places))

    return near


_OF_COORDINATOR = frozenset((Go, Reset, Refused, Edges, Cube, Certified, Summary))
OF_PROCESSES = frozenset((Ready, Bundle, Reports, Observations, ChosenActions, Retransmit, Waiting))
"""The kinds of messages whose sender, or receiver, is one process of modules."""


def sender(message: Message) -> str:
    """Return the name of a message's sender; for actions from outside, of who they are for."""
    kind = type(message)
    if kind in _OF_COORDINATOR:
        return "coordinator"
    named: Any = message
    return f"process_{named.process}" if kind in OF_PROCESSES else f"module_{named.module}"


def key_of(run: str, message: Message) -> str:
    """Return the key that a message is put on."""
    if isinstance(message, Bundle):
        return f"{ROOT}/{run}/to/{message.region}/{sender(message)}"
    return f"{ROOT}/{run}/{topic_of(message)}"


def belongs(run: str, key: str, message: Message) -> bool:
    """Return whether a message may be put on a key: its own, or for one process alone."""
    if key == key_of(run, message):
        return True
    if not isinstance(message, Go | Reset):
        return False
    start, _, number = key.rpartition("/process_")
    return start == f"{ROOT}/{run}/{kind_of(message)}" and number.isdecimal()


def to_region(run: str, region: str) -> str:
    """Return the key expression of messages for the places of a region."""
    return f"{ROOT}/{run}/to/{region}/**"


def topic_in_key(key: str) -> str:
    """Return what follows in a key after the run."""
    return key.split("/", 2)[-1]


def topic_of(message: Message) -> str:
    """Return the part of the key that names kind and sender; it is the topic in recordings."""
    return f"{kind_of(message)}/{sender(message)}"


def everything(run: str) -> str:
    """Return the key expression of every message of a run."""
    return f"{ROOT}/{run}/**"


def topic_key(run: str, kind: str, sender: str = "**") -> str:
    """Return the key of a kind of message and its sender, or of any sender."""
    return f"{ROOT}/{run}/{kind}/{sender}"
