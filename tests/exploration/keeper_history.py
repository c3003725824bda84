"""What keepers have logged, in the order in which it happened: what the exploration compares with.

It is derived from the records alone, by other code than the keepers': one state of all sites, one
number of each version, and what was committed and refused.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from cubepath.agents.keepers.journal import Committed, Decided, JoinedRecord, Record
from cubepath.agents.keepers.keeper import Keeper, Name, name_of
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.core.system import System
from cubepath.protocol.wire.free_messages import Commit, Decision


class Known(NamedTuple):
    """A unit: how often written, at what level, how often this version was read, at what level."""

    version: int = 0
    level: int = 0
    reads: int = 0
    read_level: int = 0


class History(NamedTuple):
    """All that was logged, as far as it matters."""

    sites: tuple[Site, ...]
    """Where each module is."""
    epochs: tuple[int, ...]
    incarnations: tuple[int, ...]
    units: frozenset[tuple[Site, Known]]
    committed: frozenset[Name]
    refused: frozenset[Name]

    @classmethod
    def at(cls, system: System, start: Iterable[Site]) -> History:
        """Begin at a start state; the system is one whose units are its sites."""
        assert system.labels is None
        sites = tuple(start)
        zeros = (0,) * len(sites)
        return cls(sites, zeros, zeros, frozenset(), frozenset(), frozenset())

    def after(self, record: Record) -> History:
        """Return the history with another record, which must be one that may come."""
        match record:
            case Committed(decision=decision):
                assert decision.commit is not None
                return self._committed(decision.commit)
            case Decided(decision=decision):
                name = name_of(decision)
                if decision.commit is not None:
                    assert name in self.committed, f"{name} is told as committed, and was not"
                    return self
                assert name not in self.committed, f"{name} is refused after its commit"
                return self._replace(refused=self.refused | {name})
            case JoinedRecord(enter=enter):
                assert enter.incarnation > self.incarnations[enter.module], (
                    "an earlier incarnation comes later"
                )
                return self._replace(
                    incarnations=_with(self.incarnations, enter.module, enter.incarnation),
                    epochs=_with(self.epochs, enter.module, self.epochs[enter.module] + 1),
                )
            case _:
                return self

    def _committed(self, moved: Commit) -> History:
        name = (moved.module, moved.epoch, moved.number)
        assert name not in self.committed, f"{name} is committed twice"
        assert name not in self.refused, f"{name} is committed, and was refused"
        assert moved.epoch == self.epochs[moved.module], f"{name} is fenced off, and committed"
        units = dict(self.units)
        sites = self.sites
        for module, source, target, _ in moved.motion:
            assert sites[module] == site_from_json(source), f"{name}: nobody to take along"
            sites = (*sites[:module], site_from_json(target), *sites[module + 1 :])
        assert len({*sites}) == len(sites), f"{name}: two modules in one place"
        level = 1 + max(
            [
                0,
                *(units.get(_site(unit), Known()).level for unit, *_ in moved.read),
                *(
                    max(known.level, known.read_level)
                    for unit, *_ in moved.written
                    for known in (units.get(_site(unit), Known()),)
                ),
            ]
        )
        assert moved.level == level, f"{name}: level {moved.level}, expected {level}"
        for unit, version in (*moved.read, *moved.guarded):
            known = units.get(_site(unit), Known())
            assert version == known.version, f"{name}: version {version} of {unit!r} is gone"
        for unit, _ in moved.read:
            known = units.get(_site(unit), Known())
            units[_site(unit)] = known._replace(
                reads=known.reads + 1, read_level=max(level, known.read_level)
            )
        for unit, version, reads in moved.written:
            known = units.get(_site(unit), Known())
            assert (version, reads) == (known.version, known.reads), (
                f"{name}: version {version} of {unit!r} is written over, read {reads} times"
            )
            units[_site(unit)] = Known(version + 1, level)
        return self._replace(
            sites=sites, units=frozenset(units.items()), committed=self.committed | {name}
        )

    def check_told(self, decision: Decision) -> None:
        """Check that what a module is told was logged."""
        name = name_of(decision)
        if decision.commit is not None:
            assert name in self.committed, f"{name} is told as committed, and was not"
            return
        assert name not in self.committed, f"{name} is told as refused, and was committed"
        if decision.epoch == self.epochs[decision.module]:
            assert name in self.refused, f"{name} is told as refused, and that was not logged"

    def check_keeper(self, keeper: Keeper) -> None:
        """Check that what a keeper shows and has not locked is so."""
        known = dict(self.units)
        on = {site: module for module, site in enumerate(self.sites)}
        locked = {
            unit
            for (register, unit), owner in keeper._exclusive.items()
            if not register and owner >= 0  # what is only held shows what it is
        }
        for unit in {*keeper.units.units, *known, *on, *keeper.units.place_of.values()}:
            if keeper._tiles.keeper_of(unit) != keeper.me or unit in locked:
                continue
            occupant = keeper.units.occupant(unit)
            found = None if occupant is None else occupant.module
            assert found == on.get(unit), f"keeper {keeper.me} shows {found} at {unit!r}"
            if occupant is not None:
                fence = occupant.epoch, occupant.incarnation
                expected = self.epochs[occupant.module], self.incarnations[occupant.module]
                assert fence == expected, f"another fence at {unit!r}"
            if (False, unit) not in keeper._shared:
                held = keeper.units.unit(unit)
                values = Known(held.version, held.level, held.reads, held.read_level)
                assert values == known.get(unit, Known()), f"keeper {keeper.me}: {unit!r}"

    def check_all(self, keepers: Sequence[Keeper]) -> None:
        """Check that the keepers have all modules, each once, and every commit."""
        here = [module for keeper in keepers for module in keeper.units.place_of]
        assert sorted(here) == [*range(len(self.sites))], f"modules {sorted(here)} are there"
        assert sum(keeper.commits for keeper in keepers) == len(self.committed)


def _site(unit: object) -> Site:
    return site_from_json(unit)


def _with(values: tuple[int, ...], at: int, value: int) -> tuple[int, ...]:
    return (*values[:at], value, *values[at + 1 :])
