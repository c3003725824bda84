"""The state of a run without rounds, from its commits alone, in plain dictionaries.

Commits come in the order in which they are logged, which is a legal path; each is checked against
all that came before.
"""

from __future__ import annotations

from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.free_messages import Attempt, Moved

Register = tuple[int, ...]


class Broken(Exception):  # noqa: N818 - named for what happened
    """Something does not hold: its kind, by which failures are the same, and one line."""

    def __init__(self, kind: str, detail: str) -> None:
        """Say what does not hold."""
        super().__init__(detail)
        self.kind = kind


def same(kind: str, what: str, found: object, expected: object) -> None:
    """Raise Broken if the two are not equal."""
    if found != expected:
        raise Broken(kind, f"{what}: found {found!r}, expected {expected!r}")


class FreeState:
    """Where everything is, and what every unit has seen."""

    def __init__(self, scene: Scene) -> None:
        """Begin at the start of the scene."""
        self.system = scene.system
        self.site: dict[int, Site] = dict(enumerate(scene.start))
        self.at: dict[Site, int] = {
            scene.system.place_of(site): module for module, site in self.site.items()
        }
        self.version: dict[int, int] = dict.fromkeys(self.site, 0)
        self.note: dict[int, Register] = dict.fromkeys(self.site, ())
        self.epoch: dict[int, int] = dict.fromkeys(self.site, 0)
        self.birth: dict[int, int] = dict.fromkeys(self.site, 0)
        self.places: dict[Site, int] = {}
        """How many moves have written a place."""
        self.units: dict[Site, tuple[int, int, int, int]] = {}
        """By unit its version and level, how often that was read, and by what level at most."""
        self.sites: dict[tuple[int, int], Site] = {
            (module, 0): site for module, site in self.site.items()
        }
        """Where a module was in each of its versions."""
        self.shown: dict[tuple[Site, int, int], tuple[Site | None, int | None, Register]] = {}
        """What was at a place, by its version and that of its module."""
        self.moves = 0
        for place in self.at:
            self._show(place)

    def _show(self, place: Site) -> None:
        module = self.at.get(place)
        if module is None:
            self.shown[place, self.places.get(place, 0), 0] = None, None, ()
        else:
            key = place, self.places.get(place, 0), self.version[module]
            self.shown[key] = self.site[module], module, self.note[module]

    @property
    def on(self) -> set[Site]:
        """Return the sites that are on."""
        return {*self.site.values(), *self.system.filled}

    def unit(self, unit: Site) -> tuple[int, int, int, int]:
        """Return version, level, reads and the level of these."""
        return self.units.get(unit, (0, 0, 0, 0))

    def shows(self, unit: Site) -> Site | None:
        """Return the site that is on at a unit."""
        place = unit if self.system.labels is not None else self.system.place_of(unit)
        module = self.at.get(place)
        site = None if module is None else self.site[module]
        return site if self.system.labels is not None or site == unit else None

    def born(self, module: int, birth: int) -> None:
        """Begin a module's next epoch."""
        if birth <= self.birth[module]:
            raise Broken("birth", f"module_{module} is born again with birth {birth}")
        self.birth[module] = birth
        self.epoch[module] += 1

    def commit(self, attempt: Attempt, moved: Moved) -> None:
        """Check a commit against everything before it, and carry it out."""
        module = attempt.module
        who = f"attempt {attempt.number} of module_{module} in epoch {attempt.epoch}"
        same("epoch", f"{who} is committed, epoch", attempt.epoch, self.epoch[module])
        same("place", f"{who}, site", site_from_json(attempt.site), self.site[module])
        for unit, expected in attempt.sensed:
            at = site_from_json(unit)
            on = None if expected is None else site_from_json(expected)
            same("sensed", f"{who}, what is on at {at!r}", self.shows(at), on)
        for place, expected, _ in attempt.notes:
            here = self.at.get(site_from_json(place))
            held = () if here is None else self.note[here]
            same("register", f"{who}, register at {place!r}", held, tuple(expected))
        for unit, version, reads in attempt.after:
            found = self.unit(site_from_json(unit))
            same("after", f"{who}, {unit!r}", (found[0], found[2]), (version, reads))
        move = None
        if attempt.generator is not None:
            move = self._move(attempt, who)
            self._touch(attempt, moved, move, who)
        else:
            same("level", f"{who}, level", moved.level, 0)
            same("versions", f"{who}, units", (moved.read, moved.written, moved.guarded), ([],) * 3)
        self._change(attempt, moved, move, who)

    def _move(self, attempt: Attempt, who: str) -> Move:
        site, at = self.site[attempt.module], site_from_json(attempt.at)
        for move in self.system.moves_at(site):
            if move.generator == attempt.generator and move.at == at:
                if not move.possible(self.on):
                    raise Broken("admissible", f"{who}: {move.generator} at {at!r} is not")
                return move
        raise Broken("admissible", f"{who}: there is no {attempt.generator} at {at!r}")

    def _touch(self, attempt: Attempt, moved: Moved, move: Move, who: str) -> None:
        system, action = self.system, move.action
        labels = system.labels is not None

        def units(sites: frozenset[Site]) -> set[Site]:
            there = (site for site in sites if system.has_place(system.place_of(site)))
            return {system.place_of(site) for site in there} if labels else {*there}

        writes = units(action.trace)
        reads = units(action.support) - writes
        guards = {site_from_json(unit) for unit, _ in attempt.sensed} - reads - writes
        known = {unit: self.unit(unit) for unit in (*reads, *writes, *guards)}
        found = {site_from_json(unit): version for unit, version in moved.read}
        same("versions", f"{who}, reads", found, {unit: known[unit][0] for unit in reads})
        found = {site_from_json(unit): version for unit, version in moved.guarded}
        same("guards", f"{who}, guards", found, {unit: known[unit][0] for unit in guards})
        wrote = {site_from_json(unit): (version, n) for unit, version, n in moved.written}
        expected = {unit: (known[unit][0], known[unit][2]) for unit in writes}
        same("versions", f"{who}, writes", wrote, expected)
        before = [known[unit][1] for unit in (*reads, *writes)]
        level = 1 + max([0, *before, *(known[unit][3] for unit in writes)])
        same("level", f"{who}, level", moved.level, level)
        for unit in reads:
            version, old, count, read = known[unit]
            self.units[unit] = version, old, count + 1, max(read, level)
        for unit in writes:
            self.units[unit] = known[unit][0] + 1, level, 0, 0
        self.moves += 1
        for place in writes if labels else {system.place_of(site) for site in writes}:
            self.places[place] = self.places.get(place, 0) + 1

    def _change(self, attempt: Attempt, moved: Moved, move: Move | None, who: str) -> None:
        """Move what is taken along, and write registers; what is said of both must agree."""
        place_of = self.system.place_of
        written = {
            self.at[place]: tuple(new)
            for at, _, new in attempt.notes
            for place in (site_from_json(at),)
            if new is not None and place in self.at
        }
        noted = [self.at.get(site_from_json(at)) for at, _, _ in attempt.notes]
        taken = [] if move is None else [(self.at[place_of(a)], a, b) for a, b in move.motion]
        for module in {*written, *(module for module, _, _ in taken)}:
            self.version[module] += 1
        motion = [
            (module, site_from_json(a), site_from_json(b), version)
            for module, a, b, version in moved.motion
        ]
        expected = [(module, a, b, self.version[module]) for module, a, b in taken]
        same("motion", f"{who}, motion", motion, expected)
        gone = {place_of(a) for _, a, _ in taken}
        for place in gone:
            del self.at[place]
        for module, _, target in taken:
            if place_of(target) in self.at:
                raise Broken("place", f"{who}: two modules at {target!r}")
            self.at[place_of(target)] = module
            self.site[module] = target
        self.note.update(written)
        registers = {
            module: (site_from_json(at), version, None if new is None else tuple(new))
            for at, module, version, new in moved.notes
        }
        same(
            "register",
            f"{who}, registers",
            registers,
            {
                module: (place_of(self.site[module]), self.version[module], written.get(module))
                for module in noted
                if module is not None
            },
        )
        for module in {*written, *(module for module, _, _ in taken)}:
            self.sites[module, self.version[module]] = self.site[module]
            gone.add(place_of(self.site[module]))
        for place in gone:
            self._show(place)
