"""Which messages of a recording are taken, and what a recording says that was cut from another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean

if TYPE_CHECKING:
    from cubepath.protocol.recordings.recording import Recording
    from cubepath.protocol.recordings.records import Record

SPLIT, FILTERED, WHOLE = "split", "filtered", "whole_messages"
"""Parameters of what was cut from a recording: which part it is, what was taken, and how many
messages the recording had."""
CUTS = (SPLIT, FILTERED, WHOLE)


@dataclass(frozen=True)
class MessageSelection:
    """Which messages are taken: by topic, and by the range of their log times, ends included.

    A pattern has ``*``, ``?`` and ``[...]`` as file names have, and is held against the topic
    ``KIND/SENDER`` and against the kind alone. Without `topics` all are taken; what `exclude`
    matches is not.

    >>> kept = MessageSelection(topics=("report*",), first=2)
    >>> recording = read_recording("logs/golden/hex-5.mcap")
    >>> sum(kept.keeps(record) for record in recording.records)
    56
    """

    topics: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    first: int | None = None
    """The first log time: a round, or without rounds a level or nanoseconds."""
    until: int | None = None
    """The last one."""
    _known: dict[str, bool] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Refuse a range that holds nothing, and patterns that are none."""
        if self.first is not None and self.until is not None and self.first > self.until:
            raise InputError(f"from {self.first} until {self.until}: expected a range upwards")
        if "" in (*self.topics, *self.exclude):
            raise InputError("topics: found '', expected a pattern as reports/* or claim")

    def keeps(self, record: Record) -> bool:
        """Return whether a message is taken."""
        if (self.first is not None and record.round < self.first) or (
            self.until is not None and record.round > self.until
        ):
            return False
        found = self._known.get(record.topic)
        if found is None:
            found = self._known[record.topic] = self._takes(record.topic)
        return found

    def _takes(self, topic: str) -> bool:
        def match(patterns: tuple[str, ...]) -> bool:
            return any(_matches(topic, each) for each in patterns)

        return (not self.topics or match(self.topics)) and not match(self.exclude)

    def __str__(self) -> str:
        """Return what is taken, in words."""
        said = [
            *(["topics " + " ".join(self.topics)] if self.topics else []),
            *(["without " + " ".join(self.exclude)] if self.exclude else []),
            *([] if self.first is None else [f"from {self.first}"]),
            *([] if self.until is None else [f"until {self.until}"]),
        ]
        return ", ".join(said) or "everything"

    def of(self, recording: Recording) -> Iterator[Record]:
        """Yield the messages of a recording that are taken, in the order of writing."""
        # Chunks of other rounds are not read.
        rounds = None
        if self.first is not None or self.until is not None:
            rounds = range(self.first or 0, (1 << 64) if self.until is None else self.until + 1)
        return (each for each in recording.written(rounds=rounds) if self.keeps(each))


def check_topics(recording: Recording, selection: MessageSelection) -> None:
    """Raise InputError if a pattern of topics matches no topic of the recording."""
    asked = [*(("topics", each) for each in selection.topics)]
    asked += [("exclude", each) for each in selection.exclude]
    topics = recording.topics() if asked else ()
    kinds = sorted({topic.partition("/")[0] for topic in topics})
    for name, pattern in asked:
        if not any(_matches(topic, pattern) for topic in topics):
            near = did_you_mean(pattern, kinds)
            raise InputError(
                f"{recording.path}: {name} {pattern}: nothing on record matches{near}, expected"
                f" topics of {', '.join(kinds) or 'a recording with messages'}"
            )


def _matches(topic: str, pattern: str) -> bool:
    """Return whether a pattern matches a topic, or its kind."""
    return fnmatchcase(topic, pattern) or fnmatchcase(topic.partition("/")[0], pattern)


def whole_of(recording: Recording) -> int | None:
    """Return how many messages the recording had that this was cut from; None if it is whole.

    It is whole too if it has as many.
    """
    told = recording.parameters.get(WHOLE, "")
    if not (told.isascii() and told.isdigit() and len(told) < 20):
        return None
    return int(told) if int(told) > len(recording.records) else None


def left_out(recording: Recording) -> int:
    """Return how many messages of the recording that this was cut from are not there."""
    whole = whole_of(recording)
    return 0 if whole is None else whole - len(recording.records)


def is_beginning(recording: Recording) -> bool:
    """Return whether the messages are numbered from 0 without gap, as a run begins."""
    return all(record.sequence == number for number, record in enumerate(recording.records))


def cut_notes(recording: Recording, notes: Mapping[str, str]) -> dict[str, str]:
    """Return the parameters of what is cut from a recording, which may be cut itself."""
    told = recording.parameters
    known = {key: f"{told[key]}; {notes[key]}" for key in notes if key in told}
    whole = told.get(WHOLE, str(len(recording.records)))
    return {**told, **notes, **known, WHOLE: whole}
