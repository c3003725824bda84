"""What keepers have shown to the modules of a process.

A process receives whole tiles; a module sees only the places that it senses, and the registers
within its reach. Updates of a tile are numbered, so a gap is noticed immediately.
"""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field

from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System
from cubepath.protocol.wire.free_messages import PlaceState, TileUpdate
from cubepath.protocol.wire.keys import Tiles

LOOK_S, LOOK_S_MAX = 0.2, 4.0
"""How soon a process looks again at a tile that was not shown, and how rarely at the least."""
KEEP_S = 2.0
"""How long a tile is kept after the last module that needs it has gone."""


@dataclass(frozen=True, slots=True)
class Place:
    """What is known of a place; `site` None: nobody is there."""

    version: int = 0
    site: Site | None = None
    module: int | None = None
    note: tuple[int, ...] = ()
    module_version: int = 0
    reads: tuple[tuple[Site, int, int], ...] = ()


NOTHING = Place()


@dataclass(slots=True)
class _Tile:
    serial: int = -1
    whole: bool = False
    places: list[Site] = field(default_factory=list)
    """Those of which anything is known."""
    look_s: float = 0.0
    every_s: float = LOOK_S
    needed_s: float = 0.0


class Sensing:
    """The tiles that the modules of a process need."""

    def __init__(self, system: System, tiles: Tiles) -> None:
        """Begin with none."""
        self._system = system
        self._tiles = tiles
        self._known: dict[str, _Tile] = {}
        self._places: dict[Site, Place] = {}

    def place(self, place: Site) -> Place:
        """Return what is known of a place in a tile that `sees` it."""
        return self._places.get(place, NOTHING)

    def places(self, places: Iterable[Site | None]) -> list[Place]:
        """Return what is known of places; of None, `NOTHING`."""
        get = self._places.get
        return [get(place, NOTHING) for place in places]

    def sees(self, places: Iterable[Site]) -> bool:
        """Return whether the tiles of these places were shown, with nothing missing."""
        return self.has_whole(map(self._tiles.tile_of, places))

    def has_whole(self, tiles: Iterable[str]) -> bool:
        """Return whether these tiles were shown, with nothing missing."""
        for name in tiles:
            tile = self._known.get(name)
            if tile is None or not tile.whole:
                return False
        return True

    def need(self, tiles: Collection[str], now_s: float) -> tuple[list[str], list[str]]:
        """Need exactly these tiles; return those to listen to, and those to listen to no more."""
        for tile in tiles:
            known = self._known.get(tile)
            if known is not None:
                known.needed_s = now_s
        new = [tile for tile in sorted(tiles) if tile not in self._known]
        for tile in new:
            self._known[tile] = _Tile(look_s=now_s, needed_s=now_s)
        old = [
            tile
            for tile, known in self._known.items()
            if tile not in tiles and now_s - known.needed_s > KEEP_S
        ]
        for tile in old:
            for place in self._known.pop(tile).places:
                del self._places[place]
        return new, old

    def due(self, now_s: float) -> list[tuple[str, int]]:
        """Return the tiles to look at now, each with the number of what was last shown of it."""
        found = []
        for name, tile in self._known.items():
            if now_s >= tile.look_s:
                found.append((name, tile.serial if tile.whole else -1))
                tile.look_s = now_s + tile.every_s
                tile.every_s = min(2 * tile.every_s, LOOK_S_MAX)
        return found

    @property
    def next_s(self) -> float:
        """Return when a tile is to be looked at next."""
        return min((tile.look_s for tile in self._known.values()), default=float("inf"))

    def take(self, shows: TileUpdate, now_s: float) -> tuple[list[Site], bool]:
        """Take what is shown; return the places of which something new is known.

        And whether all of the tile is known now, so that places that were not shown are empty.
        """
        tile = self._known.get(shows.tile)
        if tile is None:
            return [], False
        now_whole = shows.whole and not tile.whole
        changed = self.know(shows.parts)
        if shows.whole:
            if shows.serial >= tile.serial:
                tile.serial, tile.whole = shows.serial, True
                tile.every_s = LOOK_S_MAX
                tile.look_s = now_s + tile.every_s
        elif tile.whole and shows.serial == tile.serial + 1:
            tile.serial = shows.serial
            tile.look_s = now_s + LOOK_S_MAX
        elif shows.serial > tile.serial:
            tile.every_s = LOOK_S  # something between was not shown
            tile.look_s = min(tile.look_s, now_s)
        return changed, now_whole

    def know(self, parts: Iterable[PlaceState]) -> list[Site]:
        """Take what is shown of places; return those of which something new is known."""
        changed: list[Site] = []
        for shown in parts:
            place = shown.place
            tile = self._known.get(self._tiles.tile_of(place))
            if tile is None:
                continue
            known = self._places.get(place)
            if known is None:
                tile.places.append(place)
            elif not self._newer(known, shown):
                continue
            self._places[place] = _known(shown)
            changed.append(place)
        return changed

    def _newer(self, known: Place, shown: PlaceState) -> bool:
        if shown.version != known.version:
            return shown.version > known.version
        if shown.module_version != known.module_version:
            return shown.module_version > known.module_version
        return sum(reads for _, _, reads in shown.reads) > sum(r for _, _, r in known.reads)


def _known(shown: PlaceState) -> Place:
    return Place(
        shown.version,
        shown.site,
        shown.module,
        tuple(shown.note),
        shown.module_version,
        tuple(shown.reads),
    )
