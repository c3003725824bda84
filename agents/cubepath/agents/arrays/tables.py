"""The static part of a scene as arrays, which grow as modules reach new places.

Places have numbers; number 0 is no place. They lie in *blocks* of 1 << `shift` places: place p in
block p >> `shift`, at p & ((1 << `shift`) - 1) there. Places that sense alike, up to the blocks
around them, share a *row* of the tables. A lattice has a row for each place of a block. Any other
system has one block, a row for each place, and works it out when the first module arrives. So
tables are as large as the visited part of the world, whatever the system.

A *stand* is a site where a module can be: of row r, or of code c there, r * `codes` + c.

Sites whose moves are the same up to the names of the places are of one *kind*. A kind names places
by *reference*: 0 is the module's own, j + 1 is the one in slot j of `sensed`.
"""

from collections.abc import Iterable, Sequence
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.local.observation import goal_sets
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import CLOSED, FIRST_LABEL, Scene, System

ANY, OWN = -1, -2
"""In place of a code: every site at the place, and the site with the module's own label."""


class UntabledError(CubepathError):
    """The moves of a system do not fit into tables; the plain world plays them."""


class SiteNaming(Enum):
    """How the sites at one place differ."""

    ONE = "a place is a site"
    LABELS = "by labels, which move with the modules, and moves are alike for all of them"
    CODES = "by what they show"


class TabledMove(NamedTuple):
    """One move of a kind."""

    care: int
    """A bit for each probe that is read, of which those in `want` must hold."""
    want: int
    guards: tuple[tuple[int, int], ...]
    """If the first of these bits is set, then the second must be."""
    items: tuple[tuple[int, int, int], ...]
    """The support: reference, code (or `ANY`, `OWN`), and 1 for sites of the trace."""
    motion: tuple[tuple[int, int, int, int], ...]
    """Where modules go: reference and code before, reference and code after."""


class MoveKind(NamedTuple):
    """The moves of a module by slot; None for a slot that is empty, or never admissible."""

    probes: tuple[tuple[int, int], ...]
    """The slot and the code that each bit is for. Empty: bit j says whether slot j is on."""
    moves: tuple[TabledMove | None, ...]


def naming_of(system: System, start: Site) -> SiteNaming:
    """Return how the sites at one place differ, in a system with a module at `start`."""
    if system.codes <= FIRST_LABEL:
        return SiteNaming.ONE
    alike = system.labels is not None and system.pattern(start) is not None
    return SiteNaming.LABELS if alike else SiteNaming.CODES


def kind_at(system: System, site: Site, naming: SiteNaming) -> MoveKind:
    """Return the kind of a module at `site`; `UntabledError` if there is none."""
    return _Tabling(system, site, naming).kind()


class _Tabling:
    """The working out of one kind."""

    def __init__(self, system: System, site: Site, naming: SiteNaming) -> None:
        self._system, self._site, self._naming = system, site, naming
        self._place = system.place_of(site)
        self._slots = {
            near: slot for slot, near in enumerate(system.sensed(self._place)) if near is not None
        }
        self._probes: dict[tuple[int, int], int] = {}

    def kind(self) -> MoveKind:
        found = tuple(self._tabled(move) for move in self._system.moves(self._site))
        return MoveKind(tuple(self._probes), found)

    def _tabled(self, move: Move | None) -> TabledMove | None:
        if move is None:
            return None
        action = move.action
        sources = [source for source, _ in move.motion]
        ends = [end for end in action.ends if all(source in end for source in sources)]
        if not ends:
            return None
        if len(ends) > 1 or move.source != self._site:
            raise UntabledError(f"{action.label}: its motion does not tell where it begins")
        care = want = 0
        for known, bit, value in self._conditions(action.support - action.free, ends[0]):
            if bit is None:
                if known != value:
                    return None
                continue
            care |= 1 << bit
            want |= value << bit
        guards: list[tuple[int, int]] = []
        for one, other in in_order(action.guards):
            (first, first_known), (second, second_known) = self._shown(one), self._shown(other)
            if first_known == 0 or second_known == 1:
                continue
            if first is not None and second is not None:
                guards.append((first, second))
            elif first is None and second is None:
                return None
            else:
                # One of the two is known: the other is read.
                bit, value = (second, 1) if second is not None else (first, 0)
                mask = 1 << (bit or 0)
                if care & mask and bool(want & mask) != bool(value):
                    return None
                care |= mask
                want |= mask * value
        return TabledMove(care, want, tuple(guards), self._items(move), self._motion(move))

    def _ref(self, place: Site) -> int:
        if place == self._place:
            return 0
        slot = self._slots.get(place)
        if slot is None:
            raise UntabledError(f"{self._site!r} has moves over {place!r}, which it does not sense")
        return slot + 1

    def _bit(self, ref: int, code: int) -> int:
        if self._naming is not SiteNaming.CODES:
            return ref - 1
        return self._probes.setdefault((ref - 1, code), len(self._probes))

    def _shown(self, site: Site) -> tuple[int | None, int | None]:
        """Return the bit that says whether a site is on, or whether it is, if that is known."""
        ref = self._ref(self._system.place_of(site))
        if ref == 0:
            return None, int(site == self._site)
        if self._naming is SiteNaming.LABELS:
            raise UntabledError(f"guards over {site!r}, which has a label")
        return self._bit(ref, self._system.code_of(site)), None

    def _conditions(
        self, fixed: Iterable[Site], end: frozenset[Site]
    ) -> Iterable[tuple[int | None, int | None, int]]:
        """Yield for each site that is read: what is known, or its bit; and what it must be."""
        whole: dict[int, list[Site]] = {}
        for site in in_order(fixed):
            ref = self._ref(self._system.place_of(site))
            if ref and self._naming is SiteNaming.LABELS:
                whole.setdefault(ref, []).append(site)
                continue
            bit, known = self._shown(site)
            yield known, bit, int(site in end)
        for ref, sites in whole.items():
            if len(sites) != self._system.labels or any(site in end for site in sites):
                raise UntabledError(f"moves of {self._site!r} read single labels of {sites[0]!r}")
            yield None, self._bit(ref, ANY), 0

    def _code(self, site: Site) -> int:
        if self._naming is SiteNaming.ONE:
            return ANY
        if self._naming is SiteNaming.CODES:
            return self._system.code_of(site)
        if self._system.label_of(site) != self._system.label_of(self._site):
            raise UntabledError(f"moves of {self._site!r} change what {site!r} shows")
        return OWN

    def _items(self, move: Move) -> tuple[tuple[int, int, int], ...]:
        found: dict[tuple[int, int, int], None] = {}
        counted: dict[int, int] = {}
        for site in in_order(move.action.support):
            ref = self._ref(self._system.place_of(site))
            counted[ref] = counted.get(ref, 0) + 1
            if self._naming is not SiteNaming.LABELS:
                found[ref, self._code(site), int(site in move.action.trace)] = None
            elif site in move.action.trace:
                found[ref, self._code(site), 1] = None
        if self._naming is SiteNaming.LABELS:
            for ref, count in counted.items():
                if count != self._system.labels:
                    raise UntabledError(f"moves of {self._site!r} hold single labels")
                found[ref, ANY, 0] = None
        return tuple(found)

    def _motion(self, move: Move) -> tuple[tuple[int, int, int, int], ...]:
        place_of = self._system.place_of
        return tuple(
            (
                self._ref(place_of(source)),
                self._code(source),
                self._ref(place_of(target)),
                self._code(target),
            )
            for source, target in move.motion
        )


Ints = NDArray[np.int32]
Bits = NDArray[np.uint64]
WORD = 64
"""Probes to a word."""
ONE_BLOCK = 31
"""The `shift` with which all places lie in one block."""


class Places(NamedTuple):
    """What is known of each place, by number, of each block and of each row."""

    shift: int
    first: Ints
    """By block, the row of its first place."""
    around: Ints
    """Shape (blocks, ways): the first place of the block that lies that way, -1 if it has none
    yet. Way 0 is the same for all blocks: to place 0."""
    sensed: Ints
    """Shape (rows, sense_slots): what a module there senses, as the way to the block, times
    1 << `shift`, plus the number in the block; 0 in unused slots."""
    reach: Ints
    """Shape (rows, reach_slots): where notes come from; filled only for rules with notes."""
    background: Ints
    """What the place shows when no module is there."""
    goal: Ints
    """The first of its entries in `Goals`, -1 for none."""
    final: Ints
    """The code that is there at the goal of the scene, 0 for none."""


class Goals(NamedTuple):
    """The places and sites that modules know as goals, chained by place."""

    knower: Ints
    """Modules with the same goals share a number."""
    code: Ints
    """What is a goal if it is shown, or `ANY`."""
    following: Ints
    alike: bool
    """Whether all modules have the same goals, whatever the places show."""


class Stands(NamedTuple):
    """What is known of each stand."""

    kind: Ints
    """-1 until a module has been there."""
    encoded: Ints
    """Shape (stands, site_size): the encoded site, less the origin of its block."""
    origin: Ints
    """Shape (blocks, site_size)."""
    usable: NDArray[np.uint8]
    """Shape (places, move_slots): 0 where a move of the kind is excluded; one row if none is."""


class MoveKinds(NamedTuple):
    """All kinds so far. Of move a of kind k, number m = k * move_slots + a."""

    care: Bits
    """Shape (moves, words)."""
    want: Bits
    guards_at: Ints
    guards: Ints
    """Shape (guards, 2); those of move m are from guards_at[m] to guards_at[m + 1]."""
    items_at: Ints
    items: Ints
    """Shape (items, 3): reference, code, whether it is in the trace."""
    motion_at: Ints
    motion: Ints
    """Shape (motions, 4)."""
    probes_at: Ints
    probes: Ints
    """Shape (probes, 2): slot and code; by kind."""


class GrowingArray:
    """An array that is given more rows, all at first with the same value."""

    def __init__(self, value: int, dtype: Any, *tail: int) -> None:
        self.value = value
        self.array: NDArray[Any] = np.full((16, *tail), value, dtype)

    def room(self, count: int) -> None:
        """Make room for this many rows."""
        if count <= len(self.array):
            return
        size = max(count, 2 * len(self.array))
        found = np.full((size, *self.array.shape[1:]), self.value, self.array.dtype)
        found[: len(self.array)] = self.array
        self.array = found


def _array_of(rows: Sequence[Sequence[int]], width: int) -> Ints:
    """Return rows as an array; a row of zeros if there are none."""
    return np.array(rows or [(0,) * width], np.int32).reshape(-1, width)


class KindTable:
    """The kinds that were met, numbered."""

    def __init__(self, move_slots: int) -> None:
        self._slots = move_slots
        self._numbers: dict[MoveKind, int] = {}
        self._words = 1
        self._guards: list[tuple[int, int]] = []
        self._items: list[tuple[int, int, int]] = []
        self._motion: list[tuple[int, int, int, int]] = []
        self._probes: list[tuple[int, int]] = []
        self._ends = [(0, 0, 0)]
        self._probe_ends = [0]
        self._care: list[tuple[int, int]] = []
        self.arrays = self._as_arrays()

    def number(self, kind: MoveKind) -> int:
        """Return the number of a kind; a new one is added."""
        found = self._numbers.get(kind)
        if found is None:
            found = self._numbers[kind] = len(self._numbers)
            self._add(kind)
        return found

    def _add(self, kind: MoveKind) -> None:
        self._probes += kind.probes
        self._probe_ends.append(len(self._probes))
        for slot in range(self._slots):
            move = kind.moves[slot]
            # Of an empty slot a bit is wanted that is not read.
            care, want = (0, 1) if move is None else (move.care, move.want)
            self._care.append((care, want))
            self._words = max(self._words, -(-max(care, want).bit_length() // WORD))
            if move is not None:
                self._add_move(move)
            self._ends.append((len(self._guards), len(self._items), len(self._motion)))

    def _add_move(self, move: TabledMove) -> None:
        self._guards += move.guards
        self._items += move.items
        self._motion += move.motion
        bits = [bit for pair in move.guards for bit in pair]
        self._words = max(self._words, 1 + max(bits, default=0) // WORD)

    def publish(self) -> None:
        """Show in `arrays` what was added."""
        if len(self.arrays.probes_at) - 1 < len(self._numbers):
            self.arrays = self._as_arrays()

    def _as_arrays(self) -> MoveKinds:
        words = np.zeros((2, max(len(self._care), 1), self._words), np.uint64)
        for row, pair in enumerate(self._care):
            for which, bits in enumerate(pair):
                for word in range(self._words):
                    words[which, row, word] = bits >> (WORD * word) & ((1 << WORD) - 1)
        guards_at, items_at, motion_at = _array_of(self._ends, 3).T.copy()
        return MoveKinds(
            care=words[0],
            want=words[1],
            guards_at=guards_at,
            guards=_array_of(self._guards, 2),
            items_at=items_at,
            items=_array_of(self._items, 3),
            motion_at=motion_at,
            motion=_array_of(self._motion, 4),
            probes_at=np.array(self._probe_ends, np.int32),
            probes=_array_of(self._probes, 2),
        )


class Tables:
    """The tables of a scene: places, stands and kinds, as far as they are known."""

    def __init__(self, scene: Scene, *, notes: bool = False) -> None:
        """Number nothing but the goals; `UntabledError` if the system does not fit into tables."""
        system = scene.system
        self.scene = scene
        self._notes = notes
        self.naming = naming_of(system, scene.start[0])
        self.codes = system.codes if self.naming is SiteNaming.CODES else 1
        self.kinds = KindTable(system.move_slots)
        self._numbers: dict[Site, int] = {}
        self._named: list[Site | None] = [None]
        self.count = 1
        self._capacity = 0
        self._by_pattern: dict[Any, int] = {}
        self._place_arrays = (
            GrowingArray(0, np.int32),
            GrowingArray(-1, np.int32),
            GrowingArray(0, np.int32),
        )
        self._begin()
        self.places.background[0] = CLOSED
        self._number_goals()

    def _begin(self) -> None:
        """Make what has to be there before anything else."""
        system = self.scene.system
        self._row_arrays = (
            GrowingArray(0, np.int32, system.sense_slots),
            GrowingArray(0, np.int32, system.reach_slots if self._notes else 1),
        )
        self._stand_arrays = (
            GrowingArray(-1, np.int32),
            GrowingArray(0, np.int32, system.site_size),
        )
        self._room()

    @property
    def words(self) -> int:
        """Return how many words of probes a module has."""
        return int(self.kinds.arrays.care.shape[1])

    def _room(self) -> None:
        """Make room for as many places as there are numbers, and hand out the arrays."""
        if self.count <= self._capacity:
            return
        for each in (*self._place_arrays, *self._row_arrays):
            each.room(self.count)
        self._capacity = len(self._place_arrays[0].array)
        for each in self._stand_arrays:
            each.room(self._capacity * self.codes)
        system, none = self.scene.system, np.zeros((1, 1), np.int32)
        by_row = [each.array for each in self._row_arrays]
        by_place = [each.array for each in self._place_arrays]
        self.places = Places(ONE_BLOCK, none[0], none, *by_row, *by_place)
        kind, encoded = [each.array for each in self._stand_arrays]
        origin = np.zeros((1, system.site_size), np.int32)
        self.stands = Stands(kind, encoded, origin, np.ones((1, system.move_slots), np.uint8))

    def numbers(self, places: Iterable[Site]) -> list[int]:
        """Return the numbers of places; those that have none are given one."""
        found: list[int] = []
        new: list[Site] = []
        for place in places:
            number = self._numbers.get(place)
            if number is None:
                number = self._numbers[place] = len(self._named)
                self._named.append(place)
                new.append(place)
            found.append(number)
        if new:
            first, self.count = self.count, len(self._named)
            self._room()
            background = self.scene.system.background
            self.places.background[first : self.count] = [background(place) for place in new]
        return found

    def site(self, place: int, code: int) -> Site:
        """Return the site that is on at the place of this number when it shows `code`."""
        named = self._named[place]
        found = None if named is None else self.scene.system.site_at(named, code)
        if found is None:
            raise AssertionError(f"place {place} shows {code}, which is no site")
        return found

    def prepare(self, places: Ints, codes: Ints) -> None:
        """Work out the stands at these places with modules that show these codes."""
        chosen = self._unknown(places, codes)
        for place, code in dict.fromkeys(chosen):
            self._work_out(place, code)
        if chosen:
            self.kinds.publish()

    def _unknown(self, places: Ints, codes: Ints) -> list[tuple[int, int]]:
        stands = places * self.codes + (codes if self.codes > 1 else 0)
        unknown = np.flatnonzero(self.stands.kind[stands] < 0)
        return list(zip(places[unknown].tolist(), codes[unknown].tolist(), strict=True))

    def _work_out(self, number: int, code: int) -> None:
        system = self.scene.system
        site = self.site(number, code)
        place = system.place_of(site)
        sensed = self._numbered(system.sensed(place))
        self.places.sensed[number] = sensed
        if self._notes:
            reach = self._numbered(system.reach(place))
            self.places.reach[number, : len(reach)] = reach
        stand = number * self.codes + (code if self.codes > 1 else 0)
        pattern = None if self.naming is SiteNaming.CODES else system.pattern(site)
        kind = None if pattern is None else self._by_pattern.get(pattern)
        if kind is None:
            kind = self.kinds.number(kind_at(system, site, self.naming))
            if pattern is not None:
                self._by_pattern[pattern] = kind
        self.stands.kind[stand] = kind
        self.stands.encoded[stand] = system.encode_site(site)

    def _numbered(self, places: Sequence[Site | None]) -> list[int]:
        given = iter(self.numbers(place for place in places if place is not None))
        return [0 if place is None else next(given) for place in places]

    def _number_goals(self) -> None:
        scene, system = self.scene, self.scene.system
        sets = goal_sets(scene)
        known: dict[int, int] = {}
        entries: list[tuple[int, int]] = []
        where: list[Site] = []
        for goals in sets:
            if id(goals) in known:
                continue
            number = known[id(goals)] = len(known)
            for site in in_order(goals):
                # Where sites have letters, a place is a goal whatever it shows, or with one letter.
                place = system.place_of(site) if system.labels is None else site
                entries.append((number, ANY if place == site else system.code_of(site)))
                where.append(place)
        self.knower = np.array([known[id(goals)] for goals in sets], np.int32)
        alike = len(known) == 1 and all(code == ANY for _, code in entries)
        self._chain(entries, self.numbers(where), alike=alike)
        final = in_order(scene.goal or ())
        at = self.numbers([system.place_of(site) for site in final])
        self.places.final[at] = [system.code_of(site) for site in final]

    def _chain(self, entries: list[tuple[int, int]], at: list[int], *, alike: bool) -> None:
        following = np.full(max(len(entries), 1), -1, np.int32)
        for entry, place in enumerate(at):
            following[entry] = self.places.goal[place]
            self.places.goal[place] = entry
        both = np.array(entries or [(0, ANY)], np.int32)
        self.goals = Goals(both[:, 0].copy(), both[:, 1].copy(), following, alike)
