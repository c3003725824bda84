"""Which messages of a recording are played, and what is gathered of them, segment by segment.

A segment begins at the start, or where the replay jumped to. A recording that begins in the middle
of its run, or has a hole, is gathered from its first whole round, whose reports say where the
modules stood. Without rounds, a state is the start with all commits so far applied; snapshots in
between save reading them again.
"""

from bisect import bisect_right
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Any

import zenoh
from msgspec.structs import replace as with_fields

from cubepath.coordinator.playback.replay_comparison import (
    MissingRounds,
    recorded_message,
    rounds_compared,
)
from cubepath.coordinator.playback.timeline import START, Cursor, Timeline
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.free_gatherer import FreeGatherer, keepers_in
from cubepath.coordinator.runs.gatherer import Gatherer
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.recordings.cutting import MessageSelection, check_topics
from cubepath.protocol.recordings.plain_messages import ATTACHMENT, key_in
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.stored_messages import Record, kinds_of
from cubepath.protocol.wire.free_messages import Commit, CommitLog, decode_free, free_key
from cubepath.protocol.wire.keys import ROOT, key_of, topic_in_key
from cubepath.protocol.wire.messages import Report, decode, parts_of

SAID = ("bundle", "reports", "observations")
"""The kinds of messages that are put back."""
FREE_SAID = ("requests", "forwards", "replies", "tile", "commit", "turns", "commits")
"""The same of a run without rounds: what modules and keepers say."""
_NEEDED = {"lockstep": frozenset({"reports"}), "free": frozenset({"commit", "commits"})}
"""What a run is gathered from."""
_NOT_IN_KEYS = frozenset("*$?#")


def said_under(clock: str) -> tuple[str, ...]:
    """Return the kinds that are played unless something else is asked for."""
    return FREE_SAID if clock == "free" else SAID


class PlayedMessages:
    """The messages that are played: what modules and keepers sent, or those on some topics.

    Of messages on any keys all are, with their attachments.

    >>> recording = read_recording("logs/golden/hex-5.mcap")
    >>> some = PlayedMessages(recording, topics=["reports/*", "edges/*"], exclude=["*/*_[1-9]"])
    >>> sorted({record.topic for record in recording.records if some.takes(record)})
    ['edges/coordinator', 'reports/process_0']
    """

    def __init__(
        self, recording: Recording, *, topics: Collection[str] = (), exclude: Collection[str] = ()
    ) -> None:
        """Take what matches one of `topics`, by default what is sent, but nothing of `exclude`.

        Patterns are those of `MessageSelection`. InputError if nothing in the recording matches one
        of them, or if nothing is left to play.
        """
        check_topics(recording, MessageSelection(tuple(topics), tuple(exclude)))
        kept = topics or (() if recording.of_keys else said_under(recording.clock))
        selection = MessageSelection(tuple(kept), tuple(exclude))
        self.takes: Callable[[Record], bool] = selection.keeps
        """Returns whether a message is played."""
        self.takes_topic = selection.takes_topic
        """Returns whether the messages on a topic are played."""
        there = recording.topics()
        self.kinds = frozenset(_kind(topic) for topic in there if self.takes_topic(topic))
        """The kinds that are among them."""
        self.needed = _NEEDED[recording.clock]
        if recording.of_keys:
            self.takes = lambda each: not each.topic.endswith(ATTACHMENT) and selection.keeps(each)
            self.needed = frozenset()
        if there and not self.kinds:
            named = ", ".join(
                f"{name}={each}"
                for name, several in (("topics", topics), ("exclude", exclude))
                for each in several
            )
            raise InputError(
                f"{named or recording.path}: leaves nothing to play, expected some topics of"
                f" {_kinds_in(there)}"
            )


def _kind(topic: str) -> str:
    return topic.partition("/")[0]


def _kinds_in(topics: Collection[str]) -> str:
    return ", ".join(sorted(set(map(_kind, topics))))


class KeyMapping:
    """The keys on which messages are put: those that they had, in another run and remapped."""

    def __init__(self, recording: Recording, run: str, remap: Collection[str] = ()) -> None:
        """Put under ``cubepath/RUN``; each of `remap` is "FROM=TO".

        FROM is a topic, a key within the run, or how one begins, in whole parts; TO stands in its
        place, and is a separate key outside the run if it begins with a slash. InputError if that
        is malformed, or the run is no part of a key.
        """
        check_run(run)
        self.run = run
        self.within = f"{ROOT}/{run}/"
        self._recording = recording
        self._free = recording.clock == "free"
        self._known = kinds_of(recording.clock)
        self.remap = tuple(_pair(each) for each in remap)

    def check_reach(self, *, private: bool) -> None:
        """Check that the player may publish on all keys; InputError if not.

        A private router lets nobody put on keys that are not those of a run.
        """
        if private and self._recording.of_keys:
            raise InputError(
                f"{self._recording.path}: messages on any keys, expected where your programs are:"
                " endpoint=ENDPOINT (--listen) for a router of its own, or connect=ENDPOINT"
                " (--connect) for yours"
            )
        for old, new in self.remap:
            if private and new.startswith("/") and not new.startswith(f"/{ROOT}/"):
                raise InputError(
                    f"remap={old}={new}: a private router has keys below {ROOT} alone, expected an"
                    " endpoint such as tcp/127.0.0.1:7447"
                )

    def check_remap(self, takes: Callable[[str], bool]) -> None:
        """Check that each of `remap` concerns a message that is played; InputError if not."""
        topics = self._recording.topics()
        played = [topic for topic in topics if takes(topic)]
        left = [each for each in self.remap if not any(_begins(one, each[0]) for one in played)]
        if not left:
            return
        # What is not a topic may be a key, which messages tell: of a region, for example.
        for record in () if self._recording.of_keys else self._recording.records:
            key = topic_in_key(self._plain(record)) if takes(record.topic) else ""
            left = [each for each in left if not _begins(key, each[0])]
            if not left:
                return
        old, new = left[0]
        raise InputError(
            f"remap={old}={new}: nothing that is played is on {old}, expected topics of"
            f" {_kinds_in(topics)}, or how keys begin"
        )

    def key(self, record: Record) -> str:
        """Return the key of a message; InputError with its place if it is malformed."""
        found = self._plain(record)
        return self._remapped(record.topic, found) if self.remap else found

    def key_of_topic(self, topic: str) -> str:
        """Return the key on which the messages of a topic are put, if they are on any keys."""
        return self._remapped(topic, key_in(topic))

    def _plain(self, record: Record) -> str:
        if self._recording.of_keys:
            return key_in(record.topic)
        if record.kind not in self._known:  # what other tools read
            return f"{ROOT}/{self.run}/{record.topic.strip('/')}"
        message: Any = recorded_message(self._recording, record)
        return (free_key if self._free else key_of)(self.run, message)

    def _remapped(self, topic: str, key: str) -> str:
        for old, new in self.remap:
            if self._recording.of_keys:
                if _begins(key, old):
                    return (new + key.removeprefix(old)).lstrip("/")
                continue
            for whole in (topic, topic_in_key(key)):
                if _begins(whole, old):
                    rest = new + whole.removeprefix(old)
                    return rest.lstrip("/") if new.startswith("/") else f"{ROOT}/{self.run}/{rest}"
        return key


def _begins(whole: str, beginning: str) -> bool:
    return whole == beginning or whole.startswith(f"{beginning}/")


def check_run(run: str) -> None:
    """Check that a name can be part of a key; InputError if not."""
    if not run or "/" in run or _NOT_IN_KEYS & set(run) or not run.isprintable():
        raise InputError(f"run={run}: expected a name without any of / * $ ? #")


def _pair(text: str) -> tuple[str, str]:
    old, equals, new = text.partition("=")
    if not (old and equals and new.strip("/")) or "=" in new:
        raise InputError(f"remap={text}: expected FROM=TO, as reports/process_0=reports/left")
    for each in (old, new.removeprefix("/")):
        try:
            whole = zenoh.KeyExpr(each)
        except zenoh.ZError:
            whole = None
        if whole is None or _NOT_IN_KEYS & set(each):
            raise InputError(f"remap={text}: {each!r} is no key: expected parts with / in between")
    return old, new


_REPORTS = frozenset({"reports"})
_COMMITS = frozenset({"commit", "commits"})
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


class RecordedStates:
    """The states of one recording."""

    def __init__(self, reel: Timeline) -> None:
        self._reel = reel
        self._scene = reel.recording.scene
        start = tuple((site, 0) for site in self._scene.start)
        self._snapshots: list[tuple[Cursor, int, tuple[tuple[Site, int], ...]]] = [
            (START, 0, start)
        ]

    def at(self, mark: Cursor) -> StateAt:
        """Return the state at a mark; InputError if what tells of it is malformed."""
        free = self._reel.recording.clock == "free"
        return self._after_commits(mark) if free else self._after_reports(mark)

    def _state(self, step: int, sites: tuple[Site, ...], reports: tuple[Report, ...]) -> StateAt:
        on = (self._scene.start_state - frozenset(self._scene.start)) | frozenset(sites)
        return StateAt(step, sites, on, reports)

    # With rounds.

    def _after_reports(self, mark: Cursor) -> StateAt:
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

    def _before_the_first(self, mark: Cursor, found: dict[int, dict[int, Report]]) -> StateAt:
        """Return the state before the first whole round, which is the first if all is recorded."""
        modules = len(self._scene.start)
        reports = {number: dict(each) for number, each in found.items()}
        each = self._reel.next(mark, _REPORTS)
        while each is not None:
            where, record = each
            for report in self._reports_in(record) if record.kind in _REPORTS else ():
                known = reports.setdefault(report.round, {})
                known[report.module] = report
                if len(known) == modules and report.round > 1:
                    sites = tuple(known[n].before for n in range(modules))
                    begun = tuple(one for _, one in sorted(found.get(report.round, {}).items()))
                    return self._state(report.round - 1, sites, begun)
                if len(known) == modules:
                    return self._of_reports(0, found)
            each = self._reel.next(Cursor(where.chunk, where.place + 1), _REPORTS)
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
            sites = tuple(each.site for _, each in sorted(found[number].items()))
        else:
            sites = self._scene.start
        following = found.get(number + 1, {})
        return self._state(number, sites, tuple(each for _, each in sorted(following.items())))

    def _reports_in(self, record: Record) -> list[Report]:
        message: Any = recorded_message(self._reel.recording, record)
        return [each for each in parts_of(message) if isinstance(each, Report)]

    # Without rounds.

    def _after_commits(self, mark: Cursor) -> StateAt:
        place = bisect_right(self._snapshots, mark, key=lambda each: each[0]) - 1
        at, level, known = self._snapshots[place]
        modules = dict(enumerate(known))
        each = self._reel.next(at, _COMMITS)
        while each is not None and each[0] < mark:
            where, record = each
            if where.chunk >= self._snapshots[-1][0].chunk + _SNAPSHOT_CHUNKS:
                now = Cursor(where.chunk, 0)
                self._snapshots.append((now, level, tuple(modules[n] for n in sorted(modules))))
            for moved in self._commits_in(record):
                level = max(level, moved.level)
                for module, _, to, version in moved.motion:
                    if module in modules and version > modules[module][1]:
                        modules[module] = to, version
            each = self._reel.next(Cursor(where.chunk, where.place + 1), _COMMITS)
        return self._state(level, tuple(modules[number][0] for number in sorted(modules)), ())

    def _commits_in(self, record: Record) -> list[Commit]:
        if record.kind not in _COMMITS:
            return []
        message = recorded_message(self._reel.recording, record)
        if isinstance(message, CommitLog):
            return message.parts
        return [message] if isinstance(message, Commit) else []


_OF_KEEPERS = ("commit/", "commits/", "turns/")


class SegmentComparison:
    """Gathers what arrives, and compares it with the record whenever a segment is over."""

    def __init__(self, recording: Recording, extent: MissingRounds) -> None:
        """Begin at the start of the run; InputError if the recording does not say of how many."""
        self._recording = recording
        self._extent = extent
        self.rounds: set[int] = set()
        """The rounds, or levels, whose moves were compared with those in the recording."""
        self._differences: dict[str, None] = {}
        self._begin()

    def _begin(self) -> None:
        self._free: FreeGatherer | None = None
        self._lockstep: Gatherer | None = None
        self.gathered: Gathered
        if self._recording.clock == "free":
            keepers = keepers_in(self._recording)
            self.gathered = self._free = FreeGatherer(self._recording.scene, keepers)
        else:
            self.gathered = self._lockstep = Gatherer(self._recording.scene)
        self._base = 0
        self.after = 0
        """After which round that counts which is `gathered`."""
        self.jumped = False
        """Whether it has jumped since the start."""
        self.resumed = False
        """Whether it was gathered anew where rounds are missing."""

    def take(self, key: str, data: bytes) -> None:
        """Take a message that has arrived; CheckError if it contradicts another."""
        try:
            self._take(topic_in_key(key), data)
        except CheckError as error:
            lockstep, where = self._lockstep, ""
            if lockstep is not None:
                where = f"round {self._base + lockstep.rounds + 1}: "
            raise CheckError(f"{self._recording.path}: {where}{error}") from None

    def _take(self, topic: str, data: bytes) -> None:
        if self._lockstep is not None:
            if topic.startswith("reports/"):
                for part in parts_of(decode(data)):
                    if isinstance(part, Report):
                        self._receive(self._lockstep, part)
        elif self._free is not None and topic.startswith(_OF_KEEPERS):
            self._free.take(decode_free(data))

    def _receive(self, gatherer: Gatherer, report: Report) -> None:
        if not self._base:
            gatherer.receive(report)
        elif report.round > self._base:
            gatherer.receive(with_fields(report, round=report.round - self._base))
        if self._extent.lacking:
            self._resume(gatherer)

    def _resume(self, gatherer: Gatherer) -> None:
        """Gather anew from the first round that is whole, if the one before it is not."""
        first = gatherer.ahead
        if first is None:
            return
        waiting = [each for each in gatherer.waiting() if each.round >= first]
        begun = sorted((each.module, each.before) for each in waiting if each.round == first)
        start = tuple(site for _, site in begun)
        self.end()
        self.resumed = True
        base, self._base = self._base, self._base + first - 1
        try:
            self._lockstep = Gatherer(replace(self._recording.scene, start=start))
        except InputError:  # where nobody can stand
            self._lockstep = None
            return
        self.gathered, self.after = self._lockstep, self._base
        for report in waiting:
            self._receive(self._lockstep, with_fields(report, round=report.round + base))

    def restart(self) -> None:
        """End the segment, and gather the run from its start again."""
        self.end()
        self._begin()

    def jump(self, state: StateAt) -> None:
        """End the segment, and begin another where modules stand like this."""
        self.end()
        self.jumped = True
        self._base = state.step
        self._free = None  # the versions of units are not known in the middle
        if self._recording.clock == "free":
            return
        try:
            self._lockstep = Gatherer(replace(self._recording.scene, start=state.sites))
        except InputError:  # a damaged recording can lack what led here
            self._lockstep = None
            return
        self.gathered, self.after = self._lockstep, self._base
        for report in state.reports:
            self._receive(self._lockstep, report)

    def end(self) -> None:
        """Compare the rounds of the segment that are whole."""
        if self._lockstep is not None and self._lockstep.rounds:
            found = rounds_compared(
                self._recording, self._lockstep, self._base, lacking=bool(self._extent.lacking)
            )
            self._differences |= dict.fromkeys(found.differences)
            self.rounds |= found.rounds

    def compared(self) -> tuple[str, ...]:
        """Return what differs from the record in the rounds of all segments so far."""
        self.end()
        return tuple(self._differences)
