"""Systems on a lattice: a catalogue placed by translation into a workspace with obstacles."""

from collections.abc import Callable, Iterable, Mapping, Sequence, Set as AbstractSet
from functools import lru_cache, partial
from itertools import product
from typing import Any, ClassVar, Self

import msgspec

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import (
    LATTICES,
    Catalogue,
    Cell,
    Generator,
    Lattice,
    Move,
    lattice_named,
)
from cubepath.protocol.core.errors import ExcludedError, InputError
from cubepath.protocol.core.sites import Site, in_order, site_hook, to_json
from cubepath.protocol.core.system import FAR, KEPT, System, Ways, one_to_one, region_of

_FARTHEST = FAR // 2
"""Numbers of a cell where modules may start, so that none comes to `FAR` in any run."""
_FEW = 16


class LatticeSystem(System):
    """A catalogue placed by translation into a workspace with obstacles.

    `workspace` None is the whole lattice. `filled` and `empty` are the obstacles that are on and
    off; both may lie in a support, neither in a trace (paper, metamorphic system with obstacles).

    With `connected`, all states are connected by cells that touch, filled obstacles included: an
    action is admissible as usual, and legal only if the state that it leads to is connected. No
    neighbourhood decides this, so the system is not local: three moves may commute such that any
    two of them leave the aggregate connected and all three do not, a corner of positive curvature
    (paper, example of non-local positive curvature).
    """

    table: ClassVar[str] = "lattice"
    lattices: ClassVar[Mapping[str, Lattice]] = LATTICES
    """Those that a table can name; a class with lattices of its own has others."""
    catalogue: Catalogue

    def __init__(
        self,
        catalogue: Catalogue,
        *,
        workspace: Iterable[Site] | None = None,
        filled: Iterable[Site] = (),
        empty: Iterable[Site] = (),
        connected: bool = False,
    ) -> None:
        """Check the obstacles and derive all neighbourhoods from the catalogue."""
        lattice = catalogue.lattice
        # Narrower than in the base class, and set only here.
        self.catalogue = catalogue  # pyright: ignore[reportIncompatibleVariableOverride]
        self.local = not connected
        self.bounded = workspace is not None
        self.workspace = (
            None if workspace is None else frozenset(lattice.check(site) for site in workspace)
        )
        self.filled = frozenset(lattice.check(site) for site in filled)
        self.empty = frozenset(lattice.check(site) for site in empty)
        both = self.filled & self.empty
        if both:
            raise InputError(f"obstacle {in_order(both)[0]!r} is both filled and empty")
        self.obstacles: frozenset[Site] = self.filled | self.empty
        self.places = (*self.obstacles, *(self.workspace or ()))
        self.drawing = lattice.drawing
        self.site_size = lattice.arity
        self.dimension = lattice.dimension
        near = self._near = _neighbourhoods(catalogue)
        self.move_slots = near.move_slots
        self.sense_slots = max(len(found) for found in near.sensed.values())
        self.reach_slots = max(len(found) for found in near.reach.values())
        self._sensed = near.sensed_at
        self._listeners = near.listeners_at
        self._reach = near.reach_at
        self._kept_moves = lru_cache(maxsize=near.kept)(self._moves)
        self._placed = near.placed

    def __reduce__(self) -> tuple[object, ...]:
        # The caches cannot be pickled, and need not be.
        build = partial(
            type(self),
            self.catalogue,
            workspace=self.workspace,
            filled=self.filled,
            empty=self.empty,
            connected=not self.local,
        )
        return build, ()

    def to_table(self) -> dict[str, Any]:
        """Return lattice, generators, workspace and obstacles."""
        table: dict[str, Any] = {"name": self.catalogue.lattice.name}
        if self.workspace is not None:
            table["workspace"] = to_json(in_order(self.workspace))
        for key, sites in (("filled", self.filled), ("empty", self.empty)):
            if sites:
                table[key] = to_json(in_order(sites))
        if not self.local:
            table["connected"] = True
        table["generators"] = list(map(msgspec.to_builtins, self.catalogue.generators))
        return table

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Self:
        """Return the system of a table ``[lattice]``; docs/files.md has its keys."""
        found = msgspec.convert(table, _LatticeTable, dec_hook=site_hook)
        return cls(
            Catalogue(lattice_named(found.name, cls.lattices), found.generators),
            workspace=found.workspace,
            filled=found.filled,
            empty=found.empty,
            connected=found.connected,
        )

    def _moves(self, site: Site) -> tuple[Move | None, ...]:
        found: list[Move | None] = [
            move if self._fits(move.action) else None
            for move in self._near.proposals(self.catalogue.lattice.check(site))
        ]
        return tuple(found + [None] * (self.move_slots - len(found)))

    def moves(self, site: Site) -> tuple[Move | None, ...]:
        """Return the moves of a module at `site`, one slot for each generator and direction."""
        return self._kept_moves(site)

    def _fits(self, action: Action) -> bool:
        return action.trace.isdisjoint(self.obstacles) and (
            self.workspace is None or action.support <= self.workspace
        )

    def _why_unfit(self, action: Action) -> str:
        blocked = in_order(action.trace & self.obstacles)
        if blocked:
            return f"it would move an obstacle, {blocked[0]!r}"
        outside = in_order(action.support - (self.workspace or frozenset()))
        return f"it would leave the workspace, to which {outside[0]!r} does not belong"

    def action(self, generator: str, at: Site) -> Action:
        """Return the generator translated by `at`; InputError if it is not an action here."""
        if generator not in self.catalogue.by_name:
            names = ", ".join(self.catalogue.by_name)
            raise InputError(f"unknown generator {generator!r}, expected one of {names}")
        lattice = self.catalogue.lattice
        if not (
            isinstance(at, tuple)
            and len(at) == lattice.dimension
            and all(type(item) is int for item in at)
            and not (lattice.even and sum(at) % 2)
        ):
            what = f"{lattice.dimension} integers" + lattice.even * " with an even sum"
            raise InputError(f"generator {generator!r}: 'at' is {what}, found {at!r}")
        action = self._placed(generator, at)
        if not self._fits(action):
            raise ExcludedError(f"{action.label}: {self._why_unfit(action)}")
        return action

    def sensed(self, place: Site) -> tuple[Site | None, ...]:
        """Return the support cells of all moves of a module at `place`, in canonical order."""
        return self._sensed(place)

    def listeners(self, place: Site) -> tuple[Site, ...]:
        """Return the places from which a module senses `place`."""
        return self._listeners(place)

    def reach(self, place: Site) -> tuple[Site, ...]:
        """Return the places of possible competitors of a module at `place`."""
        return self._reach(place)

    def region(self, place: Site) -> str:
        """Return the block of the lattice that a place lies in."""
        return self._near.region_at(place)

    def coordinates(self, place: Site) -> tuple[float, ...]:
        """Return the translation that takes the cell of this orbit at the origin to the cell."""
        return self.catalogue.lattice.check(place)[: self.dimension]

    def encode_site(self, site: Site) -> tuple[int, ...]:
        """Return the cell itself."""
        return self.catalogue.lattice.check(site)

    def decode_site(self, numbers: Sequence[int], label: int | None) -> Site:
        """Return the cell."""
        del label
        return tuple(int(number) for number in numbers)

    def has_place(self, place: Site) -> bool:
        """Return whether `place` is in the workspace and not an obstacle."""
        return place not in self.obstacles and (self.workspace is None or place in self.workspace)

    def check_place(self, place: Site) -> None:
        """Raise InputError if `place` is no cell of the lattice, or no module can stand there."""
        if not all(-_FARTHEST <= number <= _FARTHEST for number in self.encode_site(place)):
            raise InputError(f"cell {place} is too far away, expected numbers to {_FARTHEST}")
        super().check_place(place)

    def legal(self, state: AbstractSet[Site]) -> bool:
        """Return whether the cells that are on are connected, if they have to be."""
        return self.local or self.catalogue.lattice.pieces(state) <= 1

    def with_moves(self, placed: Iterable[tuple[str, Site]]) -> System:
        """Return the catalogue on the whole lattice, without obstacles."""
        del placed
        return type(self)(self.catalogue)

    def ways(self) -> Ways:
        """Return where modules go in all placements, including those whose support does not fit."""
        goes_at, has_place = self._near.goes_at, self.has_place

        def near(site: Site) -> Iterable[Site]:
            return [other for other in goes_at(site) if has_place(other)]

        return Ways(near, one_to_one(each.motion for each in self.catalogue.generators))


class _LatticeTable(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    name: str
    generators: tuple[Generator, ...]
    workspace: list[Site] | None = None
    filled: list[Site] = []
    empty: list[Site] = []
    connected: bool = False


class _Neighbourhoods:
    """Which sites sense and can obstruct which, as offsets from each orbit's representative.

    What was asked of a catalogue is kept: it is the same for all systems that have it.
    """

    def __init__(self, catalogue: Catalogue) -> None:
        self._catalogue = catalogue
        self.move_slots = max(len(found) for found in catalogue.templates.values())
        self.kept = KEPT // max(1, self.move_slots // _FEW)  # hundreds of moves take a megabyte
        self.placed = lru_cache(maxsize=self.kept * self.move_slots)(catalogue.place)
        self.proposals = lru_cache(maxsize=self.kept)(
            lambda cell: catalogue.proposals(cell, self.placed)
        )
        lattice = catalogue.lattice
        self.region_at = lru_cache(maxsize=KEPT)(
            lambda place: region_of(lattice.check(place)[: lattice.dimension])
        )
        proposals = {orbit: catalogue.proposals(orbit) for orbit in sorted(catalogue.templates)}
        supports = {
            orbit: {site for move in moves for site in move.action.support}
            for orbit, moves in proposals.items()
        }
        self.sensed: dict[Cell, tuple[Cell, ...]] = {
            orbit: _cells(sites - {orbit}) for orbit, sites in supports.items()
        }
        self.listeners: dict[Cell, tuple[Cell, ...]] = {}
        self.reach: dict[Cell, tuple[Cell, ...]] = {}
        for orbit in proposals:
            heard: set[Site] = set()
            for other, cells in self.sensed.items():
                for cell in cells:
                    by = lattice.between(cell, orbit)
                    if by is not None:
                        heard.add(lattice.shift(other, by))
            self.listeners[orbit] = _cells(heard)
            self.reach[orbit] = self._competitors(orbit, proposals)
        pad = max(map(len, self.sensed.values()))
        self.sensed_at = self._keeper(self.sensed, pad=pad)
        self.listeners_at = self._keeper(self.listeners)
        self.reach_at = self._keeper(self.reach)
        self.goes_at = self._keeper({orbit: self._goes(orbit) for orbit in self._orbits()})

    def _orbits(self) -> set[Cell]:
        """Return the orbits that modules come from or go to."""
        motions = (motion for each in self._catalogue.generators for motion in each.motion)
        return {self._catalogue.orbit(cell) for motion in motions for cell in motion}

    def _goes(self, orbit: Cell) -> tuple[Cell, ...]:
        """Return where some move takes a module from there, in the order of the catalogue."""
        lattice = self._catalogue.lattice
        found: dict[Cell, None] = {}
        for generator in self._catalogue.generators:
            for one, other in generator.motion:
                for source, target in ((one, other), (other, one)):
                    by = lattice.between(source, orbit)
                    if by is not None:
                        found[lattice.shift(target, by)] = None
        return tuple(found)

    def _competitors(
        self, orbit: Cell, proposals: Mapping[Cell, tuple[Move, ...]]
    ) -> tuple[Cell, ...]:
        lattice = self._catalogue.lattice
        my_traces, my_supports = self._reached(proposals[orbit])
        found: set[Site] = set()
        # A move there commutes with one here unless one's trace meets the other's support; so what
        # takes a site of the one to a site of the other takes a module to a place of competitors.
        for other, moves in proposals.items():
            traces, supports = self._reached(moves)
            for mine, theirs in ((my_traces, supports), (my_supports, traces)):
                for site, there in product(mine, theirs):
                    by = lattice.between(there, site)
                    if by is not None:
                        found.add(lattice.shift(other, by))
        found.discard(orbit)
        # A module that a move takes along must be notified, even if it has no move itself; and
        # reach is mutual.
        found |= {source for move in proposals[orbit] for source, _ in move.motion[1:]}
        for other, moves in proposals.items():
            for move in moves:
                for source, _ in move.motion[1:]:
                    by = lattice.between(lattice.check(source), orbit)
                    if by is not None:
                        found.add(lattice.shift(other, by))
        return _cells(found)

    def _reached(self, moves: Iterable[Move]) -> tuple[set[Cell], set[Cell]]:
        """Return the cells of all traces, and of all supports, of some moves."""
        check = self._catalogue.lattice.check
        traces = {check(site) for move in moves for site in move.action.trace}
        return traces, {check(site) for move in moves for site in move.action.support}

    def _keeper(
        self, table: Mapping[Cell, tuple[Cell, ...]], *, pad: int = 0
    ) -> Callable[[Site], tuple[Site, ...]]:
        """Return a cached function from a place to its neighbourhood in `table`."""
        lattice = self._catalogue.lattice

        @lru_cache(maxsize=KEPT)
        def at(place: Site) -> tuple[Site, ...]:
            cell = lattice.check(place)
            by = cell[: lattice.dimension]
            offsets = table.get(self._catalogue.orbit(cell), ())
            found = [lattice.shift(offset, by) for offset in offsets]
            return (*found, *[None] * (pad - len(found)))

        return at


_neighbourhoods = lru_cache(maxsize=16)(_Neighbourhoods)


def _cells(sites: Iterable[Site]) -> tuple[Cell, ...]:
    return tuple(cell for cell in in_order(sites) if isinstance(cell, tuple))
