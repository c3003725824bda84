"""Whether what keepers show, and tell at the end, is what was there.

Room: coordinator. Part of `cubepath verify`.
"""

from __future__ import annotations

from collections.abc import Iterator

from cubepath.coordinator.verification.free_history import History
from cubepath.coordinator.verification.free_losses import Losses
from cubepath.coordinator.verification.free_transcript import FreeTranscript
from cubepath.coordinator.verification.free_units import NO_SITE, unit_in
from cubepath.coordinator.verification.transcript import Fail, site_in
from cubepath.protocol.core.names import Json
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.wire.free_messages import Held, Shown, Shows, Tail
from cubepath.protocol.wire.tiles import Tiles


class Shownness:
    """What was shown of each place, by version."""

    def __init__(self, history: History, tiles: Tiles, fail: Fail) -> None:
        """Begin with nothing shown."""
        self._history, self._tiles, self._fail = history, tiles, fail
        self._system = history.system
        self._losses = Losses()
        self.versions: dict[Site, set[tuple[int, int]]] = {}
        """By place the versions of it and of its module that were ever shown."""
        self.place_versions: dict[Site, set[int]] = {}
        """By place the versions of it that were ever shown."""
        self._looks: set[tuple[int, str]] = set()
        self._changes: dict[tuple[str, int], Shows] = {}
        self._by_serial: dict[tuple[str, int, Site], Shown] = {}

    def check(self, transcript: FreeTranscript) -> None:
        """Check all that was shown."""
        self._losses = transcript.losses
        self._looks = {(keeper, look.tile) for _, keeper, look in transcript.looks}
        for where, message in transcript.shown:
            try:
                self._check(where, message)
            except NO_SITE as error:
                self._fail("shown", f"{where}: {type(error).__name__}: {error}")
        for where, keeper, held in transcript.held:
            try:
                self._check_held(where, keeper, held, transcript)
            except NO_SITE as error:
                self._fail("shown", f"{where}: {type(error).__name__}: {error}")
        for where, keeper, look in transcript.looks:
            if self._tiles.keeper_of_tile(look.tile) != keeper:
                self._fail("shown", f"{where}: keeper_{keeper} does not have tile {look.tile}")
        self._check_serials()

    def _take(self, place: Site, part: Shown) -> None:
        self.versions.setdefault(place, set()).add((part.version, part.module_version))
        self.place_versions.setdefault(place, set()).add(part.version)

    def _check_held(self, where: str, keeper: int, held: Held, transcript: FreeTranscript) -> None:
        """Check that what is held was asked for, and shows what was there."""
        name = held.module, held.epoch, held.number
        asked = transcript.holds.get(name)
        places = [part.place for part in held.parts]
        if asked is None or asked[0] != keeper or asked[1].places != places:
            self._losses.lack(
                self._fail,
                "shown",
                f"{where}: what is held for module_{held.module} was not asked for",
                excused=asked is None
                and (
                    self._losses.of_module(held.module)
                    or self._losses.before(held.module, held.epoch)
                ),
            )
        for part in held.parts:
            place = site_in(part.place)
            if place is None or not self._system.has_place(place):
                self._fail("shown", f"{where}: {part.place!r} is no place")
                continue
            if self._tiles.keeper_of(place) != keeper:
                self._fail("shown", f"{where}: keeper_{keeper} does not have {site_text(place)}")
            self._check_part(where, place, part)
            self._take(place, part)

    def _check(self, where: str, message: Shows) -> None:
        if self._tiles.keeper_of_tile(message.tile) != message.keeper:
            self._fail("shown", f"{where}: keeper_{message.keeper} does not have this tile")
        if message.whole and (message.keeper, message.tile) not in self._looks:
            self._losses.lack(
                self._fail,
                "shown",
                f"{where}: nobody has asked for all of tile {message.tile}",
                excused=self._losses.of_processes or self._losses.resumed,
            )
        if not message.whole:
            known = self._changes.setdefault((message.tile, message.serial), message)
            if known.parts != message.parts:
                self._fail("shown", f"{where}: change {message.serial} was another before")
        if not message.parts and (message.serial or not message.whole):
            self._fail("shown", f"{where}: change {message.serial} changes nothing")
        seen = set()
        for part in message.parts:
            place = site_in(part.place)
            if place is None or not self._system.has_place(place) or place in seen:
                self._fail("shown", f"{where}: {part.place!r} is no place, or shown twice")
                continue
            seen.add(place)
            if self._tiles.tile_of(place) != message.tile:
                self._fail("shown", f"{where}: {site_text(place)} is not in tile {message.tile}")
            self._check_part(where, place, part)
            self._take(place, part)
            before = self._by_serial.setdefault((message.tile, message.serial, place), part)
            if before != part:
                self._fail("shown", f"{where}: {site_text(place)} was shown otherwise before")

    def _check_part(self, where: str, place: Site, part: Shown) -> None:
        there = self._history.at_place(place, part.version)
        name = f"{site_text(place)} at version {part.version}"
        if there is None:
            self._fail("shown", f"{where}: there never was {name}")
            return
        site = None if part.site is None else site_in(part.site)
        if (there.site, there.module) != (site, part.module):
            self._fail("shown", f"{where}: {name} is shown as {part.site!r}")
            return
        if part.module is None:
            if part.note or part.module_version:
                self._fail("shown", f"{where}: {name} is empty, and has a register")
        else:
            standing = self._history.module(part.module, part.module_version)
            if standing is None or (standing.since, standing.note) != (there.since, part.note):
                self._fail(
                    "shown",
                    f"{where}: {name} shows another register than module_{part.module} had at"
                    f" version {part.module_version}",
                )
        self._check_reads(where, place, part)

    def _check_reads(self, where: str, place: Site, part: Shown) -> None:
        for value, version, reads in part.reads:
            unit = site_in(value)
            known = None if unit is None else self._history.reads.get(unit)
            most = None if known is None or version >= len(known) else known[version]
            if unit is None or self._unit_place(unit) != place or most is None or reads > most:
                self._fail("shown", f"{where}: {value!r} at version {version}, read {reads} times")

    def _unit_place(self, unit: Site) -> Site:
        return unit if self._system.labels is not None else self._system.place_of(unit)

    def _check_serials(self) -> None:
        """Check that versions grow with the serial numbers of a tile."""
        last: dict[Site, Shown] = {}
        for (tile, serial, place), part in sorted(
            self._by_serial.items(), key=lambda each: each[0][:2]
        ):
            known = last.get(place, part)
            if part.version < known.version or (
                part.module == known.module and part.module_version < known.module_version
            ):
                self._fail("shown", f"tile {tile}, change {serial}: {site_text(place)} goes back")
            last[place] = part


class Tails:
    """What keepers tell of all their commits and units."""

    def __init__(self, history: History, tiles: Tiles, fail: Fail) -> None:
        """Know what was derived."""
        self._history, self._tiles, self._fail = history, tiles, fail

    def check(
        self, transcript: FreeTranscript, keepers: int, *, whole: bool, open_end: bool
    ) -> bool:
        """Check all tails; of a `whole` recording those at the end must fit its end.

        With an `open_end` that is not known for certain. Return whether they fit it.
        """
        last: dict[int, tuple[str, Tail]] = {}
        for where, tail in transcript.tails:
            found = len(transcript.commits.get(tail.keeper, ()))
            if tail.serial > found:
                self._fail(
                    "tails",
                    f"{where}: keeper_{tail.keeper} has {tail.serial} commits, on record are"
                    f" {found}",
                )
            if len({site_in(unit) for unit, *_ in tail.units}) < len(tail.units):
                self._fail("tails", f"{where}: a unit comes twice")
            for unit in tail.units:
                self._check_unit(where, unit)
                self._check_keeper(where, tail.keeper, unit_in(self._history.system, unit[0]))
            last[tail.keeper] = where, tail
        odd = [
            why
            for keeper in range(keepers)
            for why in self._at_the_end(transcript, keeper, last.get(keeper))
        ]
        for why in odd if whole else ():
            transcript.losses.lack(self._fail, "tails", why, excused=open_end)
        return not odd

    def _at_the_end(
        self, transcript: FreeTranscript, keeper: int, last: tuple[str, Tail] | None
    ) -> Iterator[str]:
        """Yield what does not fit the end in the last tail of a keeper."""
        if last is None:
            yield f"keeper_{keeper} does not tell how many commits it has"
            return
        where, tail = last
        if tail.serial != len(transcript.commits.get(keeper, ())):
            yield f"{where}: there are later commits"
        if tail.prepared:
            yield f"{where}: {tail.prepared} attempts are under way at the end"
        else:
            yield from self._other_units(where, tail)

    def _check_unit(self, where: str, told: tuple[Json, int, int, int, Json]) -> None:
        value, version, level, reads, shown = told
        history = self._history
        unit = unit_in(history.system, value)
        site = None if shown is None else site_in(shown)
        if unit is None or not history.at_unit(unit, version)[0]:
            self._fail("tails", f"{where}: {value!r} never had version {version}")
            return
        due = history.levels.get(unit, [0])[version], history.at_unit(unit, version)[1]
        most = history.reads.get(unit, [0])[version]
        if due != (level, site) or reads > most:
            self._fail("tails", f"{where}: {site_text(unit)} at version {version} is another")

    def _check_keeper(self, where: str, keeper: int, unit: Site | None) -> None:
        system = self._history.system
        if unit is not None:
            place = unit if system.labels is not None else system.place_of(unit)
            if self._tiles.keeper_of(place) != keeper:
                self._fail("tails", f"{where}: keeper_{keeper} does not have {site_text(unit)}")

    def _other_units(self, where: str, tail: Tail) -> Iterator[str]:
        for value, version, _, reads, _ in tail.units:
            unit = site_in(value)
            known = None if unit is None else self._history.reads.get(unit)
            if known is not None and (version, reads) != (len(known) - 1, known[-1]):
                yield (
                    f"{where}: {value!r} has version {version}, read {reads} times; derived are"
                    f" version {len(known) - 1}, read {known[-1]} times"
                )
