"""Recordings cut to other recordings: messages taken out, and the file split into parts.

Messages keep their bytes, their times and their numbers, by which `merging` puts them together
again. What is cut says so in its parameters.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from math import ceil
from pathlib import Path
from typing import IO

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import Source
from cubepath.protocol.core.output_files import same_file, unwritable, written_whole
from cubepath.protocol.recordings.cuts import FILTERED, SPLIT, Selection, check_topics, cut_notes
from cubepath.protocol.recordings.recording import Recording, read_undamaged
from cubepath.protocol.recordings.records import Record
from cubepath.protocol.recordings.writing import RecordingWriter, refuse_existing

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
    pattern of `topics` matches nothing on record, if nothing is left, or if `out` exists or cannot
    be written.

    >>> filter_recording("logs/golden/hex-5.mcap", "reports.mcap", topics=["reports"], until=10)
    20
    >>> read_recording("reports.mcap").parameters["filtered"]
    'topics reports, until 10'
    """
    recording, out = read_undamaged(source), Path(out)
    selection = Selection(tuple(topics), tuple(exclude), first, until)
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

    Each has a stretch of the messages, in order: `parts` of about the same number of messages;
    or so many `rounds` (or levels) each; or `seconds` of the wall clock; or at most `size` bytes
    as files. Exactly one of these is given. Each part says in its parameters which it is.
    InputError if the source is damaged, if there would be more than 1000 parts, or if a file
    exists or cannot be written; then no part is left behind.

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
    records: Iterator[Record] = iter(recording.records)
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


_Begins = Callable[[RecordingWriter, Record], bool]
"""Says whether a part that is being written ends before a message."""


def _fill(
    writer: RecordingWriter, first: Record | None, records: Iterator[Record], begins: _Begins
) -> Record | None:
    """Write messages up to the first of the next part, which is returned."""
    for record in chain(() if first is None else (first,), records):
        if begins(writer, record) and writer.messages:
            return record
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
            raise InputError(
                f"{recording.path}: has {count} messages, expected at most so many parts, not"
                f" {parts}"
            )
        share = _Share(count, parts)
        return lambda _, record: share.begins(record)
    if rounds is not None:
        if recording.parameters.get("log_time") == "wall" and recording.clock == "free":
            raise InputError(
                f"{recording.path}: its log time is the wall clock, expected seconds, not rounds"
            )
        # What comes before the first round belongs to it.
        return _Span(rounds, lambda record: max(record.round, 1))
    if seconds is not None:
        return _Span(max(1, int(seconds * _NS)), lambda record: record.wall_ns)
    return lambda writer, record: _is_full(recording, writer, record, size or 0)


def _is_full(recording: Recording, writer: RecordingWriter, record: Record, size: int) -> bool:
    full = writer.size_with(record.topic, len(record.data)) > size
    if full and not writer.messages:
        least = writer.size_with(record.topic, len(record.data))
        raise InputError(
            f"{recording.path}: a part of {size} bytes has no room for scene, parameters and"
            f" message {record.sequence}: expected at least {least} bytes"
            f" ({ceil(least / 1000) / 1000:g} MB)"
        )
    return full


class _Share:
    """Parts of equal numbers of messages, but for one."""

    def __init__(self, count: int, parts: int) -> None:
        self._ends = [count * part // parts for part in range(1, parts)]
        self._seen = 0

    def begins(self, _: Record) -> bool:
        begins = bool(self._ends) and self._seen == self._ends[0]
        if begins:
            self._ends.pop(0)
        else:
            self._seen += 1
        return begins


class _Span:
    """Parts of equal spans from the first message of each on."""

    def __init__(self, span: int, of: Callable[[Record], int]) -> None:
        self._span = span
        self._of = of

    def __call__(self, writer: RecordingWriter, record: Record) -> bool:
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


def refuse_source(recording: Recording, out: Path) -> None:
    """Raise InputError if a file to write is the recording itself, or exists already."""
    if same_file(out, recording.path):
        raise InputError(f"{out}: is the recording itself, expected another file to write to")
    refuse_existing(out)


def copy_to(
    stream: IO[bytes], out: Path, like: Recording, notes: Mapping[str, str]
) -> RecordingWriter:
    """Return a writer of a recording of the same run, with other parameters."""
    return RecordingWriter(
        out,
        like.scene,
        notes,
        like.schedule,
        stream=stream,
        written_as=like.format,
    )


def append(writer: RecordingWriter, records: Iterable[Record]) -> None:
    """Write messages as they stand, with their times and numbers."""
    for record in records:
        writer.write(
            record.topic,
            record.data,
            round_number=record.round,
            wall_ns=record.wall_ns,
            sequence=record.sequence,
        )
