"""Where modules stand at a place of a recording, as far as what was written before it tells.

With rounds that is the end of the last round of which all reports were written, and only the chunks
with that round are read; in a recording that begins on the way, the state in which its first whole
round began. Without rounds it is what all commits so far have made of the start; snapshots on the
way spare reading them again.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass

from cubepath.coordinator.playback.reel import START, Mark, Reel
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.recordings.records import Record
from cubepath.protocol.wire.free_messages import Moved, Tail, decode_free
from cubepath.protocol.wire.messages import Report, decode, parts_of

_REPORTS = frozenset({"reports"})
_COMMITS = frozenset({"moved", "tail"})
_SNAPSHOT_CHUNKS = 8


@dataclass(frozen=True, slots=True)
class StateAt:
    """Where modules stand; `step` is the last round that is over, or the greatest level."""

    step: int
    sites: tuple[Site, ...]
    """The site of module 0, 1, ..."""
    on: frozenset[Site]
    """All sites that are on, occupied obstacles included."""
    reports: tuple[Report, ...] = ()
    """What was reported of the next round before this place."""


class States:
    """The states of one recording."""

    def __init__(self, reel: Reel) -> None:
        """Read nothing yet."""
        self._reel = reel
        self._scene = reel.recording.scene
        start = tuple((site, 0) for site in self._scene.start)
        self._snapshots: list[tuple[Mark, int, tuple[tuple[Site, int], ...]]] = [(START, 0, start)]

    def at(self, mark: Mark) -> StateAt:
        """Return the state at a mark; InputError if what tells of it is malformed."""
        free = self._reel.recording.clock == "free"
        return self._after_commits(mark) if free else self._after_reports(mark)

    def _state(self, step: int, sites: tuple[Site, ...], reports: tuple[Report, ...]) -> StateAt:
        on = (self._scene.start_state - frozenset(self._scene.start)) | frozenset(sites)
        return StateAt(step, sites, on, reports)

    # With rounds.

    def _after_reports(self, mark: Mark) -> StateAt:
        modules = len(self._scene.start)
        found: dict[int, dict[int, Report]] = {}
        for where, record in self._reel.backward(mark):
            if record.kind in _REPORTS:
                for report in self._reports_in(record):
                    if report.module < modules:
                        found.setdefault(report.round, {})[report.module] = report
            # A chunk is done with: may the last whole round of it still be outdone by an earlier?
            if where.place == 0:
                whole = [number for number, each in found.items() if len(each) == modules]
                if whole and self._none_later_before(where.chunk, max(whole), found):
                    return self._of_reports(max(whole), found)
        whole = [number for number, each in found.items() if len(each) == modules]
        return self._of_reports(max(whole), found) if whole else self._before_the_first(mark, found)

    def _before_the_first(self, mark: Mark, found: dict[int, dict[int, Report]]) -> StateAt:
        """Return the state before the first whole round, which is the first if all is on record."""
        modules = len(self._scene.start)
        told = {number: dict(each) for number, each in found.items()}
        each = self._reel.next(mark, _REPORTS)
        while each is not None:
            where, record = each
            for report in self._reports_in(record) if record.kind in _REPORTS else ():
                known = told.setdefault(report.round, {})
                known[report.module] = report
                if len(known) == modules and report.round > 1:
                    sites = tuple(site_from_json(known[n].before) for n in range(modules))
                    begun = tuple(one for _, one in sorted(found.get(report.round, {}).items()))
                    return self._state(report.round - 1, sites, begun)
                if len(known) == modules:
                    return self._of_reports(0, found)
            each = self._reel.next(Mark(where.chunk, where.place + 1), _REPORTS)
        return self._of_reports(0, found)

    def _none_later_before(
        self, chunk: int, number: int, found: dict[int, dict[int, Report]]
    ) -> bool:
        reel = self._reel
        if not reel.by_wall:
            return reel.last_round_before(chunk) <= number
        return chunk == 0 or number == max(found) or len(found) > _SNAPSHOT_CHUNKS

    def _of_reports(self, number: int, found: dict[int, dict[int, Report]]) -> StateAt:
        if number:
            sites = tuple(site_from_json(each.site) for _, each in sorted(found[number].items()))
        else:
            sites = self._scene.start
        following = found.get(number + 1, {})
        return self._state(number, sites, tuple(each for _, each in sorted(following.items())))

    def _reports_in(self, record: Record) -> list[Report]:
        try:
            return [each for each in parts_of(decode(record.data)) if isinstance(each, Report)]
        except CubepathError as error:
            raise self._malformed(record, error) from None

    # Without rounds.

    def _after_commits(self, mark: Mark) -> StateAt:
        place = bisect_right(self._snapshots, mark, key=lambda each: each[0]) - 1
        at, level, known = self._snapshots[place]
        modules = dict(enumerate(known))
        each = self._reel.next(at, _COMMITS)
        while each is not None and each[0] < mark:
            where, record = each
            if where.chunk >= self._snapshots[-1][0].chunk + _SNAPSHOT_CHUNKS:
                now = Mark(where.chunk, 0)
                self._snapshots.append((now, level, tuple(modules[n] for n in sorted(modules))))
            for moved in self._commits_in(record):
                level = max(level, moved.level)
                for module, _, to, version in moved.motion:
                    if module in modules and version > modules[module][1]:
                        modules[module] = site_from_json(to), version
            each = self._reel.next(Mark(where.chunk, where.place + 1), _COMMITS)
        return self._state(level, tuple(modules[number][0] for number in sorted(modules)), ())

    def _commits_in(self, record: Record) -> list[Moved]:
        if record.kind not in _COMMITS:
            return []
        try:
            message = decode_free(record.data)
        except CubepathError as error:
            raise self._malformed(record, error) from None
        if isinstance(message, Tail):
            return message.parts
        return [message] if isinstance(message, Moved) else []

    def _malformed(self, record: Record, error: CubepathError) -> InputError:
        where = f"{self._reel.recording.path}: message {record.sequence} ({record.topic})"
        return InputError(f"{where}: {error}")
