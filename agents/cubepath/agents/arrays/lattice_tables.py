"""The tables of a lattice, computed by translation in compiled code.

Cells are numbered by a hash of their coordinates, so the lattice has neither an end nor a window:
tables grow with the cells that modules reach.
"""

from collections.abc import Iterable
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


class Cells(NamedTuple):
    """Cells with numbers from 1, found by their coordinates."""

    coordinates: Ints
    """Shape (cells, arity)."""
    limits: NDArray[np.uint8]
    """`OBSTACLE`, `OUTSIDE`, both, or 0."""
    background: Ints
    """What the cell shows when no module is there."""
    slots: Ints
    """A hash table with open addressing, of a power of two: numbers, 0 where none is."""


class Orbits(NamedTuple):
    """Neighbourhoods by orbit, as offsets from the cell of the orbit at the origin."""

    tails: Ints
    """Shape (orbits, arity - dimension): the entries that do not translate."""
    kind: Ints
    sensed: Ints
    """Shape (orbits, sense_slots, arity)."""
    sensed_count: Ints
    reach: Ints
    reach_count: Ints


@inner
def slot_of(cells: Cells, rows: Ints, row: int) -> Any:
    """Return the slot of the hash table that holds the cell in a row, or where it is to be put."""
    mask = len(cells.slots) - 1
    mixed = np.uint64(1469598103934665603)
    for axis in range(rows.shape[1]):
        mixed = (mixed ^ np.uint64(np.int64(rows[row, axis]))) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    slot = np.int64(mixed & np.uint64(mask))
    while True:
        number = cells.slots[slot]
        if number == 0:
            return slot
        same = True
        for axis in range(rows.shape[1]):
            if cells.coordinates[number, axis] != rows[row, axis]:
                same = False
        if same:
            return slot
        slot = (slot + 1) & mask


@inner
def number_of(cells: Cells, chart: Cells, rows: Ints, row: int, count: int) -> Any:
    """Return the number of the cell in a row: `count` for a new one, which is looked up."""
    slot = slot_of(cells, rows, row)
    number = cells.slots[slot]
    if number == 0:
        number = count
        charted = chart.slots[slot_of(chart, rows, row)]
        cells.slots[slot] = number
        for axis in range(rows.shape[1]):
            cells.coordinates[number, axis] = rows[row, axis]
        cells.limits[number] = chart.limits[charted]
        cells.background[number] = chart.background[charted]
    return number


@compiled
def number_cells(cells: Cells, chart: Cells, chosen: Ints, count: int, found: Ints) -> int:
    """Write the numbers of the chosen cells, new ones from `count` on; return the new count."""
    for row in range(len(chosen)):
        found[row] = number_of(cells, chart, chosen, row, count)
        if found[row] == count:
            count += 1
    return count


@compiled
def rehash(cells: Cells, count: int) -> None:
    """Put all cells into the hash table, which is empty."""
    for number in range(1, count):
        cells.slots[slot_of(cells, cells.coordinates, number)] = number


@compiled
def work_out(
    chosen: Ints,
    count: int,
    dimension: int,
    cells: Cells,
    chart: Cells,
    orbits: Orbits,
    places: Places,
    stands: Stands,
    kinds: MoveKinds,
    notes: bool,  # noqa: FBT001 - compiled functions are called with positions
    around: Ints,
) -> int:
    """Work out the stands at the chosen cells; return the new count of numbered cells.

    There must be room for all cells that can be met. `around` has a row for each cell that is
    sensed or heard from, and is overwritten.
    """
    arity = cells.coordinates.shape[1]
    move_slots = stands.usable.shape[1]
    own = cells.coordinates
    for at in range(len(chosen)):
        number = chosen[at]
        if stands.kind[number] >= 0:
            continue
        orbit = -1
        for candidate in range(len(orbits.tails)):
            same = True
            for axis in range(dimension, arity):
                if orbits.tails[candidate, axis - dimension] != own[number, axis]:
                    same = False
            if same:
                orbit = candidate
        kind = orbits.kind[orbit]
        for axis in range(arity):
            stands.encoded[number, axis] = own[number, axis]
        near = orbits.sensed_count[orbit]
        for slot in range(near + (orbits.reach_count[orbit] if notes else 0)):
            for axis in range(arity):
                offset = (
                    orbits.sensed[orbit, slot, axis]
                    if slot < near
                    else orbits.reach[orbit, slot - near, axis]
                )
                around[slot, axis] = offset + (own[number, axis] if axis < dimension else 0)
            other = number_of(cells, chart, around, slot, count)
            if other == count:
                count += 1
            if slot < near:
                places.sensed[number, slot] = other
            else:
                places.reach[number, slot - near] = other
        for slot in range(move_slots):
            move = kind * move_slots + slot
            usable = 1
            for item in range(kinds.items_at[move], kinds.items_at[move + 1]):
                ref = kinds.items[item, 0]
                limit = cells.limits[number if ref == 0 else places.sensed[number, ref - 1]]
                if limit & OUTSIDE or (limit & OBSTACLE and kinds.items[item, 2]):
                    usable = 0
            stands.usable[number, slot] = usable
        stands.kind[number] = kind
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
        self._cell_arrays = (GrowingArray(0, np.int32, self._arity), GrowingArray(0, np.uint8))
        self._slots = np.zeros(64, np.int32)
        self._chart = _charted(scene.system, self._arity)
        super().__init__(scene, notes=notes)

    def _begin(self) -> None:
        if self.naming is not SiteNaming.ONE:
            raise UntabledError(f"{self.scene.spec}: a catalogue, and sites that differ by code")
        self._orbits = self._by_orbit()
        self.kinds.publish()

    def _by_orbit(self) -> Orbits:
        system, lattice = self.scene.system, self._catalogue.lattice
        twin = system.with_moves(())
        cells = sorted(self._catalogue.templates)
        slots = system.move_slots
        sensed = np.zeros((len(cells) + 1, system.sense_slots, self._arity), np.int32)
        reach = np.zeros((len(cells) + 1, system.reach_slots, self._arity), np.int32)
        counts = np.zeros((2, len(cells) + 1), np.int32)
        numbers = []
        for orbit, cell in enumerate(cells):
            near = [each for each in system.sensed(cell) if each is not None]
            around = system.reach(cell)
            sensed[orbit, : len(near)] = np.array(near, np.int32).reshape(-1, self._arity)
            reach[orbit, : len(around)] = np.array(around, np.int32).reshape(-1, self._arity)
            counts[:, orbit] = len(near), len(around)
            numbers.append(self.kinds.number(kind_at(twin, cell, self.naming)))
        # Cells of an orbit that no mover begins in: orbit -1, the last.
        numbers.append(self.kinds.number(MoveKind((), (None,) * slots)))
        tails = np.zeros((len(cells), self._arity - lattice.dimension), np.int32)
        for orbit, cell in enumerate(cells):
            tails[orbit] = cell[lattice.dimension :]
        return Orbits(tails, np.array(numbers, np.int32), sensed, counts[0], reach, counts[1])

    @property
    def _cells(self) -> Cells:
        coordinates, limits = [each.array for each in self._cell_arrays]
        return Cells(coordinates, limits, self.places.background, self._slots)

    def _make_room(self, more: int) -> None:
        """Make room for this many more cells."""
        count, self.count = self.count, self.count + more
        self._room()
        for each in self._cell_arrays:
            each.room(self.count)
        if 2 * self.count > len(self._slots):
            self._slots = np.zeros(4 << (self.count - 1).bit_length(), np.int32)
            rehash(self._cells, count)
        self.count = count

    def numbers(self, places: Iterable[Site]) -> list[int]:
        """Return the numbers of cells; those that have none are given one."""
        chosen = _rows(places, self._arity)
        if not len(chosen):
            return []
        self._make_room(len(chosen))
        found = np.zeros(len(chosen), np.int32)
        self.count = number_cells(self._cells, self._chart, chosen, self.count, found)
        return list(found.tolist())

    def site(self, place: int, code: int) -> Site:
        """Return the cell of this number."""
        if code != MODULE:
            raise AssertionError(f"cell {place} shows {code}, which is no module")
        return tuple(self._cells.coordinates[place].tolist())

    def prepare(self, places: Ints, codes: Ints) -> None:
        """Work out the stands at these places."""
        del codes
        # Each once: room is made for all that can be met around each of them.
        chosen = np.unique(places[self.stands.kind[places] < 0])
        if not len(chosen):
            return
        system = self.scene.system
        around = system.sense_slots + self._notes * system.reach_slots
        self._make_room(len(chosen) * around)
        self.count = work_out(
            chosen,
            self.count,
            self._catalogue.lattice.dimension,
            self._cells,
            self._chart,
            self._orbits,
            self.places,
            self.stands,
            self.kinds.arrays,
            self._notes,
            np.zeros((around, self._arity), np.int32),
        )


def _rows(cells: Iterable[Site], arity: int) -> Ints:
    try:
        return np.array(list(cells), np.int32).reshape(-1, arity)
    except OverflowError:
        raise UntabledError("coordinates beyond 32 bits") from None


def _charted(system: System, arity: int) -> Cells:
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
    chart = Cells(
        np.concatenate([np.zeros((1, arity), np.int32), *rows]),
        (np.concatenate([[elsewhere[1]], *limits]) & inside).astype(np.uint8),
        np.concatenate([[elsewhere[0]], *shown]).astype(np.int32),
        np.zeros(4 << count.bit_length(), np.int32),
    )
    rehash(chart, count)
    return chart
