"""The tables of a lattice: its cells in tiles, made in compiled code.

A tile is a small block of cells, such as 8 x 8 in the plane, with the same entries that do not
translate. Tiles are found by a hash of the coordinates of their first cell, and made when a module
senses into them. So the lattice has neither an end nor a window, and cells that are near one
another are near in memory too: within a tile, neighbours are found without a hash.
"""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays.tables import (
    GrowingArray,
    Ints,
    MoveKind,
    MoveKinds,
    Places,
    SiteNaming,
    Stands,
    Tables,
    UntabledError,
    kind_at,
)
from cubepath.protocol.compiled import compiled, inner
from cubepath.protocol.core.catalogue import Catalogue
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import CLOSED, EMPTY, FILLED, MODULE, Scene, System

OBSTACLE, OUTSIDE = 1, 2
"""Why moves over a cell may be excluded."""
TILE_BITS = 6
"""A tile has at most 1 << 6 cells, as many along each axis."""


class Chart(NamedTuple):
    """The cells that differ from all others, from number 1, found by their coordinates."""

    coordinates: Ints
    """Shape (cells, arity)."""
    slots: Ints
    """A hash table with open addressing, of a power of two: numbers, 0 where none is."""
    limits: NDArray[np.uint8]
    """`OBSTACLE`, `OUTSIDE`, both, or 0."""
    background: Ints
    """What the cell shows when no module is there."""


class CellTiles(NamedTuple):
    """How tiles are found, and what lies around them."""

    slots: Ints
    """A hash table of their origins, as in `Chart`; 0 is no tile."""
    ways: Ints
    """Shape (ways, arity): by how much origins differ, and the entries that do not translate."""
    tails: Ints
    """Shape (orbits, arity - dimension): the entries that do not translate, of each orbit."""


@inner
def slot_of(coordinates: Ints, slots: Ints, rows: Ints, row: int) -> Any:
    """Return the slot of a hash table that holds the cell in a row, or where it is to be put."""
    mask = len(slots) - 1
    mixed = np.uint64(1469598103934665603)
    for axis in range(rows.shape[1]):
        mixed = (mixed ^ np.uint64(np.int64(rows[row, axis]))) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    slot = np.int64(mixed & np.uint64(mask))
    while True:
        number = slots[slot]
        if number == 0:
            return slot
        same = True
        for axis in range(rows.shape[1]):
            if coordinates[number, axis] != rows[row, axis]:
                same = False
        if same:
            return slot
        slot = (slot + 1) & mask


@compiled
def rehash(coordinates: Ints, slots: Ints, count: int) -> None:
    """Put all numbers below `count` into the hash table, which is empty."""
    for number in range(1, count):
        slots[slot_of(coordinates, slots, coordinates, number)] = number


@inner
def fill(
    tile: int, chart: Chart, tiles: CellTiles, places: Places, stands: Stands, kinds: MoveKinds
) -> None:
    """Write what the cells of a new tile show, and which moves are excluded there."""
    shift, dimension = places.shift, tiles.ways.shape[1] - tiles.tails.shape[1]
    inside = (1 << shift) - 1
    move_slots = stands.usable.shape[1]
    cell = np.zeros((1, tiles.ways.shape[1]), np.int32)
    limits = np.zeros(places.sensed.shape[1] + 1, np.uint8)
    for at in range(1 << shift):
        row, place = places.first[tile] + at, (tile << shift) + at
        for ref in range(len(limits)):
            # The own cell lies no way, and cannot be told apart from an unused slot.
            there = at if ref == 0 else places.sensed[row, ref - 1]
            way = there >> shift
            for axis in range(cell.shape[1]):
                cell[0, axis] = stands.encoded[places.first[tile] + (there & inside), axis]
                if axis < dimension or way == 0:
                    cell[0, axis] += stands.origin[tile, axis]
                if way:
                    cell[0, axis] += tiles.ways[way, axis]
            charted = chart.slots[slot_of(chart.coordinates, chart.slots, cell, 0)]
            limits[ref] = chart.limits[charted]
            if ref == 0:
                places.background[place] = chart.background[charted]
        for slot in range(move_slots):
            move = stands.kind[row] * move_slots + slot
            usable = 1
            for item in range(kinds.items_at[move], kinds.items_at[move + 1]):
                limit = limits[kinds.items[item, 0]]
                if limit & OUTSIDE or (limit & OBSTACLE and kinds.items[item, 2]):
                    usable = 0
            stands.usable[place, slot] = usable


@inner
def tile_at(
    origin: Ints,
    count: int,
    chart: Chart,
    tiles: CellTiles,
    places: Places,
    stands: Stands,
    kinds: MoveKinds,
) -> Any:
    """Return the tile with an origin, shape (1, arity): `count` for a new one, which is made."""
    slot = slot_of(stands.origin, tiles.slots, origin, 0)
    found = tiles.slots[slot]
    if found:
        return found
    dimension = origin.shape[1] - tiles.tails.shape[1]
    orbit = len(tiles.tails)
    for candidate in range(len(tiles.tails)):
        same = True
        for axis in range(dimension, origin.shape[1]):
            if tiles.tails[candidate, axis - dimension] != origin[0, axis]:
                same = False
        if same:
            orbit = candidate
    tiles.slots[slot] = count
    stands.origin[count] = origin[0]
    places.first[count] = orbit << places.shift
    places.around[count, 0] = 0
    if len(stands.usable) > 1:
        fill(count, chart, tiles, places, stands, kinds)
    return count


@compiled
def make_tiles(
    origins: Ints,
    count: int,
    chart_arrays: Any,
    tile_arrays: Any,
    place_arrays: Any,
    stand_arrays: Any,
    kind_arrays: Any,
    found: Ints,
) -> int:
    """Write the tiles with these origins, new ones from `count` on; return the new count.

    It ends where no room is left.
    """
    chart, tiles = Chart(*chart_arrays), CellTiles(*tile_arrays)
    places, stands, kinds = Places(*place_arrays), Stands(*stand_arrays), MoveKinds(*kind_arrays)
    for row in range(len(origins)):
        if count == len(places.first):
            break
        found[row] = tile_at(origins[row : row + 1], count, chart, tiles, places, stands, kinds)
        count += found[row] == count
    return count


class LatticeTables(Tables):
    """The tables of a system whose moves are the placements of a catalogue."""

    def __init__(self, scene: Scene, *, notes: bool = False) -> None:
        """Chart the workspace and the obstacles; `UntabledError` if that cannot be."""
        catalogue = scene.system.catalogue
        if catalogue is None:
            raise UntabledError(f"{scene.spec}: no catalogue")
        self._catalogue: Catalogue = catalogue
        self._arity = catalogue.lattice.arity
        self._dimension = catalogue.lattice.dimension
        # A few modules, often in many environments, would leave most cells of large tiles unused.
        bits = max(0, len(scene.start).bit_length() - 2)
        self._bits = min(TILE_BITS, bits) // self._dimension
        self._shift = self._bits * self._dimension
        self._weights = 1 << self._bits * np.arange(self._dimension)[::-1]
        self._chart = _charted(scene.system, self._arity)
        super().__init__(scene, notes=notes)

    def _begin(self) -> None:
        if self.naming is not SiteNaming.ONE:
            raise UntabledError(f"{self.scene.spec}: a catalogue, and sites that differ by code")
        self._tabulate_orbits()
        self.kinds.publish()
        limited = len(self._chart.limits) > 1 or bool(self._chart.limits[0])
        background = int(self._chart.background[0])
        self._place_arrays[0].value = background
        self._usable = GrowingArray(1, np.uint8, self.scene.system.move_slots)
        if not limited:
            self._usable.array = self._usable.array[:1]
        self._tile_arrays = (
            GrowingArray(0, np.int32),
            GrowingArray(-1, np.int32, len(self._ways)),
            GrowingArray(0, np.int32, self._arity),
        )
        self._tiles = 1
        self._grow(1)

    def _tabulate_orbits(self) -> None:
        """Make the rows: for each orbit those of a tile, and at the end those of any other."""
        system, slots = self.scene.system, self.scene.system.move_slots
        twin = system.with_moves(())
        orbits = sorted(self._catalogue.templates)
        size = 1 << self._shift
        inside = np.indices((1 << self._bits,) * self._dimension).reshape(self._dimension, size).T
        rows = (len(orbits) + 1) * size
        ways = {(0,) * (self._arity + 1): 0}
        self._sensed = np.zeros((rows, system.sense_slots), np.int32)
        self._reach = np.zeros((rows, system.reach_slots if self._notes else 1), np.int32)
        # Cells of an orbit in which no mover begins have no moves.
        kinds = [self.kinds.number(kind_at(twin, cell, self.naming)) for cell in orbits]
        kinds.append(self.kinds.number(MoveKind((), (None,) * slots)))
        self._kind = np.repeat(np.array(kinds, np.int32), size)
        self._encoded = np.zeros((rows, self._arity), np.int32)
        self._encoded[:, : self._dimension] = np.tile(inside, (len(orbits) + 1, 1))
        for orbit, cell in enumerate(orbits):
            own = slice(orbit * size, (orbit + 1) * size)
            near = [each for each in system.sensed(cell) if each is not None]
            self._lay(self._sensed[own], inside, near, ways)
            if self._notes:
                self._lay(self._reach[own], inside, system.reach(cell), ways)
        tails = [cell[self._dimension :] for cell in orbits]
        self._tails = np.array(tails, np.int32).reshape(len(orbits), -1)
        self._ways = np.array(list(ways), np.int32)[:, 1:].copy()

    def _lay(
        self,
        rows: Ints,
        inside: NDArray[np.intp],
        cells: Sequence[Site],
        ways: dict[tuple[int, ...], int],
    ) -> None:
        """Write where cells around the origin lie, seen from each cell of a tile."""
        for slot, cell in enumerate(_rows(cells, self._arity)):
            found = inside + cell[: self._dimension]
            within = found & ((1 << self._bits) - 1)
            tail = tuple(cell[self._dimension :].tolist())
            for at, origin in enumerate((found - within).tolist()):
                way = ways.setdefault((1, *origin, *tail), len(ways))
                rows[at, slot] = (way << self._shift) + within[at] @ self._weights

    def _grow(self, tiles: int) -> None:
        """Make room for this many tiles, and hand out the arrays."""
        for each in self._tile_arrays:
            each.room(tiles)
        tiles = len(self._tile_arrays[0].array)
        for each in self._place_arrays:
            each.room(tiles << self._shift)
        if len(self._usable.array) > 1:
            self._usable.room(tiles << self._shift)
        first, around, origin = [each.array for each in self._tile_arrays]
        around[0] = 0
        first[0] = len(self._tails) << self._shift
        by_place = [each.array for each in self._place_arrays]
        self.places = Places(self._shift, first, around, self._sensed, self._reach, *by_place)
        self.stands = Stands(self._kind, self._encoded, origin, self._usable.array)
        self._slots = np.zeros(2 << tiles.bit_length(), np.int32)
        rehash(origin, self._slots, self._tiles)

    def _tiles_at(self, origins: Ints) -> Ints:
        """Return the numbers of the tiles with these origins; those that are not there are made."""
        found = np.zeros(len(origins), np.int32)
        while True:
            self._tiles = make_tiles(
                origins,
                self._tiles,
                tuple(self._chart),
                (self._slots, self._ways, self._tails),
                tuple(self.places),
                tuple(self.stands),
                tuple(self.kinds.arrays),
                found,
            )
            if self._tiles < len(self.places.first):
                break
            self._grow(2 * self._tiles)
        self.count = self._tiles << self._shift
        return found

    def numbers(self, places: Iterable[Site]) -> list[int]:
        """Return the numbers of cells; those that have none are given one."""
        chosen = _rows(places, self._arity)
        if not len(chosen):
            return []
        within = chosen.copy()
        within[:, : self._dimension] &= (1 << self._bits) - 1
        within[:, self._dimension :] = 0
        numbers = self._tiles_at(chosen - within) << self._shift
        return list((numbers + within[:, : self._dimension] @ self._weights).tolist())

    def site(self, place: int, code: int) -> Site:
        """Return the cell of this number."""
        if code != MODULE:
            raise AssertionError(f"cell {place} shows {code}, which is no module")
        origin = self.stands.origin[place >> self._shift]
        return tuple((origin + self._encoded[place & ((1 << self._shift) - 1)]).tolist())

    def prepare(self, places: Ints, codes: Ints) -> None:
        """Make the tiles around these places."""
        del codes
        tiles = places >> self._shift
        rows = self.places.first[tiles] + (places & ((1 << self._shift) - 1))
        ways = np.hstack([self._sensed[rows], self._reach[rows]]) >> self._shift
        lacking = self.places.around[tiles[:, None], ways] < 0
        keys = tiles[:, None].astype(np.int64) * len(self._ways) + ways
        tile, way = np.divmod(np.unique(keys[lacking]), len(self._ways))
        origins = self._ways[way]
        origins[:, : self._dimension] += self.stands.origin[tile, : self._dimension]
        found = self._tiles_at(origins)
        self.places.around[tile, way] = found << self._shift


def _rows(cells: Iterable[Site], arity: int) -> Ints:
    try:
        return np.array(list(cells), np.int32).reshape(-1, arity)
    except OverflowError:
        raise UntabledError("coordinates beyond 32 bits") from None


def _charted(system: System, arity: int) -> Chart:
    """Return the workspace and the obstacles; number 0 is any other cell."""
    workspace = system.workspace or frozenset()
    kinds = (
        (workspace - system.filled - system.empty, EMPTY, 0),
        (system.filled & workspace, FILLED, OBSTACLE),
        (system.empty & workspace, CLOSED, OBSTACLE),
        (system.filled - workspace, FILLED, OBSTACLE | OUTSIDE),
        (system.empty - workspace, CLOSED, OBSTACLE | OUTSIDE),
    )
    inside = ~OUTSIDE if system.workspace is None else ~0
    elsewhere = (EMPTY, 0) if system.workspace is None else (CLOSED, OUTSIDE)
    rows = [_rows(cells, arity) for cells, _, _ in kinds]
    shown = [np.full(len(each), code) for each, (_, code, _) in zip(rows, kinds, strict=True)]
    limits = [np.full(len(each), why) for each, (_, _, why) in zip(rows, kinds, strict=True)]
    count = 1 + sum(map(len, rows))
    chart = Chart(
        np.concatenate([np.zeros((1, arity), np.int32), *rows]),
        np.zeros(4 << count.bit_length(), np.int32),
        (np.concatenate([[elsewhere[1]], *limits]) & inside).astype(np.uint8),
        np.concatenate([[elsewhere[0]], *shown]).astype(np.int32),
    )
    rehash(chart.coordinates, chart.slots, count)
    return chart
