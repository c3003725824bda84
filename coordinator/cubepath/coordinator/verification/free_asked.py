"""What modules asked for and were shown, in numbers: as much of it as is compared with others.

Part of `cubepath verify`. Contents are compared by hashes of 64 bits, within one process.
"""

from array import array
from bisect import bisect_left
from collections.abc import Hashable, Iterable, Iterator
from typing import NamedTuple

from cubepath.coordinator.verification.free_units import NO_SITE
from cubepath.coordinator.verification.number_table import Name, Names
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System
from cubepath.protocol.wire.free_messages import Attempt
from cubepath.protocol.wire.keys import Tiles
from cubepath.protocol.wire.messages import encode

_HALF = 1 << 31
_UNHEARD, _PASSED, _ASKED, _BELIEVED = range(4)


def attempt_name(attempt: Attempt) -> Name:
    """Return which attempt this is: module, epoch, number."""
    return attempt.module, attempt.epoch, attempt.number


class AskedContent(NamedTuple):
    """What an attempt asks for, in the form of what a turn has chosen; None is no site."""

    site: Site | None
    move: tuple[str, Site | None] | None
    sensed: frozenset[tuple[Site | None, Site | None]]
    notes: frozenset[tuple[Site | None, tuple[tuple[int, ...], tuple[int, ...] | None]]]


class AskedAttempts:
    """The recorded attempts by number: what of each is compared with what others say of it."""

    def __init__(self, system: System, tiles: Tiles | None) -> None:
        """Begin with none; without tiles nobody knows through which keepers they pass."""
        self._system, self._tiles = system, tiles
        self._names = Names()
        self._state = bytearray()
        self._digests, self._contents, self._turns = array("q"), array("q"), array("q")
        self._chains = array("i")
        self._each_chain: list[list[int] | Exception] = []
        self._chain_numbers: dict[str, int] = {}

    def __len__(self) -> int:
        return len(self._state)

    def place(self, name: Name) -> int:
        """Return the number of an attempt, which need not be recorded."""
        found = self._names.place(name)
        if found == len(self._state):
            self._state.append(_UNHEARD)
            for column in (self._digests, self._contents, self._turns, self._chains):
                column.append(0)
        return found

    def get(self, name: Name) -> int | None:
        """Return the number of an attempt, None if nobody asked for it."""
        found = self._names.get(name)
        return None if found is None or self._state[found] < _ASKED else found

    def take(self, attempt: Attempt, *, asked: bool) -> bool:
        """Take an attempt as it was asked for, or else passed on; return whether it fits."""
        place, digest = self.place(attempt_name(attempt)), hash(encode(attempt))
        if self._state[place] == _ASKED:
            return not asked or self._digests[place] == digest
        if asked or self._state[place] == _UNHEARD:
            self._state[place] = _ASKED if asked else _PASSED
            self._digests[place] = digest
            self._turns[place] = attempt.turn
            self._take_content(place, attempt)
        return True

    def _take_content(self, place: int, attempt: Attempt) -> None:
        sensed = dict(attempt.sensed)
        notes = {
            place: (tuple(shown), None if new is None else tuple(new))
            for place, shown, new in attempt.notes
        }
        content = AskedContent(
            attempt.site,
            None if attempt.generator is None else (attempt.generator, attempt.at),
            frozenset(sensed.items()),
            frozenset(notes.items()),
        )
        self._contents[place] = hash(content)
        if self._tiles is not None:
            self._chains[place] = self._chain(self._tiles, notes, sensed)

    def _chain(
        self, tiles: Tiles, noted: Iterable[Site | None], sensed: Iterable[Site | None]
    ) -> int:
        """Return which of the chains of keepers an attempt passes through, in increasing order."""
        labelled, place_of = self._system.labels is not None, self._system.place_of
        chain: list[int] | Exception
        try:
            units = [unit for unit in sensed if unit is not None]
            places = [place for place in noted if place is not None]
            places += units if labelled else map(place_of, units)
            chain = sorted({tiles.keeper_of(place) for place in places}) or [-1]
        except (*NO_SITE, InputError) as error:
            chain = error
        number = self._chain_numbers.setdefault(repr(chain), len(self._each_chain))
        if number == len(self._each_chain):
            self._each_chain.append(chain)
        return number

    def passed_alone(self) -> Iterator[Name]:
        """Yield the attempts that keepers passed on and nobody asked for."""
        if _PASSED in self._state:
            for name in self._names:
                if self._state[self.place(name)] == _PASSED:
                    yield name

    def believe(self, name: Name) -> None:
        """Take an attempt that was passed on for one that was asked for."""
        self._state[self.place(name)] = _BELIEVED

    def is_believed(self, place: int) -> bool:
        """Return whether an attempt was passed on, and what was asked for it is lost."""
        return self._state[place] == _BELIEVED

    def chain(self, place: int) -> list[int]:
        """Return the keepers that an attempt passes through; raises what its sites do."""
        chain = self._each_chain[self._chains[place]]
        if isinstance(chain, Exception):
            raise chain
        return chain

    def turn(self, place: int) -> int:
        """Return of which turn an attempt says that it is."""
        return self._turns[place]

    def is_as(self, place: int, attempt: Attempt) -> bool:
        """Return whether an attempt is the one of this number."""
        return self._digests[place] == hash(encode(attempt))

    def asks_for(self, place: int, content: Hashable) -> bool:
        """Return whether an attempt asks for what was chosen."""
        return self._contents[place] == hash(content)

    def __iter__(self) -> Iterator[Name]:
        """Yield the names of those that were asked for, in order."""
        return (name for name in self._names if self.get(name) is not None)


class HashedNames:
    """What modules number: of each the hash of its content, and one more number."""

    def __init__(self) -> None:
        self._names = Names()
        self._hashes, self._values = array("q"), array("q")

    def __len__(self) -> int:
        return len(self._hashes)

    def take(self, name: Name, content: int, value: int) -> bool:
        """Take something by its hash; return whether it is the same as before, if it is known."""
        place = self._names.place(name)
        if place < len(self._hashes):
            return self._hashes[place] == content
        self._hashes.append(content)
        self._values.append(value)
        return True

    def value(self, name: Name) -> int | None:
        """Return the number taken with a name, None if it is not recorded."""
        place = self._names.get(name)
        return None if place is None else self._values[place]

    def of(self, module: int) -> Iterator[Name]:
        """Yield the names of a module in order."""
        return self._names.of(module)


class ShownVersions:
    """The versions of a place that were ever shown, each with that of the module there."""

    __slots__ = ("_far", "_near")

    def __init__(self) -> None:
        self._near = array("q")
        """Both in one number, in order."""
        self._far: set[tuple[int, int]] = set()

    def add(self, version: int, module_version: int) -> None:
        """Note that this was shown."""
        if version >= _HALF or module_version >= _HALF:
            self._far.add((version, module_version))
            return
        both, near = version << 32 | module_version, self._near
        if not near or near[-1] < both:
            near.append(both)
            return
        place = bisect_left(near, both)
        if near[place] != both:
            near.insert(place, both)

    def __contains__(self, shown: tuple[int, int]) -> bool:
        version, module_version = shown
        if version >= _HALF or module_version >= _HALF:
            return shown in self._far
        both = version << 32 | module_version
        place = bisect_left(self._near, both)
        return place < len(self._near) and self._near[place] == both

    def has(self, version: int) -> bool:
        """Return whether the place was ever shown at a version, whatever the module's was."""
        place = bisect_left(self._near, version << 32) if version < _HALF else len(self._near)
        near = place < len(self._near) and self._near[place] >> 32 == version
        return near or any(known == version for known, _ in self._far)
