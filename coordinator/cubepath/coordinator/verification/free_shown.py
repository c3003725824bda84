"""Whether what keepers show during a run, and report at its end, is what was there.

Part of `cubepath verify`.
"""

from array import array
from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.verification.findings import StageFailures
from cubepath.coordinator.verification.free_history import History
from cubepath.coordinator.verification.free_transcript import FreeTranscript
from cubepath.coordinator.verification.free_units import NO_SITE, unit_in
from cubepath.coordinator.verification.number_table import NumberTable
from cubepath.coordinator.verification.transcript import Fail
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.wire import free_messages as free
from cubepath.protocol.wire.keys import Tiles
from cubepath.protocol.wire.messages import encode

_Rows: TypeAlias = NDArray[np.int64] | NDArray[np.int32]


class VisibilityCheck:
    """Whether what was shown was there, and continues with the serial numbers of its tile."""

    def __init__(
        self, history: History, transcript: FreeTranscript, tiles: Tiles, fail: StageFailures
    ) -> None:
        self._history, self._transcript, self._tiles, self._fail = history, transcript, tiles, fail
        self._system, self._losses = history.system, transcript.losses
        self._changes: dict[str, NumberTable] = {}
        """By tile the hash of what each change has shown."""
        self._serials = Serials()

    def shows(self, where: Record, message: free.TileUpdate) -> None:
        """Check what is shown of a tile."""
        self._fail.position = 0, self._serials.begin(where, message)
        try:
            self._check(where, message)
        except NO_SITE as error:
            self._fail("place", f"{where}: {type(error).__name__}: {error}")

    def looks(self, where: Record, message: free.Requests) -> None:
        """Check who is asked for tiles."""
        for part in message.parts:
            if (
                isinstance(part, free.TileQuery)
                and self._tiles.keeper_of_tile(part.tile) != message.keeper
            ):
                self._fail.position = (2,)
                why = f"keeper_{message.keeper} does not have tile {part.tile}"
                self._fail("place", f"{where}: {why}")

    def _check(self, where: Record, message: free.TileUpdate) -> None:
        if self._tiles.keeper_of_tile(message.tile) != message.keeper:
            self._fail("place", f"{where}: keeper_{message.keeper} does not have this tile")
        if message.whole and (message.keeper, message.tile) not in self._transcript.looks:
            self._losses.lack(
                self._fail,
                "place",
                f"{where}: no request was for all of tile {message.tile}",
                excused=self._losses.of_processes or self._losses.resumed,
            )
        if not message.whole:
            content = hash(encode(message.parts))
            known = self._changes.setdefault(message.tile, NumberTable())
            if known.setdefault(message.serial, content) != content:
                self._fail("place", f"{where}: change {message.serial} was another before")
        if not message.parts and (message.serial or not message.whole):
            self._fail("place", f"{where}: change {message.serial} changes nothing")
        seen = set()
        for part in message.parts:
            place = part.place
            if place is None or not self._system.has_place(place) or place in seen:
                self._fail("place", f"{where}: {part.place!r} is no place, or shown twice")
                continue
            seen.add(place)
            if self._tiles.tile_of(place) != message.tile:
                self._fail("place", f"{where}: {site_text(place)} is not in tile {message.tile}")
            self._check_part(where, place, part)
            self._serials.take(place, part)

    def _check_part(self, where: Record, place: Site, part: free.PlaceState) -> None:
        there = self._history.at_place(place, part.version)
        name = f"{site_text(place)} at version {part.version}"
        if there is None:
            self._fail("place", f"{where}: there never was {name}")
            return
        site = part.site
        if (there.site, there.module) != (site, part.module):
            self._fail("place", f"{where}: {name} is shown as {part.site!r}")
            return
        if part.module is None:
            if part.note or part.module_version:
                self._fail("place", f"{where}: {name} is empty, and has a register")
        else:
            standing = self._history.module(part.module, part.module_version)
            if standing is None or (standing.since, standing.note) != (there.since, part.note):
                self._fail(
                    "place",
                    f"{where}: {name} shows another register than module_{part.module} had at"
                    f" version {part.module_version}",
                )
        self._check_reads(where, place, part)

    def _check_reads(self, where: Record, place: Site, part: free.PlaceState) -> None:
        for unit, version, reads in part.reads:
            known = None if unit is None else self._history.reads.get(unit)
            most = None if known is None or version >= len(known) else known[version]
            if unit is None or self._unit_place(unit) != place or most is None or reads > most:
                self._fail("place", f"{where}: {unit!r} at version {version}, read {reads} times")

    def _unit_place(self, unit: Site) -> Site:
        return unit if self._system.labels is not None else self._system.place_of(unit)

    def end(self) -> None:
        """Check what was shown of a place with other serial numbers."""
        for position, why in self._serials.wrong():
            self._fail.position = position
            self._fail("place", why)


class Serials:
    """What each change of a tile has shown of each place: some forty bytes for each."""

    def __init__(self) -> None:
        self._places: dict[Site, int] = {}
        self._tiles: dict[str, int] = {}
        self._topics: dict[str, int] = {}
        self._messages = array("i"), array("q"), array("i"), array("q")
        """Of each message its tile, its serial number, its topic, and which it is recorded."""
        self._parts = array("i"), array("i"), *(array("q") for _ in range(4))
        """Of each place shown its number, message, version, module or -1, its version, and hash."""

    def begin(self, record: Record, message: free.TileUpdate) -> int:
        """Begin with a message; return how many were before it."""
        values = (
            self._tiles.setdefault(message.tile, len(self._tiles)),
            message.serial,
            self._topics.setdefault(record.topic, len(self._topics)),
            record.sequence,
        )
        for column, value in zip(self._messages, values, strict=True):
            column.append(value)
        return len(self._messages[0]) - 1

    def take(self, place: Site, part: free.PlaceState) -> None:
        """Take what the message shows of a place."""
        places, messages, versions, modules, module_versions, hashes = self._parts
        places.append(self._places.setdefault(place, len(self._places)))
        messages.append(len(self._messages[0]) - 1)
        versions.append(part.version)
        modules.append(-1 if part.module is None else part.module)
        module_versions.append(part.module_version)
        hashes.append(hash(encode(part)))

    def wrong(self) -> Iterator[tuple[tuple[int, ...], str]]:
        """Yield what was shown otherwise before, and what goes back, with where that belongs."""
        tiles, serials, topics, sequences = map(np.asarray, self._messages)
        places, messages, *_ = columns = [np.asarray(each) for each in self._parts]
        names, sites, each_topic = list(self._tiles), list(self._places), list(self._topics)
        rank = np.argsort(np.argsort(names))
        rows = np.lexsort((messages, serials[messages], rank[tiles[messages]], places))
        place, message, version, module, module_version, content = (each[rows] for each in columns)
        tile, serial = tiles[message], serials[message]
        again = np.zeros(len(rows), np.bool_)
        again[1:] = _same(place) & _same(tile) & _same(serial)
        first = np.maximum.accumulate(np.where(again, 0, np.arange(len(rows))))
        for row in np.flatnonzero(content != content[first]).tolist():
            number = int(message[row])
            where = f"message {sequences[number]} ({each_topic[topics[number]]})"
            why = f"{site_text(sites[place[row]])} was shown otherwise before"
            yield (0, number), f"{where}: {why}"
        known = np.flatnonzero(~again)
        back = _same(place[known]) & (
            (np.diff(version[known]) < 0)
            | (_same(module[known]) & (np.diff(module_version[known]) < 0))
        )
        for row in known[np.flatnonzero(back) + 1].tolist():
            where = f"tile {names[tile[row]]}, change {serial[row]}"
            position = 3, int(rank[tile[row]]), int(serial[row]), int(message[row])
            yield position, f"{where}: {site_text(sites[place[row]])} goes back"


def _same(values: _Rows) -> NDArray[np.bool_]:
    """Return for all but the first whether they are as those before."""
    return np.equal(values[1:], values[:-1])


class Tails:
    """What keepers report of all their commits and units."""

    def __init__(
        self, history: History, transcript: FreeTranscript, tiles: Tiles, fail: Fail
    ) -> None:
        self._history, self._transcript, self._tiles, self._fail = history, transcript, tiles, fail
        self._last: dict[int, tuple[Record, free.CommitLog]] = {}

    def tail(self, where: Record, tail: free.CommitLog) -> None:
        """Check what a keeper reports of all its commits."""
        found = len(self._transcript.commits.serials(tail.keeper))
        if tail.serial > found:
            self._fail(
                "tails",
                f"{where}: keeper_{tail.keeper} has {tail.serial} commits, on record are {found}",
            )
        if len({unit for unit, *_ in tail.units}) < len(tail.units):
            self._fail("tails", f"{where}: a unit comes twice")
        for unit in tail.units:
            self._check_unit(where, unit)
            self._check_keeper(where, tail.keeper, unit_in(self._history.system, unit[0]))
        self._last[tail.keeper] = where, tail

    def end(self, keepers: int, *, whole: bool, open_end: bool) -> bool:
        """Check of a `whole` recording that the last tails fit its end; return whether they do.

        With an `open_end` that is not known for certain.
        """
        touched: dict[int, set[Site | None]] = {}
        for unit in self._history.reads:
            touched.setdefault(self._keeper_of(unit), set()).add(unit)
        odd = [
            why
            for keeper in range(keepers)
            for why in self._at_the_end(keeper, self._last.get(keeper), touched.get(keeper, set()))
        ]
        for why in odd if whole else ():
            self._transcript.losses.lack(self._fail, "tails", why, excused=open_end)
        return not odd

    def _at_the_end(
        self, keeper: int, last: tuple[Record, free.CommitLog] | None, touched: set[Site | None]
    ) -> Iterator[str]:
        """Yield what does not fit the end in the last tail of a keeper."""
        if last is None:
            yield f"keeper_{keeper} does not say how many commits it has"
            return
        where, tail = last
        if tail.serial != len(self._transcript.commits.serials(keeper)):
            yield f"{where}: there are later commits"
        if tail.prepared:
            yield f"{where}: {tail.prepared} attempts are under way at the end"
        else:
            yield from self._other_units(where, tail)
        # While it has commits left to report, a keeper reports no unit.
        if not tail.prepared and (not tail.parts or tail.parts[-1].serial == tail.serial):
            for unit in sorted(touched - {unit for unit, *_ in tail.units}, key=repr):
                yield f"{where}: it leaves out {site_text(unit)}"

    def _check_unit(self, where: Record, shown: tuple[Site, int, int, int, Site | None]) -> None:
        value, version, level, reads, site = shown
        history = self._history
        unit = unit_in(history.system, value)
        if unit is None or not history.at_unit(unit, version)[0]:
            self._fail("tails", f"{where}: {value!r} never had version {version}")
            return
        due = history.levels.get(unit, [0])[version], history.at_unit(unit, version)[1]
        most = history.reads.get(unit, [0])[version]
        if due != (level, site) or reads > most:
            self._fail("tails", f"{where}: {site_text(unit)} at version {version} is another")

    def _check_keeper(self, where: Record, keeper: int, unit: Site | None) -> None:
        if unit is not None and self._keeper_of(unit) != keeper:
            self._fail("tails", f"{where}: keeper_{keeper} does not have {site_text(unit)}")

    def _keeper_of(self, unit: Site) -> int:
        system = self._history.system
        return self._tiles.keeper_of(unit if system.labels is not None else system.place_of(unit))

    def _other_units(self, where: Record, tail: free.CommitLog) -> Iterator[str]:
        for unit, version, _, reads, _ in tail.units:
            known = None if unit is None else self._history.reads.get(unit)
            if known is not None and (version, reads) != (len(known) - 1, known[-1]):
                yield (
                    f"{where}: {unit!r} has version {version}, read {reads} times; derived are"
                    f" version {len(known) - 1}, read {known[-1]} times"
                )
