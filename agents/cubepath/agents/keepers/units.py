"""The physics of a run without rounds: units with their versions and levels, and occupants.

A keeper holds this; it decides nothing. A commit reads some units and writes others. Its level is
one more than the greatest level of the commits on which it depends: the writers of what it reads or
overwrites, and the readers of what it overwrites.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import msgspec

from cubepath.agents.keepers.attempts import Share
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import System
from cubepath.protocol.wire.free_messages import Commit, Occupant, PlaceState
from cubepath.protocol.wire.keys import Tiles


@dataclass(slots=True)
class Unit:
    """How often a unit was written, and at what level; how often that was read, likewise."""

    version: int = 0
    level: int = 0
    reads: int = 0
    read_level: int = 0


_UNTOUCHED = Unit()


class UnitsState(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The units of a keeper as its log has them, with all that is there."""

    units: list[tuple[Site, int, int, int, int]]
    """Each that was ever read or written: version, level, reads, read level."""
    places: list[tuple[Site, int]]
    """How many moves have written a place."""
    occupants: list[tuple[Site, Occupant]]
    serials: dict[str, int]
    """How often a tile has changed."""


class Units:
    """The units of some tiles."""

    def __init__(
        self, system: System, tiles: Tiles, here: Mapping[int, Site], *, tell_reads: bool = False
    ) -> None:
        """Begin with modules at these sites, by number."""
        self._system = system
        self._tiles = tiles
        self._tell_reads = tell_reads
        self._places: dict[Site, int] = {}
        """How many moves have written a place."""
        self._occupants: dict[Site, tuple[Site, Occupant]] = {}
        self._by_tile: dict[str, dict[Site, None]] = {}
        """The places of a tile that are not as in an empty workspace."""
        self.place_of: dict[int, Site] = {}
        """Where modules are that are here."""
        self.units: dict[Site, Unit] = {}
        self.serials: dict[str, int] = {}
        """How often a tile has changed."""
        self.last_change: dict[str, tuple[Site, ...]] = {}
        """By tile the places that the last commit has changed."""
        for module, site in here.items():
            self._put(site, Occupant(module, 0, 0, 0, [], 0))

    def _unit_place(self, unit: Site) -> Site:
        return unit if self._system.labels is not None else self._system.place_of(unit)

    def state(self) -> UnitsState:
        """Return what `restore` takes up."""
        units = [
            (unit, known.version, known.level, known.reads, known.read_level)
            for unit, known in self.units.items()
        ]
        occupants = list(self._occupants.values())
        return UnitsState(units, list(self._places.items()), occupants, self.serials)

    def restore(self, state: UnitsState) -> None:
        """Take up what was before, and forget everything else."""
        self.units = {unit: Unit(*known) for unit, *known in state.units}
        self._places, self.serials = dict(state.places), dict(state.serials)
        self._by_tile = {}
        for known in (self._occupants, self.place_of):
            known.clear()
        for site, occupant in state.occupants:
            self._put(site, occupant)
        shown = [*self._places, *(map(self._unit_place, self.units) if self._tell_reads else ())]
        for place in shown:
            self._by_tile.setdefault(self._tiles.tile_of(place), {})[place] = None

    def unit(self, unit: Site) -> Unit:
        """Return what is known of a unit."""
        return self.units.get(unit, _UNTOUCHED)

    def shows(self, unit: Site) -> Site | None:
        """Return the site that is on at a unit, None if none is."""
        held = self._occupants.get(self._unit_place(unit))
        if held is None:
            return None
        site = held[0]
        return site if self._system.labels is not None or site == unit else None

    def occupant(self, place: Site) -> Occupant | None:
        """Return the module at a place."""
        held = self._occupants.get(place)
        return None if held is None else held[1]

    def module(self, module: int) -> tuple[Site, Occupant]:
        """Return where a module is that is here, and its state."""
        return self._occupants[self.place_of[module]]

    def replace(self, occupant: Occupant) -> None:
        """Change the fence of a module that is here."""
        place = self.place_of[occupant.module]
        self._occupants[place] = self._occupants[place][0], occupant

    def why_not(self, share: Share) -> str | None:
        """Return why an attempt cannot be committed as far as it concerns these units, or None."""
        for unit, expected in share.sensed:
            found = self.shows(unit)
            if found != expected:
                return f"{unit!r} shows {found!r}, {expected!r} was sensed"
        for place, expected, _ in share.notes:
            occupant = self.occupant(place)
            note = () if occupant is None else tuple(occupant.note)
            if note != expected:
                return f"the register at {place!r} is {list(note)}, {list(expected)} was sensed"
        for unit, version, reads in share.after:
            known = self.unit(unit)
            if known.version != version or reads not in (None, known.reads):
                return (
                    f"{unit!r} has version {known.version}, read {known.reads} times, expected"
                    f" version {version}" + ("" if reads is None else f", read {reads} times")
                )
        return None

    def level(self, share: Share) -> int:
        """Return the greatest level of what a commit depends on here."""
        found = [self.unit(unit).level for unit in (*share.reads, *share.writes)]
        return max([0, *found, *(self.unit(unit).read_level for unit in share.writes)])

    def apply(
        self, moved: Commit, share: Share, occupants: Iterable[tuple[Site, Occupant]]
    ) -> list[str]:
        """Carry out what concerns these units; return the tiles that change, in order.

        `occupants` are the modules that it changes, each with its site from now on.
        """
        self._read(share.reads, moved.level)
        changed = {self._unit_place(unit): None for unit in share.writes}
        for unit in share.writes:
            version = self.unit(unit).version
            self.units[unit] = Unit(version + 1, moved.level)
        for place in changed:
            self._places[place] = self._places.get(place, 0) + 1
            held = self._occupants.pop(place, None)
            if held is not None:
                del self.place_of[held[1].module]
        for place, _, new in share.notes:
            if new is not None:
                changed[place] = None
        for site, occupant in occupants:
            place = self._system.place_of(site)
            if place in changed:
                self._put(site, occupant)
        if self._tell_reads:
            changed.update(dict.fromkeys(map(self._unit_place, share.reads)))
        return self._count(changed)

    def _read(self, units: Iterable[Site], level: int) -> None:
        for unit in units:
            known = self.units.setdefault(unit, Unit())
            known.reads += 1
            known.read_level = max(known.read_level, level)

    def _count(self, changed: Iterable[Site]) -> list[str]:
        """Count the change of the tiles of these places."""
        tiles: dict[str, list[Site]] = {}
        for place in changed:
            tile = self._tiles.tile_of(place)
            tiles.setdefault(tile, []).append(place)
            self._by_tile.setdefault(tile, {})[place] = None
        for tile in tiles:
            self.serials[tile] = self.serials.get(tile, 0) + 1
        self.last_change = {tile: in_order(places) for tile, places in tiles.items()}
        return sorted(tiles)

    def _put(self, site: Site, occupant: Occupant) -> None:
        place = self._system.place_of(site)
        self._occupants[place] = site, occupant
        self.place_of[occupant.module] = place
        self._by_tile.setdefault(self._tiles.tile_of(place), {})[place] = None

    def shown(self, place: Site) -> PlaceState:
        """Return what is shown of a place."""
        version = self._places.get(place, 0)
        held = self._occupants.get(place)
        reads = self._reads(place) if self._tell_reads else []
        if held is None:
            return PlaceState(place, version, reads=reads)
        site, occupant = held
        return PlaceState(
            place, version, site, occupant.module, occupant.note, occupant.version, reads
        )

    def _reads(self, place: Site) -> list[tuple[Site, int, int]]:
        if self._system.letters:
            units = [unit for unit in self.units if self._unit_place(unit) == place]
        else:
            units = [place] if place in self.units else []
        return [(unit, self.units[unit].version, self.units[unit].reads) for unit in units]

    def tile(self, tile: str) -> list[PlaceState]:
        """Return what is shown of a tile: where something is or ever was."""
        return [self.shown(place) for place in in_order(self._by_tile.get(tile, {}))]

    def touched(self) -> list[tuple[Site, int, int, int, Site | None]]:
        """Return each unit that was ever read or written: version, level, reads, what is on."""
        return [
            (unit, known.version, known.level, known.reads, self.shows(unit))
            for unit in in_order(self.units)
            for known in (self.units[unit],)
        ]


def start_of(system: System, tiles: Tiles, keeper: int, start: Iterable[Site]) -> dict[int, Site]:
    """Return the modules that start where a keeper has the places, with their sites."""
    return {
        module: site
        for module, site in enumerate(start)
        if tiles.keeper_of(system.place_of(site)) == keeper
    }
