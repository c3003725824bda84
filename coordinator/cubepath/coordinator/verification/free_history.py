"""What was where at which version, derived from the start and the commits of keepers.

Room: coordinator. Part of `cubepath verify`. Commits are put in an order in which they can have
happened, by the versions that they name, and carried out one after another; so there is the site at
every version of every unit, and the place and the register of every module at its versions. It
shares only the catalogue and the tiles with a run.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from heapq import heapify, heappop, heappush
from itertools import pairwise
from typing import NamedTuple

from cubepath.coordinator.verification.free_transcript import commit_text
from cubepath.coordinator.verification.free_units import (
    NO_SITE,
    changed_by,
    held_by,
    on_unit,
    unit_in,
    units_of,
)
from cubepath.coordinator.verification.rounds import make, why_not
from cubepath.coordinator.verification.transcript import Fail, site_in
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.names import Json
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.free_messages import Moved, Register
from cubepath.protocol.wire.messages import encode

_START = [0]


class Standing(NamedTuple):
    """A module at one of its versions: where it stands, and its register."""

    site: Site
    note: Register
    commit: int
    """The commit that made the version; -1 for the start."""
    since: int
    """The version at which it came to this site."""


class There(NamedTuple):
    """What is at a place at one of its versions."""

    site: Site | None
    module: int | None
    since: int
    """The version at which the module came there."""


class Carried(NamedTuple):
    """A move of the run, in an order in which the moves can have happened."""

    moved: Moved
    move: Move
    level: int


@dataclass(slots=True)
class _Unit:
    """The commits that touch a unit, by the version that they find."""

    writers: dict[int, list[int]] = field(default_factory=dict)
    readers: dict[int, list[int]] = field(default_factory=dict)
    guards: dict[int, list[int]] = field(default_factory=dict)


class History:
    """A run without rounds, derived; `fail` is called for each violation."""

    def __init__(self, scene: Scene, commits: Iterable[Moved], fail: Fail) -> None:
        """Order the commits and carry them out."""
        self.scene, self.system = scene, scene.system
        self.commits: Sequence[Moved] = list(commits)
        self.state: set[Site] = set(scene.start) | scene.system.filled
        self.sites: list[Site] = list(scene.start)
        self.notes: list[Register] = [[] for _ in scene.start]
        self.modules = [[Standing(site, [], -1, 0)] for site in scene.start]
        """By module what it was at each of its versions."""
        self.places: dict[Site, list[There]] = {}
        self.shows: dict[Site, list[Site | None]] = {}
        """By unit the site that was on at each version, once it was touched."""
        self.reads: dict[Site, list[int]] = {}
        """By unit how often each version was read."""
        self.levels: dict[Site, list[int]] = {}
        """By unit the level of the commit that wrote each version, 0 for the start."""
        self.read_levels: dict[Site, list[int]] = {}
        """By unit the greatest level of those that read each version."""
        self.carried: list[Carried] = []
        self.order: dict[int, int] = {}
        """By commit the place at which it was carried out."""
        self._fail = fail
        self._units: dict[Site, _Unit] = {}
        self._changers: dict[int, dict[int, list[int]]] = {}
        self._holders: dict[int, dict[int, list[int]]] = {}
        self._standing = {scene.system.place_of(site): site for site in scene.start}
        self._module_at = {
            scene.system.place_of(site): module for module, site in enumerate(scene.start)
        }
        self._start = {**self._standing}, {**self._module_at}
        for number, moved in enumerate(self.commits):
            self._sort(number, moved)
        self._check_versions()
        for number in self._in_order():
            self._carry_out(number)

    # What is known of a version.

    def at_unit(self, unit: Site, version: int) -> tuple[bool, Site | None]:
        """Return whether a unit ever had a version, and the site that was on then."""
        known = self.shows.get(unit)
        if known is None:
            return version == 0, self._at_start(unit)
        return version < len(known), known[version] if version < len(known) else None

    def at_place(self, place: Site, version: int) -> There | None:
        """Return what was at a place at a version; None if it never had it."""
        known = self.places.get(place)
        if known is None:
            standing, modules = self._start
            there = There(standing.get(place), modules.get(place), 0)
            return there if version == 0 else None
        return known[version] if version < len(known) else None

    def module(self, module: int, version: int) -> Standing | None:
        """Return where a module stood at a version, and its register; None if it never had it."""
        if not 0 <= module < len(self.modules) or version >= len(self.modules[module]):
            return None
        return self.modules[module][version]

    def _at_start(self, unit: Site) -> Site | None:
        return on_unit(self.system, unit, self._start[0])

    # Versions.

    def _sort(self, number: int, moved: Moved) -> None:
        def unit_of(value: Json) -> _Unit:
            site = unit_in(self.system, value)
            if site is None:
                self._fail("units", f"{commit_text(moved)}: {value!r} is no unit")
                return _Unit()
            return self._units.setdefault(site, _Unit())

        for value, version in moved.read:
            unit_of(value).readers.setdefault(version, []).append(number)
        for value, version, _ in moved.written:
            unit_of(value).writers.setdefault(version, []).append(number)
        for value, version in moved.guarded:
            unit_of(value).guards.setdefault(version, []).append(number)
        for module, version in changed_by(moved).items():
            self._changers.setdefault(module, {}).setdefault(version, []).append(number)
        for module, version in held_by(moved).items():
            self._holders.setdefault(module, {}).setdefault(version, []).append(number)

    def _check_versions(self) -> None:
        for unit, known in self._units.items():
            last = len(known.writers)
            for version, writers in sorted(known.writers.items()):
                self._check_one(site_text(unit), version, writers, follows=version < last)
                found = len(known.readers.get(version, ()))
                self._check_readers(unit, version, writers, found)
            self._check_seen(site_text(unit), last, known.readers)
            self._check_seen(site_text(unit), last, known.guards)
        for module, changers in self._changers.items():
            for version, users in sorted(changers.items()):
                follows = 1 <= version <= len(changers)
                self._check_one(f"module_{module}", version, users, follows=follows)
        for module, holders in self._holders.items():
            self._check_seen(f"module_{module}", len(self._changers.get(module, ())), holders)

    def _check_one(self, what: str, version: int, users: list[int], *, follows: bool) -> None:
        first, *more = users
        if more:
            both = f"{commit_text(self.commits[first])} and {commit_text(self.commits[more[0]])}"
            self._fail("versions", f"version {version} of {what} is changed by both {both}")
        if not follows:
            name = commit_text(self.commits[first])
            self._fail("versions", f"{name}: version {version} of {what} follows on none")

    def _check_seen(self, what: str, last: int, seen: dict[int, list[int]]) -> None:
        for version, users in sorted(seen.items()):
            if version > last:
                name = commit_text(self.commits[users[0]])
                self._fail("versions", f"{name}: {what} never had version {version}")

    def _check_readers(self, unit: Site, version: int, writers: list[int], found: int) -> None:
        moved = self.commits[writers[0]]
        told = next(
            reads for value, at, reads in moved.written if (site_in(value), at) == (unit, version)
        )
        if told != found:
            self._fail(
                "readers",
                f"{commit_text(moved)} counts {told} readers of version {version} of"
                f" {site_text(unit)}, on record are {found}",
            )

    # An order in which all can have happened.

    def _edges(self) -> Iterator[tuple[int, int]]:
        """Yield pairs of commits of which the first came before the second."""
        for known in self._units.values():
            for version, writers in known.writers.items():
                users = [
                    *known.readers.get(version, ()),
                    *known.guards.get(version, ()),
                ]
                yield from ((user, writer) for user in users for writer in writers[:1])
                after = [
                    *users_of(known, version + 1),
                    *known.writers.get(version + 1, ())[:1],
                ]
                yield from ((writers[0], user) for user in after)
        for module, changers in self._changers.items():
            holders = self._holders.get(module, {})
            for version, users in changers.items():
                yield from ((user, users[0]) for user in holders.get(version - 1, ()))
                after = [*holders.get(version, ()), *changers.get(version + 1, ())[:1]]
                yield from ((users[0], user) for user in after)
        last: dict[int, int] = {}
        epochs: dict[int, list[tuple[int, int, int]]] = {}
        for number, moved in enumerate(self.commits):
            if moved.keeper in last:
                yield last[moved.keeper], number
            last[moved.keeper] = number
            epochs.setdefault(moved.module, []).append((moved.epoch, moved.number, number))
        for attempts in epochs.values():
            attempts.sort()
            for (*_, one), (*_, two) in pairwise(attempts):
                yield one, two

    def _in_order(self) -> list[int]:
        before = [0] * len(self.commits)
        after: list[list[int]] = [[] for _ in self.commits]
        for one, two in self._edges():
            if one != two:
                after[one].append(two)
                before[two] += 1
        ready = [number for number, count in enumerate(before) if not count]
        heapify(ready)
        found: list[int] = []
        while ready:
            number = heappop(ready)
            found.append(number)
            for each in after[number]:
                before[each] -= 1
                if not before[each]:
                    heappush(ready, each)
        if len(found) < len(self.commits):
            stuck = min(number for number, count in enumerate(before) if count)
            self._fail(
                "order",
                f"{commit_text(self.commits[stuck])} and others come each before the other by"
                " their versions, guards and numbers",
            )
        return found

    # Carrying out.

    def _carry_out(self, number: int) -> None:
        moved = self.commits[number]
        self.order[number] = len(self.order)
        if moved.generator is None:
            if moved.level or moved.read or moved.written or moved.motion or moved.guarded:
                self._fail("units", f"{commit_text(moved)} makes no move, expected registers alone")
        else:
            try:
                self._move(moved)
            except NO_SITE as error:
                self._fail("units", f"{commit_text(moved)}: {error}")
        contents = {module: note for _, module, _, note in moved.notes}
        for module in changed_by(moved):
            if 0 <= module < len(self.sites):
                note = contents.get(module)
                if note is not None:
                    self.notes[module] = note
                self._stands(module, number)

    def _stands(self, module: int, commit: int) -> None:
        known = self.modules[module]
        before, site = known[-1], self.sites[module]
        moves = module in {each for each, *_ in self.commits[commit].motion}
        since = len(known) if moves else before.since
        known.append(Standing(site, self.notes[module], commit, since))

    def _move(self, moved: Moved) -> None:
        move = self._named(moved)
        if move is None:
            self._fail("units", f"{commit_text(moved)}: no module makes {moved.generator!r} so")
            return
        self._check_motion(moved, move)
        reads, writes = units_of(self.system, move)
        told = [site_in(unit) for unit, _ in moved.read], [site_in(u) for u, *_ in moved.written]
        for what, due, found in (("reads", reads, told[0]), ("writes", writes, told[1])):
            if frozenset(found) != due or len(found) != len(due):
                self._fail("units", f"{commit_text(moved)} {what} other units than its move does")
        why = why_not(move.action, self.state)
        if why is None and not all(source in self.state for source, _ in move.motion):
            why = "its modules stand where it ends"
        if why is not None:
            self._fail("admissible", f"{commit_text(moved)}: {why}")
            return
        level = self._level(reads, writes)
        if level != moved.level:
            name = commit_text(moved)
            self._fail("levels", f"{name} is of level {moved.level}, derived is {level}")
        make(move.action, self.state)
        self._take_along(move)
        self._count(reads, writes, level)
        self.carried.append(Carried(moved, move, level))

    def _named(self, moved: Moved) -> Move | None:
        """Return the move of a commit from where its module stands."""
        at = site_in(moved.at)
        if not 0 <= moved.module < len(self.sites) or at is None:
            return None
        for move in self.system.moves(self.sites[moved.module]):
            if move is not None and (move.generator, move.at) == (moved.generator, at):
                return move
        return None

    def _check_motion(self, moved: Moved, move: Move) -> None:
        told = [(site_in(source), site_in(target)) for _, source, target, _ in moved.motion]
        if told != list(move.motion) or moved.motion[0][0] != moved.module:
            self._fail("sites", f"{commit_text(moved)}: its motion is not that of its move")
            return
        for module, source, _, _ in moved.motion:
            if not 0 <= module < len(self.sites) or self.sites[module] != site_in(source):
                name = commit_text(moved)
                self._fail("sites", f"{name} takes module_{module} from where it does not stand")

    def _level(self, reads: frozenset[Site], writes: frozenset[Site]) -> int:
        depends = [self.levels.get(unit, _START)[-1] for unit in reads | writes]
        return 1 + max([0, *depends, *(self.read_levels.get(unit, _START)[-1] for unit in writes)])

    def _take_along(self, move: Move) -> None:
        place_of = self.system.place_of
        taken = [(self._module_at.get(place_of(source)), to) for source, to in move.motion]
        places = dict.fromkeys(place_of(site) for site in move.action.trace)
        for place in places:
            self.places.setdefault(
                place, [There(self._start[0].get(place), self._start[1].get(place), 0)]
            )
            self._standing.pop(place, None)
            self._module_at.pop(place, None)
        for module, target in taken:
            self._standing[place_of(target)] = target
            if module is not None:
                self._module_at[place_of(target)] = module
                self.sites[module] = target
        for place in places:
            module = self._module_at.get(place)
            since = 0 if module is None else len(self.modules[module])
            self.places[place].append(There(self._standing.get(place), module, since))

    def _count(self, reads: frozenset[Site], writes: frozenset[Site], level: int) -> None:
        for unit in reads | writes:
            self.shows.setdefault(unit, [self._at_start(unit)])
            self.reads.setdefault(unit, [0])
            self.levels.setdefault(unit, [0])
            self.read_levels.setdefault(unit, [0])
        for unit in reads:
            self.reads[unit][-1] += 1
            self.read_levels[unit][-1] = max(level, self.read_levels[unit][-1])
        for unit in writes:
            self.shows[unit].append(on_unit(self.system, unit, self._standing))
            self.reads[unit].append(0)
            self.levels[unit].append(level)
            self.read_levels[unit].append(0)

    def path(self) -> list[Carried]:
        """Return the moves in canonical order: by level, then by generator and place."""
        return sorted(
            self.carried,
            key=lambda each: (each.moved.level, each.move.generator, encode(each.moved.at)),
        )

    @property
    def actions(self) -> list[Action]:
        """Return the edge path in canonical order."""
        return [each.move.action for each in self.path()]


def users_of(known: _Unit, version: int) -> list[int]:
    """Return the commits that read a version or were guarded by it."""
    return [*known.readers.get(version, ()), *known.guards.get(version, ())]
