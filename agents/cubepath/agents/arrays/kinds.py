"""What a module at a site can do, with its neighbourhood numbered instead of named.

Sites whose moves are the same up to the names of the places are of one *kind*. A kind speaks of
places by *reference*: 0 is the module's own, j + 1 is the one in slot j of `sensed`.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from typing import NamedTuple

from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import FIRST_LABEL, System

ANY, OWN = -1, -2
"""In place of a code: every site at the place, and the site with the module's own label."""


class UntabledError(CubepathError):
    """The moves of a system do not fit into tables; the plain world plays them."""


class Naming(Enum):
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


class Kind(NamedTuple):
    """The moves of a module by slot; None for a slot that is empty, or never admissible."""

    probes: tuple[tuple[int, int], ...]
    """The slot and the code that each bit is for. Empty: bit j says whether slot j is on."""
    moves: tuple[TabledMove | None, ...]


def naming_of(system: System, start: Site) -> Naming:
    """Return how the sites at one place differ, in a system with a module at `start`."""
    if system.codes <= FIRST_LABEL:
        return Naming.ONE
    alike = system.labels is not None and system.pattern(start) is not None
    return Naming.LABELS if alike else Naming.CODES


def kind_at(system: System, site: Site, naming: Naming) -> Kind:
    """Return the kind of a module at `site`; `UntabledError` if there is none."""
    return _Tabling(system, site, naming).kind()


class _Tabling:
    """The working out of one kind."""

    def __init__(self, system: System, site: Site, naming: Naming) -> None:
        self._system, self._site, self._naming = system, site, naming
        self._place = system.place_of(site)
        self._slots = {
            near: slot for slot, near in enumerate(system.sensed(self._place)) if near is not None
        }
        self._probes: dict[tuple[int, int], int] = {}

    def kind(self) -> Kind:
        found = tuple(self._tabled(move) for move in self._system.moves(self._site))
        return Kind(tuple(self._probes), found)

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
        for one, other in in_order_of_pairs(action.guards):
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
        if self._naming is not Naming.CODES:
            return ref - 1
        return self._probes.setdefault((ref - 1, code), len(self._probes))

    def _shown(self, site: Site) -> tuple[int | None, int | None]:
        """Return the bit that says whether a site is on, or whether it is, if that is known."""
        ref = self._ref(self._system.place_of(site))
        if ref == 0:
            return None, int(site == self._site)
        if self._naming is Naming.LABELS:
            raise UntabledError(f"guards over {site!r}, which has a label")
        return self._bit(ref, self._system.code_of(site)), None

    def _conditions(
        self, fixed: Iterable[Site], end: frozenset[Site]
    ) -> Iterable[tuple[int | None, int | None, int]]:
        """Yield for each site that is read: what is known, or its bit; and what it must be."""
        whole: dict[int, list[Site]] = {}
        for site in in_order(fixed):
            ref = self._ref(self._system.place_of(site))
            if ref and self._naming is Naming.LABELS:
                whole.setdefault(ref, []).append(site)
                continue
            bit, known = self._shown(site)
            yield known, bit, int(site in end)
        for ref, sites in whole.items():
            if len(sites) != self._system.labels or any(site in end for site in sites):
                raise UntabledError(f"moves of {self._site!r} read single labels of {sites[0]!r}")
            yield None, self._bit(ref, ANY), 0

    def _code(self, site: Site) -> int:
        if self._naming is Naming.ONE:
            return ANY
        if self._naming is Naming.CODES:
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
            if self._naming is not Naming.LABELS:
                found[ref, self._code(site), int(site in move.action.trace)] = None
            elif site in move.action.trace:
                found[ref, self._code(site), 1] = None
        if self._naming is Naming.LABELS:
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


def in_order_of_pairs(pairs: Iterable[tuple[Site, Site]]) -> list[tuple[Site, Site]]:
    """Return pairs of sites in an order that does not depend on hashes."""
    listed = list(pairs)
    keys = in_order({site for pair in listed for site in pair})
    place = {site: number for number, site in enumerate(keys)}
    return sorted(listed, key=lambda pair: (place[pair[0]], place[pair[1]]))
