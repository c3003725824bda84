"""What was where at which version, derived from the start and the commits of keepers.

Part of `cubepath verify`. Commits are put in an order in which they can have happened, by the
versions that they name, and carried out one after another. The result is the site at every version
of every unit, and the place and the register of every module at its versions. It shares only the
catalogue and the tiles with a run. Commits are named by numbers; commits and versions are kept in
arrays.
"""

from __future__ import annotations

from array import array
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from heapq import heapify, heappop, heappush
from itertools import chain, groupby, pairwise
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.verification import free_units
from cubepath.coordinator.verification.free_transcript import commit_text
from cubepath.coordinator.verification.rounds import make, why_not
from cubepath.coordinator.verification.transcript import Fail
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.free_messages import Commit, Register
from cubepath.protocol.wire.messages import Executed, encode

READ, GUARD = -2, -1
"""What a commit does with a version, unless it ends it: then it counts who has read it."""


class AtVersion(NamedTuple):
    """The commits that touch a thing at one of its versions."""

    version: int
    readers: list[int]
    guards: list[int]
    writers: list[int]
    """Those that end it."""
    counted: list[int]
    """How many readers each of these counts."""


class UnitAccesses:
    """What commits touch, units or modules, at which versions: 24 bytes for each touch."""

    def __init__(self) -> None:
        self._numbers: dict[Hashable, int] = {}
        self._things, self._commits = array("i"), array("i")
        self._versions, self._what = array("q"), array("q")

    def add(self, thing: Hashable, version: int, what: int, commit: int) -> None:
        """Note that a commit touches a thing at a version; commits come in their order."""
        self._things.append(self._numbers.setdefault(thing, len(self._numbers)))
        self._versions.append(version)
        self._what.append(what)
        self._commits.append(commit)

    def sort(self) -> None:
        """Put all touches in order of things, as they were first touched, and of versions."""
        rows = (self._things, self._versions, self._what, self._commits)
        columns = [np.asarray(each) for each in rows]
        things, versions, what, _ = columns
        order = np.lexsort((np.minimum(what, 0), versions, things))
        for column in columns:
            column[:] = column[order]

    def __iter__(self) -> Iterator[tuple[Hashable, int, Iterator[AtVersion]]]:
        """Yield things, how many of their versions were ended, and each version in order."""
        things, begin = self._things, 0
        for name, number in self._numbers.items():
            end, ended, last = begin, 0, None
            while end < len(things) and things[end] == number:
                if self._what[end] >= 0 and self._versions[end] != last:
                    last = self._versions[end]
                    ended += 1
                end += 1
            yield name, ended, self._each_version(begin, end)
            begin = end

    def _each_version(self, begin: int, end: int) -> Iterator[AtVersion]:
        for version, places in groupby(range(begin, end), key=self._versions.__getitem__):
            found = AtVersion(version, [], [], [], [])
            for place in places:
                what, commit = self._what[place], self._commits[place]
                if what >= 0:
                    found.writers.append(commit)
                    found.counted.append(what)
                else:
                    (found.readers if what == READ else found.guards).append(commit)
            yield found

    def edges(self) -> Iterator[tuple[int, int]]:
        """Yield pairs of commits of which the first came before the second."""
        for _, _, versions in self:
            before = AtVersion(-2, [], [], [], [])
            for this in versions:
                users = [*this.readers, *this.guards]
                for writer in before.writers[:1] if before.version + 1 == this.version else ():
                    yield from ((writer, user) for user in (*users, *this.writers[:1]))
                for writer in this.writers[:1]:
                    yield from ((user, writer) for user in users)
                before = this


def in_order(count: int, edges: Iterable[tuple[int, int]]) -> tuple[array[int], int | None]:
    """Return an order of this many commits in which the first of each pair is before the second.

    Of those that can be next it has the least. Where pairs contradict each other the rest is left
    out, and the least that is left out is returned too.
    """
    firsts, seconds = array("i"), array("i")
    for one, two in edges:
        if one != two:
            firsts.append(one)
            seconds.append(two)
    first, second = np.asarray(firsts), np.asarray(seconds)
    begin = np.zeros(count + 1, np.int32)
    np.cumsum(np.bincount(first, minlength=count), out=begin[1:])
    before = array("i", np.bincount(second, minlength=count).astype(np.int32).tobytes())
    after = array("i", second[np.argsort(first, kind="stable")].tobytes())
    begins = array("i", begin.tobytes())
    ready = [number for number in range(count) if not before[number]]
    heapify(ready)
    found = array("i")
    while ready:
        number = heappop(ready)
        found.append(number)
        for each in after[begins[number] : begins[number + 1]]:
            before[each] -= 1
            if not before[each]:
                heappush(ready, each)
    if len(found) == count:
        return found, None
    return found, next(number for number in range(count) if before[number])


_START = [0]
_EMPTY: Register = []
_KEPT = 1 << 14


class ModuleVersion(NamedTuple):
    """A module at one of its versions: where it stands, and its register."""

    site: Site
    note: Register
    since: int
    """The version at which it came to this site."""


class Occupancy(NamedTuple):
    """What is at a place at one of its versions."""

    site: Site | None
    module: int | None
    since: int
    """The version at which the module came there."""


class LevelPath(NamedTuple):
    """The moves of a run in canonical order: by level, then by generator and place."""

    commits: NDArray[np.int32]
    levels: NDArray[np.int64]
    """The level of each as its commit has it."""
    modules: NDArray[np.int64]
    """The mover of each."""
    numbers: NDArray[np.int32]
    """Which of `known` each is."""
    known: Sequence[tuple[str, Site, Action]]
    """Each generator with its place, as recorded, and the action."""

    @property
    def actions(self) -> list[Action]:
        """The edge path."""
        return [self.known[number][2] for number in self.numbers.tolist()]

    def by_level(self) -> Iterator[tuple[int, list[Executed]]]:
        """Yield the moves level by level."""
        rows = zip(self.levels.tolist(), self.modules.tolist(), self.numbers.tolist(), strict=True)
        for level, group in groupby(rows, key=itemgetter(0)):
            yield level, [Executed(module, *self.known[each][:2]) for _, module, each in group]


@dataclass(slots=True)
class _Versions:
    """What was at a place, or of a module, by version; for what nothing is, -1."""

    site: array[int] = field(default_factory=lambda: array("i"))
    """Which of the sites."""
    module: array[int] = field(default_factory=lambda: array("i"))
    """The module at a place."""
    since: array[int] = field(default_factory=lambda: array("i"))
    """The version of the module at which it came there."""
    noted: array[int] = field(default_factory=lambda: array("i"))
    """The commit that wrote the register of a module."""
    own: array[int] = field(default_factory=lambda: array("i"))
    """The last commit of an attempt of a module itself."""


class History:
    """A run without rounds, derived; `fail` is called for each violation."""

    def __init__(self, scene: Scene, commits: Sequence[Commit], fail: Fail) -> None:
        """Order the commits and carry them out."""
        self.scene, self.system = scene, scene.system
        self.commits = commits
        self.state: set[Site] = set(scene.start) | scene.system.filled
        self.sites: list[Site] = list(scene.start)
        self.reads: dict[Site, array[int]] = {}
        """By unit how often each version was read."""
        self.levels: dict[Site, array[int]] = {}
        """By unit the level of the commit that wrote each version, 0 for the start."""
        self.read_levels: dict[Site, array[int]] = {}
        """By unit the greatest level of those that read each version."""
        self._fail = fail
        self._site_numbers: dict[Site, int] = {}
        self._each_site: list[Site] = []
        self._modules = [_Versions() for _ in scene.start]
        self._places: dict[Site, _Versions] = {}
        self._shows: dict[Site, array[int]] = {}
        """By unit the site that was on at each version, once it was touched."""
        self._standing = {scene.system.place_of(site): site for site in scene.start}
        self._module_at = {
            scene.system.place_of(site): module for module, site in enumerate(scene.start)
        }
        self._start = {**self._standing}, {**self._module_at}
        self._known: dict[tuple[str, bytes], int] = {}
        self._moves: list[tuple[str, Site, Action]] = []
        self._carried = array("i"), array("q"), array("q"), array("i")
        """The moves as they were carried out: commit, level, module, and which move it is."""
        self.units_of = lru_cache(maxsize=_KEPT)(partial(free_units.units_of, self.system))
        for module, site in enumerate(scene.start):
            _add(self._modules[module], site=self._number(site), since=0, noted=-1, own=-1)
        self.attempts = array("q"), array("q"), array("q")
        """Of which attempt each commit is: its number, its epoch, its module."""
        self.order = self._ordered()
        """The commits in an order in which they can have happened."""
        for number in self.order:
            self._carry_out(number)

    def _number(self, site: Site | None) -> int:
        if site is None:
            return -1
        number = self._site_numbers.setdefault(site, len(self._each_site))
        if number == len(self._each_site):
            self._each_site.append(site)
        return number

    def _site(self, number: int) -> Site | None:
        return None if number < 0 else self._each_site[number]

    # What is known of a version.

    def at_unit(self, unit: Site, version: int) -> tuple[bool, Site | None]:
        """Return whether a unit ever had a version, and the site that was on then."""
        known = self._shows.get(unit)
        if known is None:
            return version == 0, self._at_start(unit)
        if version >= len(known):
            return False, None
        return True, self._site(known[version])

    def at_place(self, place: Site, version: int) -> Occupancy | None:
        """Return what was at a place at a version; None if it never had it."""
        known = self._places.get(place)
        if known is None:
            standing, modules = self._start
            there = Occupancy(standing.get(place), modules.get(place), 0)
            return there if version == 0 else None
        if version >= len(known.site):
            return None
        module = known.module[version]
        site = self._site(known.site[version])
        return Occupancy(site, None if module < 0 else module, known.since[version])

    def module(self, module: int, version: int) -> ModuleVersion | None:
        """Return where a module stood at a version, and its register; None if it never had it."""
        if not 0 <= module < len(self._modules) or version >= len(self._modules[module].site):
            return None
        known = self._modules[module]
        site = self._each_site[known.site[version]]
        return ModuleVersion(site, self._note(module, known.noted[version]), known.since[version])

    def _note(self, module: int, commit: int) -> Register:
        if commit < 0:
            return _EMPTY
        return next(
            note
            for _, each, _, note in reversed(self.commits[commit].notes)
            if each == module and note is not None
        )

    def own_commit(self, module: int, version: int) -> Commit | None:
        """Return the last commit of a module's own attempts that changed it, up to a version."""
        number = self._modules[module].own[version]
        return None if number < 0 else self.commits[number]

    def _at_start(self, unit: Site) -> Site | None:
        return free_units.on_unit(self.system, unit, self._start[0])

    # An order in which all can have happened.

    def _ordered(self) -> array[int]:
        units, modules = UnitAccesses(), UnitAccesses()
        keepers, attempts = array("q"), self.attempts
        for number, moved in enumerate(self.commits):
            self._sort(number, moved, units, modules)
            keepers.append(moved.keeper)
            for column, value in zip(
                attempts, (moved.number, moved.epoch, moved.module), strict=True
            ):
                column.append(value)
        units.sort()
        modules.sort()
        self._check_versions(units, modules)
        edges = chain(units.edges(), modules.edges(), _in_turn(keepers, attempts))
        found, stuck = in_order(len(self.commits), edges)
        if stuck is not None:
            self._fail(
                "order",
                f"{commit_text(self.commits[stuck])} and others come each before the other by"
                " their versions, guards and numbers",
            )
        return found

    def _sort(self, number: int, moved: Commit, units: UnitAccesses, modules: UnitAccesses) -> None:
        def add(value: Site, version: int, what: int) -> None:
            unit = free_units.unit_in(self.system, value)
            if unit is None:
                self._fail("units", f"{commit_text(moved)}: {value!r} is no unit")
            else:
                units.add(unit, version, what, number)

        for value, version in moved.read:
            add(value, version, READ)
        for value, version, reads in moved.written:
            add(value, version, reads)
        for value, version in moved.guarded:
            add(value, version, GUARD)
        for module, version in free_units.changed_by(moved).items():
            modules.add(module, version - 1, 0, number)
        for module, version in free_units.held_by(moved).items():
            modules.add(module, version, READ, number)

    def _check_versions(self, units: UnitAccesses, modules: UnitAccesses) -> None:
        for unit, ended, versions in units:
            late: list[AtVersion] = []
            for at in versions:
                if at.writers:
                    what = site_text(unit)
                    self._check_one(what, at.version, at.writers, follows=at.version < ended)
                    self._check_readers(what, at)
                if at.version > ended:
                    late.append(at)
            seen = chain(((at, at.readers) for at in late), ((at, at.guards) for at in late))
            for at, users in seen:
                self._check_seen(site_text(unit), at.version, users)
        self._check_modules(modules)

    def _check_modules(self, modules: UnitAccesses) -> None:
        for module, ended, versions in modules:
            for at in versions:
                if at.writers:
                    follows, version = 0 <= at.version < ended, at.version + 1
                    self._check_one(f"module_{module}", version, at.writers, follows=follows)
        for module, ended, versions in modules:
            for at in versions:
                if at.version > ended:
                    self._check_seen(f"module_{module}", at.version, at.readers)

    def _check_one(self, what: str, version: int, users: list[int], *, follows: bool) -> None:
        first, *more = users
        if more:
            both = f"{commit_text(self.commits[first])} and {commit_text(self.commits[more[0]])}"
            self._fail("versions", f"version {version} of {what} is changed by both {both}")
        if not follows:
            name = commit_text(self.commits[first])
            self._fail("versions", f"{name}: version {version} of {what} follows on none")

    def _check_seen(self, what: str, version: int, users: list[int]) -> None:
        if users:
            name = commit_text(self.commits[users[0]])
            self._fail("versions", f"{name}: {what} never had version {version}")

    def _check_readers(self, what: str, at: AtVersion) -> None:
        recorded, found = at.counted[0], len(at.readers)
        if recorded != found:
            moved = self.commits[at.writers[0]]
            self._fail(
                "readers",
                f"{commit_text(moved)} counts {recorded} readers of version {at.version} of"
                f" {what}, on record are {found}",
            )

    # Carrying out.

    def _carry_out(self, number: int) -> None:
        moved = self.commits[number]
        if moved.generator is None:
            if moved.level or moved.read or moved.written or moved.motion or moved.guarded:
                self._fail("units", f"{commit_text(moved)} makes no move, expected registers alone")
        else:
            try:
                self._move(number, moved)
            except free_units.NO_SITE as error:
                self._fail("units", f"{commit_text(moved)}: {error}")
        contents = {module: note for _, module, _, note in moved.notes}
        moves = {module for module, *_ in moved.motion}
        for module in free_units.changed_by(moved):
            if not 0 <= module < len(self.sites):
                continue
            known = self._modules[module]
            _add(
                known,
                site=self._number(self.sites[module]),
                since=len(known.site) if module in moves else known.since[-1],
                noted=known.noted[-1] if contents.get(module) is None else number,
                own=number if moved.module == module else known.own[-1],
            )

    def _move(self, number: int, moved: Commit) -> None:
        move = self._named(moved)
        if move is None:
            self._fail("units", f"{commit_text(moved)}: no module makes {moved.generator!r} so")
            return
        self._check_motion(moved, move)
        reads, writes = self.units_of(move.action)
        recorded = [unit for unit, _ in moved.read], [u for u, *_ in moved.written]
        for what, due, found in (("reads", reads, recorded[0]), ("writes", writes, recorded[1])):
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
        key = move.generator, encode(moved.at)
        known = self._known.setdefault(key, len(self._moves))
        if known == len(self._moves):
            self._moves.append((move.generator, moved.at, move.action))
        for column, value in zip(
            self._carried, (number, moved.level, moved.module, known), strict=True
        ):
            column.append(value)

    def _named(self, moved: Commit) -> Move | None:
        """Return the move of a commit from where its module stands."""
        at = moved.at
        if not 0 <= moved.module < len(self.sites) or at is None:
            return None
        for move in self.system.moves(self.sites[moved.module]):
            if move is not None and (move.generator, move.at) == (moved.generator, at):
                return move
        return None

    def _check_motion(self, moved: Commit, move: Move) -> None:
        recorded = [(source, target) for _, source, target, _ in moved.motion]
        if recorded != list(move.motion) or moved.motion[0][0] != moved.module:
            self._fail("sites", f"{commit_text(moved)}: its motion is not that of its move")
            return
        for module, source, _, _ in moved.motion:
            if not 0 <= module < len(self.sites) or self.sites[module] != source:
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
            if place not in self._places:
                self._places[place] = _Versions()
                self._stands_at(place, self._start[0].get(place), self._start[1].get(place), 0)
            self._standing.pop(place, None)
            self._module_at.pop(place, None)
        for module, target in taken:
            self._standing[place_of(target)] = target
            if module is not None:
                self._module_at[place_of(target)] = module
                self.sites[module] = target
        for place in places:
            module = self._module_at.get(place)
            since = 0 if module is None else len(self._modules[module].site)
            self._stands_at(place, self._standing.get(place), module, since)

    def _stands_at(self, place: Site, site: Site | None, module: int | None, since: int) -> None:
        number = -1 if module is None else module
        _add(self._places[place], site=self._number(site), module=number, since=since)

    def _count(self, reads: frozenset[Site], writes: frozenset[Site], level: int) -> None:
        for unit in reads | writes:
            if unit not in self._shows:
                self._shows[unit] = array("i", [self._number(self._at_start(unit))])
                for each in (self.reads, self.levels, self.read_levels):
                    each[unit] = array("i", _START)
        for unit in reads:
            self.reads[unit][-1] += 1
            self.read_levels[unit][-1] = max(level, self.read_levels[unit][-1])
        for unit in writes:
            self._shows[unit].append(
                self._number(free_units.on_unit(self.system, unit, self._standing))
            )
            self.reads[unit].append(0)
            self.levels[unit].append(level)
            self.read_levels[unit].append(0)

    def path(self) -> LevelPath:
        """Return the moves in canonical order."""
        commits, levels, modules, numbers = (np.asarray(each) for each in self._carried)
        rank = np.zeros(len(self._known), np.int32)
        rank[[self._known[key] for key in sorted(self._known)]] = np.arange(len(self._known))
        order = np.lexsort((rank[numbers], levels))
        return LevelPath(commits[order], levels[order], modules[order], numbers[order], self._moves)


def _add(rows: _Versions, **values: int) -> None:
    for name, value in values.items():
        getattr(rows, name).append(value)


def _in_turn(keepers: Sequence[int], attempts: Sequence[array[int]]) -> Iterator[tuple[int, int]]:
    """Yield pairs of commits that a keeper made, or a module asked for, one after the other."""
    for number, (one, two) in enumerate(pairwise(keepers)):
        if one == two:
            yield number, number + 1
    modules = attempts[-1]
    order = np.lexsort([np.asarray(each) for each in attempts])
    for one, two in pairwise(order.tolist()):
        if modules[one] == modules[two]:
            yield one, two
