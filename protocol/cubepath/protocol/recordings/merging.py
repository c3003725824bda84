"""Recordings of one run put together: parts of one file, or what several recorders have heard.

`merge_recordings` says what counts as the same message, and in what order all are.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import blake2b
from pathlib import Path

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import Source
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.recordings.cuts import CUTS, SPLIT, WHOLE
from cubepath.protocol.recordings.cutting import append, copy_to, refuse_source
from cubepath.protocol.recordings.logged import told_round
from cubepath.protocol.recordings.recording import Recording, read_undamaged
from cubepath.protocol.recordings.records import Record
from cubepath.protocol.scenes.toml import scene_to_toml

_DIGEST_BYTES = 16
_ATTACHED = "attached"
_OF_A_FILE = ("part", _ATTACHED)
"""What a recorder from outside says of each of its files: its number, and its first whole round."""


def merge_recordings(sources: Sequence[Recording | Source], out: Path | str) -> int:
    """Write recordings of one run as one recording; return the number of its messages.

    Parts of one recording, as `split_recording` and `filter_recording` make them, are put in the
    order of their numbers; a message that several parts have is written once. If nothing is missing
    then, the result has the messages and the parameters of the recording that they come from.

    Recordings that number messages differently were made by several recorders, or one after
    another. The messages are then in the order of the wall clock, those of each file in their own
    order, and are numbered anew. Where the times of two files overlap, messages with the same topic
    and the same bytes are the same message: the first of one file is that of the other, and so on.
    It is taken from the file that begins first.

    InputError if a file is damaged, if `out` exists or cannot be written, and if the recordings
    are of different runs: scenes, schedules, formats and parameters have to be the same, and what
    the coordinator says of a round has to be as well.

    >>> parts = split_recording("logs/golden/hex-5.mcap", "thirds", parts=3)
    >>> merge_recordings(parts[::-1], "whole.mcap")
    573
    """
    found = [read_undamaged(source) for source in sources]
    out = Path(out)
    if not found:
        raise InputError("merge: found no recording, expected some")
    first = found[0]
    for other in found[1:]:
        _same_run(first, other)
    for recording in found:
        refuse_source(recording, out)
    count = _numbered_alike(found)
    if count is None:
        files = sorted(map(_Heard, found), key=lambda file: file.times)
        _one_run(files)
        notes = {key: value for key, value in first.parameters.items() if key not in CUTS}
        records: Iterable[Record] = _by_time(files)
    else:
        notes = _notes(found, count)
        records = _by_number(found)
    notes = _of_one_file(found, notes)
    with written_whole(out) as stream, copy_to(stream, out, first, notes) as writer:
        append(writer, records)
        return writer.messages


def _same_run(one: Recording, other: Recording) -> None:
    """Raise InputError, with the first difference, if two recordings are not of one run."""

    def refuse(what: str) -> None:
        raise InputError(f"{other.path}: {what} than in {one.path}: expected recordings of one run")

    if one.format != other.format:
        refuse("another format")
    if scene_to_toml(one.scene) != scene_to_toml(other.scene):
        refuse("another scene")
    if one.schedule != other.schedule:
        refuse("another schedule")
    for key in sorted({*one.parameters, *other.parameters} - {*CUTS, *_OF_A_FILE}):
        mine, theirs = one.parameters.get(key), other.parameters.get(key)
        if mine != theirs:
            refuse(f"{key}={theirs!r}, other")


def _of_one_file(found: Sequence[Recording], notes: Mapping[str, str]) -> dict[str, str]:
    """Return parameters without what each file said of itself: together they begin with the first.

    InputError if one of them is no number.
    """
    kept = {key: value for key, value in notes.items() if key not in _OF_A_FILE}
    begins = [each.parameters.get(_ATTACHED) for each in found]
    known = [each for each in begins if each is not None]
    for each in known:
        if not (each.isascii() and each.isdigit()):
            raise InputError(f"{_ATTACHED}={each!r}: expected a round")
    return kept | ({_ATTACHED: min(known, key=int)} if None not in begins else {})


def _notes(found: Sequence[Recording], count: int) -> dict[str, str]:
    """Return the parameters of the parts of one recording together."""
    told = dict(found[0].parameters)
    wholes = {each.parameters.get(WHOLE, str(len(each.records))) for each in found}
    if wholes == {str(count)} or WHOLE not in told:
        return {key: value for key, value in told.items() if key not in CUTS}
    parts = dict.fromkeys(each.parameters.get(SPLIT, "") for each in found)
    if SPLIT in told:
        told[SPLIT] = " and ".join(filter(None, parts))
    return told


def _by_number(found: Sequence[Recording]) -> Iterator[Record]:
    """Yield the messages in the order of their numbers, each once."""
    last = -1
    for record in heapq.merge(*map(_numbered, found), key=lambda record: record.sequence):
        if record.sequence > last:
            last = record.sequence
            yield record


def _numbered(recording: Recording) -> Iterator[Record]:
    last = -1
    for record in recording.records:
        if record.sequence <= last:
            raise InputError(
                f"{recording.path}: message {record.sequence} stands after message {last},"
                " expected the order of writing"
            )
        last = record.sequence
        yield record


def _numbered_alike(found: Sequence[Recording]) -> int | None:
    """Return the number of messages by their numbers; None if one number has two messages."""
    last: Record | None = None
    count = 0
    for record in heapq.merge(*map(_numbered, found), key=lambda record: record.sequence):
        if last is not None and last.sequence == record.sequence:
            if last != record:
                return None
        else:
            count += 1
        last = record
    return count


@dataclass(frozen=True)
class _Heard:
    """What one recorder has heard."""

    recording: Recording

    @cached_property
    def times(self) -> tuple[int, int]:
        """Return the wall times of the first and the last message."""
        counts = self.recording.counts()
        return counts.first_wall_ns or 0, counts.last_wall_ns or 0

    @cached_property
    def messages(self) -> Counter[bytes]:
        """Return how often each message is there, by a digest."""
        return Counter(map(_digest, self.recording.records))

    def overlaps(self, other: _Heard) -> bool:
        """Return whether both were recording at some time."""
        return self.times[0] <= other.times[1] and other.times[0] <= self.times[1]


def _digest(record: Record) -> bytes:
    said = blake2b(record.topic.encode(), digest_size=_DIGEST_BYTES)
    said.update(b"\0")
    said.update(record.data)
    return said.digest()


def _one_run(files: Sequence[_Heard]) -> None:
    """Raise InputError if what the coordinator says of a round is not the same in all files."""
    known: dict[tuple[str, int | None], tuple[_Heard, bytes]] = {}
    for file in files:
        own: dict[tuple[str, int | None], tuple[_Heard, bytes]] = {}
        for record in file.recording.of_kind("edges", "summary"):
            # The log time of edges is another where they were written at the end.
            key = record.kind, 0 if record.kind == "summary" else told_round(record.data)
            before = known.get(key)
            if before is not None and (before[1] != record.data or not file.overlaps(before[0])):
                what = "summary" if record.kind == "summary" else f"edges of round {key[1]}"
                raise InputError(
                    f"{file.recording.path}: another {what} than in {before[0].recording.path}:"
                    " expected recordings of one run"
                )
            own[key] = file, record.data
        known |= own


def _by_time(files: Sequence[_Heard]) -> Iterator[Record]:
    """Yield the messages of several recorders in the order of the wall clock, each once."""
    streams = [_new_in(file, files[:number]) for number, file in enumerate(files)]
    merged = heapq.merge(*streams, key=lambda timed: timed[0])
    for number, (_, record) in enumerate(merged):
        yield replace(record, sequence=number)


def _new_in(file: _Heard, before: Sequence[_Heard]) -> Iterator[tuple[int, Record]]:
    """Yield the messages that no earlier file has, with wall times that never go back."""
    others = [other.messages for other in before if file.overlaps(other)]
    seen: Counter[bytes] = Counter()
    latest = 0
    for record in file.recording.records:
        latest = max(latest, record.wall_ns)
        if others:
            said = _digest(record)
            seen[said] += 1
            if any(other[said] >= seen[said] for other in others):
                continue
        yield latest, record
