"""Tiles: the small regions that places lie in, and which keeper has which.

Everyone derives them from the system and the number of keepers alone. Tiles are a reach wide or a
little more, so a move concerns few of them, and a keeper that is gone stops few modules.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import ClassVar
from zlib import crc32

from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System

_SIDE = 4
"""Side of a tile in cells, in a plane."""
_ROW = 16
"""Places in a tile, where places have only numbers."""
_NAME = re.compile(r"-?[0-9]+(,-?[0-9]+)?")


class Tiles:
    """The tiles of a system, dealt to so many keepers."""

    keepers_max: ClassVar[int] = 256
    """A run has at most so many."""

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
