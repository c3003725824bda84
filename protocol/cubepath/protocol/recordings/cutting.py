"""Which messages of a recording are taken, and how recordings of one run are merged.

Messages keep their bytes, their times and their numbers, by which `merge_recordings` puts them
together again: parts of one file, or the recordings of several recorders. A cut recording says so
in its parameters. `merge_recordings` says which messages count as the same, and how they are
ordered.
"""

import contextlib
import heapq
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cached_property
from hashlib import blake2b
from itertools import chain, groupby
from math import ceil
from operator import attrgetter
from pathlib import Path
from typing import Self, TypeAlias

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.input_files import Source
from cubepath.protocol.core.output_files import unwritable, written_whole
from cubepath.protocol.recordings.description import ATTACHED, KEYS, PART
from cubepath.protocol.recordings.plain_messages import key_in
from cubepath.protocol.recordings.recording import Recording, read_undamaged
from cubepath.protocol.recordings.stored_messages import Record, round_of_data
from cubepath.protocol.recordings.writing import RecordingWriter, append, copy_to, refuse_source
from cubepath.protocol.scenes.toml import scene_to_toml

SPLIT, FILTERED, WHOLE = "split", "filtered", "whole_messages"
"""Parameters of what was cut from a recording: which part it is, what was taken, and how many
messages the recording had."""
CUTS = (SPLIT, FILTERED, WHOLE)


@dataclass(frozen=True)
class MessageSelection:
    """Which messages are taken: by topic, and by the range of their log times, ends included.

    A pattern has ``*``, ``?`` and ``[...]`` as file names have, and is held against the topic
    ``KIND/SENDER`` and against the kind alone; for messages on any keys against the key and its
    first part. Without `topics` all are taken; what `exclude`
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
            found = self._known[record.topic] = self.takes_topic(record.topic)
        return found

    def takes_topic(self, topic: str) -> bool:
        """Return whether messages on a topic are taken, at whatever time."""

        def match(patterns: tuple[str, ...]) -> bool:
            return any(_matches(topic, each) for each in patterns)

        return (not self.topics or match(self.topics)) and not match(self.exclude)

    def __str__(self) -> str:
        """Return what is taken, in words."""
        terms = [
            *(["topics " + " ".join(self.topics)] if self.topics else []),
            *(["without " + " ".join(self.exclude)] if self.exclude else []),
            *([] if self.first is None else [f"from {self.first}"]),
            *([] if self.until is None else [f"until {self.until}"]),
        ]
        return ", ".join(terms) or "everything"

    def of(self, recording: Recording) -> Iterator[Record]:
        """Yield the messages of a recording that are taken, in the order of writing."""
        # Chunks of other rounds are not read.
        rounds = None
        if self.first is not None or self.until is not None:
            rounds = range(self.first or 0, (1 << 64) if self.until is None else self.until + 1)
        return (each for each in recording.written(rounds=rounds) if self.keeps(each))


_NAMED = 20
"""An error names no more topics."""


def check_topics(recording: Recording, selection: MessageSelection, *, of: str = "topics") -> None:
    """Raise InputError if a pattern of topics matches no topic of the recording."""
    asked = [*((of, each) for each in selection.topics)]
    asked += [("exclude", each) for each in selection.exclude]
    topics = recording.topics() if asked else ()
    if recording.of_keys:
        kinds = sorted(set(map(key_in, topics)))
    else:
        kinds = sorted({topic.partition("/")[0] for topic in topics})
    for name, pattern in asked:
        if not any(_matches(topic, pattern) for topic in topics):
            near = did_you_mean(pattern, kinds)
            raise InputError(
                f"{recording.path}: {name} {pattern}: nothing on record matches{near}, expected"
                f" topics of {', '.join(kinds[:_NAMED]) or 'a recording with messages'}"
            )


def _matches(topic: str, pattern: str) -> bool:
    """Return whether a pattern matches a topic, its kind, or the key of an attachment."""
    names = topic, key_in(topic), topic.partition("/")[0]
    return any(fnmatchcase(name, pattern) for name in names)


def whole_of(recording: Recording) -> int | None:
    """Return how many messages the recording had that this was cut from; None if it is whole.

    It is whole too if it has as many.
    """
    stated = recording.parameters.get(WHOLE, "")
    if not (stated.isascii() and stated.isdigit() and len(stated) < 20):
        return None
    return int(stated) if int(stated) > len(recording.records) else None


def left_out(recording: Recording) -> int:
    """Return how many messages of the recording that this was cut from are not there."""
    whole = whole_of(recording)
    return 0 if whole is None else whole - len(recording.records)


def is_beginning(recording: Recording) -> bool:
    """Return whether the messages are numbered from 0 without gap, as a run begins."""
    return all(record.sequence == number for number, record in enumerate(recording.records))


def cut_notes(recording: Recording, notes: Mapping[str, str]) -> dict[str, str]:
    """Return the parameters of what is cut from a recording, which may be cut itself."""
    parameters = recording.parameters
    known = {key: f"{parameters[key]}; {notes[key]}" for key in notes if key in parameters}
    whole = parameters.get(WHOLE, str(len(recording.records)))
    return {**parameters, **notes, **known, WHOLE: whole}


PARTS_MAX = 1000
"""A recording is split into this many parts at most, so that their names have three digits."""
_NS = 1_000_000_000


def filter_recording(
    source: Recording | Source,
    out: Path | str,
    *,
    topics: Sequence[str] = (),
    exclude: Sequence[str] = (),
    first: int | None = None,
    until: int | None = None,
) -> int:
    """Write the messages of a recording that are asked for to another; return their number.

    `topics` and `exclude` are patterns of topics or kinds, `first` and `until` log times, both
    included. Scene, schedule and parameters are those of the recording; if something was left out,
    the parameters `filtered` and `whole_messages` say so. InputError if the source is damaged, if a
    pattern of `topics` matches nothing in the recording, if nothing is left, or if `out` exists or
    cannot be written.

    >>> filter_recording("logs/golden/hex-5.mcap", "reports.mcap", topics=["reports"], until=10)
    20
    >>> read_recording("reports.mcap").parameters["filtered"]
    'topics reports, until 10'
    """
    recording, out = read_undamaged(source), Path(out)
    selection = MessageSelection(tuple(topics), tuple(exclude), first, until)
    check_topics(recording, selection)
    count = sum(1 for _ in selection.of(recording))
    if not count:
        raise InputError(f"{recording.path}: {selection}: found no such message, expected some")
    notes = dict(recording.parameters)
    if count < len(recording.records):
        notes = cut_notes(recording, {FILTERED: str(selection)})
    refuse_source(recording, out)
    with written_whole(out) as stream, copy_to(stream, out, recording, notes) as writer:
        append(writer, selection.of(recording))
    return count


def split_recording(
    source: Recording | Source,
    folder: Path | str,
    *,
    parts: int | None = None,
    rounds: int | None = None,
    seconds: float | None = None,
    size: int | None = None,
) -> tuple[Path, ...]:
    """Split a recording into files of a folder, ``NAME-000.mcap`` and so on; return their paths.

    Each has a stretch of the messages, in order: `parts` of about the same number of messages; or
    this many `rounds` (or levels) each; or `seconds` of the wall clock; or at most `size` bytes as
    files. Exactly one of these is given. Each part says in its parameters which it is. InputError
    if the source is damaged, if there would be more than 1000 parts, or if a file exists or cannot
    be written; then no part is left behind.

    >>> [path.name for path in split_recording("logs/golden/hex-5.mcap", "parts", rounds=10)]
    ['hex-5-000.mcap', 'hex-5-001.mcap', 'hex-5-002.mcap']
    """
    recording, folder = read_undamaged(source), Path(folder)
    given = [each for each in (parts, rounds, seconds, size) if each is not None]
    if len(given) != 1 or not given[0] > 0:
        raise InputError("split: expected one of parts, rounds, seconds and size, more than 0")
    begins = _beginnings(recording, parts, rounds, seconds, size)
    stem = recording.path.name.removesuffix(".mcap")
    made: list[Path] = []
    records = enumerate(recording.records)
    ahead = next(records, None)
    with contextlib.ExitStack() as undo:
        undo.enter_context(_folder(folder))
        undo.callback(_remove, made)
        while ahead is not None or not made:
            if len(made) == PARTS_MAX:
                raise InputError(
                    f"{recording.path}: more than {PARTS_MAX} parts, expected larger ones"
                )
            out = folder / f"{stem}-{len(made):03}.mcap"
            refuse_source(recording, out)
            whole = f"{len(made) + 1} of {recording.path.name}"
            notes = cut_notes(recording, {SPLIT: whole})
            with written_whole(out) as stream, copy_to(stream, out, recording, notes) as writer:
                ahead = _fill(writer, ahead, records, begins)
            made.append(out)
        undo.pop_all()
    return tuple(made)


_Placed: TypeAlias = tuple[int, Record]
"""A message of a recording, and its place in it, from 0."""
_Begins = Callable[[RecordingWriter, int, Record], bool]
"""Says whether a part that is being written ends before a message."""


def _fill(
    writer: RecordingWriter, first: _Placed | None, records: Iterator[_Placed], begins: _Begins
) -> _Placed | None:
    """Write messages up to the first of the next part, which is returned."""
    for number, record in chain(() if first is None else (first,), records):
        if begins(writer, number, record) and writer.messages:
            return number, record
        append(writer, (record,))
    return None


def _beginnings(
    recording: Recording,
    parts: int | None,
    rounds: int | None,
    seconds: float | None,
    size: int | None,
) -> _Begins:
    if parts is not None:
        count = len(recording.records)
        if parts > max(count, 1):
            raise InputError(f"{recording.path}: cannot split {count} messages into {parts} parts")
        begins = {count * part // parts for part in range(1, parts)}
        return lambda _, number, __: number in begins
    if rounds is not None:
        if recording.parameters.get("log_time") == "wall" and recording.clock == "free":
            raise InputError(
                f"{recording.path}: its log time is the wall clock, expected seconds, not rounds"
            )
        # What comes before the first round belongs to it.
        return _Span(rounds, lambda record: max(record.round, 1))
    if seconds is not None:
        return _Span(max(1, int(seconds * _NS)), recording.received_ns)
    return lambda writer, _, record: _is_full(recording, writer, record, size or 0)


def _is_full(recording: Recording, writer: RecordingWriter, record: Record, size: int) -> bool:
    least = writer.size_with(record)
    full = least > size
    if full and not writer.messages:
        raise InputError(
            f"{recording.path}: a part of {size} bytes has no room for scene, parameters and"
            f" message {record.sequence}: expected at least {least} bytes"
            f" ({ceil(least / 1000) / 1000:g} MB)"
        )
    return full


class _Span:
    """Parts of equal spans from the first message of each on."""

    def __init__(self, span: int, of: Callable[[Record], int]) -> None:
        self._span = span
        self._of = of

    def __call__(self, writer: RecordingWriter, _: int, record: Record) -> bool:
        at = self._of(record)
        if not writer.messages:
            self._first = at
        return at >= self._first + self._span


@contextlib.contextmanager
def _folder(path: Path) -> Generator[None]:
    """Make a folder and those above it; if the block fails, take away those that are new."""
    new = [each for each in (path, *path.parents) if not each.exists()]
    try:
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unwritable(path, error) from None
        yield
    except BaseException:
        for each in new:
            with contextlib.suppress(OSError):  # others may have put something there
                each.rmdir()
        raise


def _remove(made: Iterable[Path]) -> None:
    for path in made:
        with contextlib.suppress(OSError):
            path.unlink()


_DIGEST_BYTES = 16
_OF_A_FILE = (PART, ATTACHED)
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
    578
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
    if first.of_keys:
        listed = (each.parameters.get(KEYS, "").split() for each in found)
        notes[KEYS] = " ".join(dict.fromkeys(chain.from_iterable(listed)))
    with written_whole(out) as stream, copy_to(stream, out, first, notes) as writer:
        append(writer, records)
        return writer.messages


def _same_run(one: Recording, other: Recording) -> None:
    """Raise InputError, with the first difference, if two recordings are not of one run."""

    def refuse(what: str) -> None:
        raise InputError(f"{other.path}: {what} than in {one.path}: expected recordings of one run")

    if one.format != other.format:
        refuse("another format")
    if not one.of_keys and scene_to_toml(one.scene) != scene_to_toml(other.scene):
        refuse("another scene")
    if one.schedule != other.schedule:
        refuse("another schedule")
    for key in sorted({*one.parameters, *other.parameters} - {*CUTS, *_OF_A_FILE, KEYS}):
        mine, theirs = one.parameters.get(key), other.parameters.get(key)
        if mine != theirs:
            refuse(f"{key}={theirs!r}, other")


def _of_one_file(found: Sequence[Recording], notes: Mapping[str, str]) -> dict[str, str]:
    """Return parameters without those that describe each file: together they begin with the first.

    InputError if one of them is no number.
    """
    kept = {key: value for key, value in notes.items() if key not in _OF_A_FILE}
    begins = [each.parameters.get(ATTACHED) for each in found]
    known = [each for each in begins if each is not None]
    for each in known:
        if not (each.isascii() and each.isdigit()):
            raise InputError(f"{ATTACHED}={each!r}: expected a round")
    return kept | ({ATTACHED: min(known, key=int)} if None not in begins else {})


def _notes(found: Sequence[Recording], count: int) -> dict[str, str]:
    """Return the parameters of the parts of one recording together."""
    parameters = dict(found[0].parameters)
    wholes = {each.parameters.get(WHOLE, str(len(each.records))) for each in found}
    if wholes == {str(count)} or WHOLE not in parameters:
        return {key: value for key, value in parameters.items() if key not in CUTS}
    parts = dict.fromkeys(each.parameters.get(SPLIT, "") for each in found)
    if SPLIT in parameters:
        parameters[SPLIT] = " and ".join(filter(None, parts))
    return parameters


def _by_number(found: Sequence[Recording]) -> Iterator[Record]:
    """Return the messages in the order of their numbers, each once."""
    return (next(same) for same in _alike(found))


def _alike(found: Sequence[Recording]) -> Iterator[Iterator[Record]]:
    """Yield the messages of each number, in the order of numbers."""
    number = attrgetter("sequence")
    return (same for _, same in groupby(heapq.merge(*map(_numbered, found), key=number), number))


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
    count = 0
    for first, *others in _alike(found):
        if any(other != first for other in others):
            return None
        count += 1
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
        return Counter(map(self.digest, self.recording.records))

    def digest(self, record: Record) -> bytes:
        """Return a digest by which a message is the same as one of another recorder.

        On any keys senders repeat themselves, but a router that stamps messages stamps each once.
        """
        found = blake2b(record.topic.encode(), digest_size=_DIGEST_BYTES)
        found.update(b"\0")
        if self.recording.of_keys:
            found.update(b"%d\0" % record.wall_ns)
        found.update(record.data)
        return found.digest()

    def overlaps(self, other: Self) -> bool:
        """Return whether both may have heard the same messages."""
        if self.recording.of_keys:  # a timestamp says more than when somebody came to read it
            return True
        return self.times[0] <= other.times[1] and other.times[0] <= self.times[1]


def _one_run(files: Sequence[_Heard]) -> None:
    """Raise InputError if what the coordinator says of a round is not the same in all files."""
    known: dict[tuple[str, int | None], tuple[_Heard, bytes]] = {}
    for file in files if not files[0].recording.of_keys else ():
        own: dict[tuple[str, int | None], tuple[_Heard, bytes]] = {}
        for record in file.recording.of_kind("edges", "summary"):
            # The log time of edges is another where they were written at the end.
            key = record.kind, 0 if record.kind == "summary" else round_of_data(record.data)
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
        latest = max(latest, file.recording.received_ns(record))
        if others:
            digest = file.digest(record)
            seen[digest] += 1
            if any(other[digest] >= seen[digest] for other in others):
                continue
        yield latest, record
