"""Which messages of a recording are played, and on which keys."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from fnmatch import fnmatchcase
from functools import cache

import zenoh

from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.stored_messages import Record, kinds_of
from cubepath.protocol.wire.free_messages import decode_free, free_key
from cubepath.protocol.wire.keys import ROOT, key_of, topic_in_key
from cubepath.protocol.wire.messages import decode

SAID = ("bundle", "reports", "observations")
"""The kinds of messages that are put back."""
FREE_SAID = ("requests", "forwards", "replies", "tile", "commit", "turns", "commits")
"""The same of a run without rounds: what modules and keepers say."""
_NEEDED = {"lockstep": frozenset({"reports"}), "free": frozenset({"commit", "commits"})}
"""What a run is gathered from."""
_GLOB = frozenset("*?[")
_NOT_IN_KEYS = frozenset("*$?#")


def said_under(clock: str) -> tuple[str, ...]:
    """Return the kinds that are played unless something else is asked for."""
    return FREE_SAID if clock == "free" else SAID


class PlayedMessages:
    """The messages that are played: of some kinds, or on topics that match patterns.

    >>> recording = read_recording("logs/golden/hex-5.mcap")
    >>> some = PlayedMessages(recording, topics=["reports/*", "edges/*"], exclude=["*/*_[1-9]"])
    >>> sorted({record.topic for record in recording.records if some.takes(record)})
    ['edges/coordinator', 'reports/process_0']
    """

    def __init__(
        self,
        recording: Recording,
        *,
        kinds: Collection[str] | None = None,
        topics: Collection[str] = (),
        exclude: Collection[str] = (),
    ) -> None:
        """Take messages of `kinds`, or what matches one of `topics`, but nothing of `exclude`.

        Patterns are those of file names, over topics such as "reports/process_0"; one without a
        slash means all topics of a kind. InputError if nothing on record matches one of them, or if
        nothing is left to play.
        """
        said = said_under(recording.clock)
        stray = sorted(set(kinds or ()) - set(said))
        if stray:
            raise InputError(f"unknown kind {stray[0]!r}, expected some of {', '.join(said)}")
        kept = frozenset(said if kinds is None else kinds)
        there = recording.topics()
        taken = [_pattern("topics", each, there) for each in topics]
        left = [_pattern("exclude", each, there) for each in exclude]

        def takes(topic: str) -> bool:
            within = any(fnmatchcase(topic, each) for each in taken) if taken else None
            if within is None:
                within = topic.partition("/")[0] in kept
            return within and not any(fnmatchcase(topic, each) for each in left)

        self.takes_topic: Callable[[str], bool] = cache(takes)
        """Returns whether the messages on a topic are played."""
        self.kinds = _kinds_among(taken) if taken else kept
        """The kinds that can be among them; None if that is not known."""
        self.needed = _NEEDED[recording.clock]
        if kinds is None and there and not any(map(self.takes_topic, there)):
            named = ", ".join([*_named("topics", topics), *_named("exclude", exclude)])
            raise InputError(
                f"{named or recording.path}: leaves nothing to play, expected some topics of"
                f" {_kinds_in(there)}"
            )

    def takes(self, record: Record) -> bool:
        """Return whether a message is played."""
        return self.takes_topic(record.topic)


def _named(name: str, given: Collection[str]) -> list[str]:
    return [f"{name}={each}" for each in given]


def _pattern(name: str, text: str, there: Collection[str]) -> str:
    """Return a pattern of topics; InputError if nothing on record matches.

    Parts of batches are no topics.
    """
    if not text or any(each in text for each in "#$"):
        raise InputError(f"{name}={text}: expected topics such as 'reports/*' or 'bundle'")
    found = text if "/" in text else f"{text}/*"
    if there and not any(fnmatchcase(topic, found) for topic in there):
        raise InputError(
            f"{name}={found}: nothing on record matches, expected topics of {_kinds_in(there)}"
        )
    return found


def _kinds_in(topics: Collection[str]) -> str:
    return ", ".join(sorted({topic.partition("/")[0] for topic in topics}))


def _kinds_among(patterns: Sequence[str]) -> frozenset[str] | None:
    kinds = [each.partition("/")[0] for each in patterns]
    return None if any(_GLOB & set(kind) for kind in kinds) else frozenset(kinds)


class KeyMapping:
    """The keys on which messages are put: those that they had, in another run and remapped."""

    def __init__(self, recording: Recording, run: str, remap: Collection[str] = ()) -> None:
        """Put under ``cubepath/RUN``; each of `remap` is "FROM=TO".

        FROM is a topic, a key within the run, or how one begins, in whole parts; TO stands in its
        place, and is a key of its own outside the run if it begins with a slash. InputError if
        that is malformed, or the run is no part of a key.
        """
        check_run(run)
        self.run = run
        self.within = f"{ROOT}/{run}/"
        self._recording = recording
        self._free = recording.clock == "free"
        self._known = kinds_of(recording.clock)
        self.remap = tuple(_pair(each) for each in remap)

    def check_reach(self, *, private: bool) -> None:
        """Check that whoever plays may put on all keys; InputError if not.

        A private router lets nobody put on keys that are not those of a run.
        """
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
        for record in self._recording.records:
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

    def _plain(self, record: Record) -> str:
        if record.kind not in self._known:  # what other tools read
            return f"{ROOT}/{self.run}/{record.topic.strip('/')}"
        try:
            if self._free:
                return free_key(self.run, decode_free(record.data))
            return key_of(self.run, decode(record.data))
        except CubepathError as error:
            where = f"{self._recording.path}: message {record.sequence} ({record.topic})"
            raise InputError(f"{where}: {error}") from None

    def _remapped(self, topic: str, key: str) -> str:
        for old, new in self.remap:
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
