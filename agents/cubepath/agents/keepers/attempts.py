"""What an attempt needs from each keeper: derived from the catalogue, and checked against it.

Every process that handles an attempt derives the same, so messages do not carry it.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import System
from cubepath.protocol.wire.free_messages import Attempt
from cubepath.protocol.wire.keys import Tiles

Lock: TypeAlias = tuple[bool, Site]
"""What can be locked: a unit (False), or the register at a place (True)."""
NO_PLACE = (InputError, TypeError, ValueError, IndexError, KeyError, AttributeError, OverflowError)
"""What systems raise for a value that is none of their sites."""
_PLANS_MAX = 1 << 12


class NotAnAttempt(InputError):  # noqa: N818 - named for what it is not
    """An attempt that no module of the system can make."""


@dataclass(frozen=True, slots=True)
class Share:
    """What one keeper has to do with an attempt, in canonical order."""

    sensed: tuple[tuple[Site, Site | None], ...]
    """Units with what must be there."""
    reads: tuple[Site, ...]
    writes: tuple[Site, ...]
    guards: tuple[Site, ...]
    notes: tuple[tuple[Site, tuple[int, ...], tuple[int, ...] | None], ...]
    after: tuple[tuple[Site, int, int | None], ...]
    shared: frozenset[Lock]
    exclusive: frozenset[Lock]

    def conflicts(self, other: Share) -> bool:
        """Return whether the two cannot be under way at one time."""
        return not (
            self.exclusive.isdisjoint(other.exclusive)
            and self.exclusive.isdisjoint(other.shared)
            and self.shared.isdisjoint(other.exclusive)
        )


@dataclass(frozen=True, slots=True)
class AttemptPlan:
    """An attempt with its chain of keepers, in increasing order, and the share of each."""

    attempt: Attempt
    site: Site
    """Where the module stands."""
    move: Move | None
    chain: tuple[int, ...]
    shares: Mapping[int, Share]

    @property
    def motion(self) -> tuple[tuple[Site, Site], ...]:
        """Return where each module goes that the move takes along, the mover first."""
        return () if self.move is None else self.move.motion


def support_units(system: System, tiles: Tiles, move: Move) -> tuple[frozenset[Site], ...]:
    """Return the units that a move reads, and those that it writes; what never changes is left out.

    Obstacles and places outside the workspace are known to all, so no keeper has them.
    """
    written = frozenset(tiles.unit_of(site) for site in move.action.trace)
    touched = frozenset(
        tiles.unit_of(site)
        for site in move.action.support
        if system.has_place(system.place_of(site))
    )
    return touched - written, written


def planned(system: System, tiles: Tiles, attempt: Attempt) -> AttemptPlan:
    """Return what an attempt takes; NotAnAttempt if no module could make it.

    What the attempt claims to have sensed must lie within the module's sensing range, and make the
    move admissible; whether it holds is for the keepers to say.
    """
    known = _known_plans(system, tiles)
    try:
        content = _content(attempt)
        plan = known.get(content)
        if plan is not None:
            return AttemptPlan(attempt, plan.site, plan.move, plan.chain, plan.shares)
        if len(known) >= _PLANS_MAX:
            known.clear()
        plan = known[content] = _planned(system, tiles, attempt)
    except NotAnAttempt:
        raise
    except NO_PLACE as error:
        raise _not_an_attempt(attempt, error) from None
    return plan


@lru_cache(maxsize=16)
def _known_plans(_system: System, _tiles: Tiles) -> dict[Hashable, AttemptPlan]:
    """Return the plans made lately, by the content of the attempt: modules go the same ways."""
    return {}


def _content(attempt: Attempt) -> Hashable:
    """Return all that a plan depends on."""
    notes = [
        (place, tuple(shown), None if new is None else tuple(new))
        for place, shown, new in attempt.notes
    ]
    return (
        attempt.site,
        attempt.generator,
        attempt.at,
        tuple(attempt.sensed),
        tuple(notes),
        tuple(attempt.after),
    )


def chain_of(system: System, tiles: Tiles, attempt: Attempt) -> tuple[int, ...]:
    """Return the keepers of an attempt in increasing order, of one that `planned` has checked.

    NotAnAttempt if its places are not in the system.
    """
    place_of = _unit_place(system)
    try:
        places = [place_of(unit) for unit, _ in attempt.sensed]
        places += (place for place, _, _ in attempt.notes)
        return tuple(sorted({tiles.keeper_of(place) for place in places}))
    except NO_PLACE as error:
        raise _not_an_attempt(attempt, error) from None


def _not_an_attempt(attempt: Attempt, error: Exception) -> NotAnAttempt:
    why = " ".join(f"{type(error).__name__}: {error}".split())
    return NotAnAttempt(f"attempt of module_{attempt.module}: {why}"[:200])


def _planned(system: System, tiles: Tiles, attempt: Attempt) -> AttemptPlan:
    site = attempt.site
    own = system.place_of(site)
    system.check_place(own)
    sensed = dict(attempt.sensed)
    move = _move(system, site, attempt)
    reads: frozenset[Site] = frozenset()
    writes: frozenset[Site] = frozenset()
    if move is not None:
        reads, writes = support_units(system, tiles, move)
        missing = (reads | writes) - sensed.keys()
        if missing:
            raise NotAnAttempt(f"nothing is said of {in_order(missing)[0]!r} in the support")
        if not move.possible({*sensed.values()} | (system.filled & move.action.support)):
            raise NotAnAttempt("the move is not admissible where that was sensed")
    elif sensed:
        raise NotAnAttempt("guards without a move")
    near = {own, *system.sensed(own)}
    place_of = _unit_place(system)
    for unit in sensed:
        if place_of(unit) not in near:
            raise NotAnAttempt(f"{unit!r} is out of sensing range")
    notes = _notes(system, attempt, own)
    if move is None and own not in notes:
        raise NotAnAttempt("neither a move, nor anything about the module's own register")
    after = {unit: (version, reads) for unit, version, reads in attempt.after}
    if not after.keys() <= reads | writes:
        raise NotAnAttempt("what must be done before is not in the support")
    shares: dict[int, list[Site]] = {}
    for unit in sensed:
        shares.setdefault(tiles.keeper_of(place_of(unit)), []).append(unit)
    chain = tuple(sorted({*shares, *(tiles.keeper_of(place) for place in notes)}))
    return AttemptPlan(
        attempt,
        site,
        move,
        chain,
        {
            keeper: _share(
                system,
                {unit: sensed[unit] for unit in in_order(shares.get(keeper, ()))},
                {place: note for place, note in notes.items() if tiles.keeper_of(place) == keeper},
                (reads, writes),
                after,
            )
            for keeper in chain
        },
    )


def _move(system: System, site: Site, attempt: Attempt) -> Move | None:
    if attempt.generator is None:
        return None
    move = system.move_named(site, attempt.generator, attempt.at)
    if move is None:
        raise NotAnAttempt(f"{attempt.generator!r} is no move from there")
    return move


def _notes(
    system: System, attempt: Attempt, own: Site
) -> dict[Site, tuple[tuple[int, ...], tuple[int, ...] | None]]:
    near = {own, *system.reach(own)}
    found = {}
    for at, shown, new in attempt.notes:
        if at not in near:
            raise NotAnAttempt(f"the register at {at!r} is out of reach")
        found[at] = tuple(shown), None if new is None else tuple(new)
    return found


def _unit_place(system: System) -> Callable[[Site], Site]:
    return (lambda unit: unit) if system.labels is not None else system.place_of


def _share(
    system: System,
    units: Mapping[Site, Site | None],
    notes: Mapping[Site, tuple[tuple[int, ...], tuple[int, ...] | None]],
    touched: tuple[frozenset[Site], frozenset[Site]],
    after: Mapping[Site, tuple[int, int | None]],
) -> Share:
    reads, writes = touched
    place_of = _unit_place(system)
    written = [unit for unit in units if unit in writes]
    exclusive: set[Lock] = {(False, unit) for unit in written}
    exclusive |= {(True, place_of(unit)) for unit in written}
    shared: set[Lock] = {(False, unit) for unit in units if unit not in writes}
    for place, (_, new) in notes.items():
        (shared if new is None else exclusive).add((True, place))
    return Share(
        sensed=tuple(units.items()),
        reads=tuple(unit for unit in units if unit in reads),
        writes=tuple(written),
        guards=tuple(unit for unit in units if unit not in reads and unit not in writes),
        notes=tuple((place, *notes[place]) for place in in_order(notes)),
        after=tuple((unit, *after[unit]) for unit in units if unit in after),
        shared=frozenset(shared),
        exclusive=frozenset(exclusive),
    )
