"""Real recordings, small and made once a session, and ways to tamper with them."""

from __future__ import annotations

import atexit
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from cubepath.coordinator.runs.launch import Plan, run
from cubepath.protocol.recordings.recording import Record, Recording, read_recording
from cubepath.protocol.wire.keys import topic_of
from cubepath.protocol.wire.messages import Message, decode, encode

Where = Callable[[Any], object]
Edit = Callable[[Any], Message | None]

_numbers = count()


@cache
def _folder() -> Path:
    folder = TemporaryDirectory(prefix="cubepath-recordings-")
    atexit.register(folder.cleanup)
    return Path(folder.name)


def new_path(suffix: str = ".mcap") -> Path:
    """Return the path of a file that is not there yet, in a folder that goes with the session."""
    return _folder() / f"{next(_numbers)}{suffix}"


@cache
def recorded(
    spec: str,
    rule: str = "random",
    *,
    seed: int = 0,
    hesitate: float = 0.0,
    processes: int = 0,
    rounds: int = 8,
) -> Recording:
    """Return the recording of a real run."""
    path = new_path()
    run(Plan(spec, rule, seed, hesitate, processes, rounds, path))
    return read_recording(path)


def with_records(recording: Recording, records: Iterable[Record]) -> Recording:
    """Return the recording with other messages, in their order of writing."""
    kept = (replace(record, sequence=number) for number, record in enumerate(records))
    return replace(recording, records=tuple(kept))


def first(recording: Recording, kind: str, where: Where = lambda _: True) -> Any:
    """Return the first message of a kind of which `where` holds."""
    return next(
        message for record in recording.of_kind(kind) if where(message := decode(record.data))
    )


def record_of(message: Message, round_number: int | None = None) -> Record:
    """Return a message as it would stand in a recording."""
    number = message.round if round_number is None else round_number
    return Record(topic_of(message), encode(message), number, 0, 0)


def edited(recording: Recording, old: Message, *new: Message) -> Recording:
    """Return the recording with one message replaced by others, or by none."""
    place = [decode(record.data) for record in recording.records].index(old)
    records = list(recording.records)
    records[place : place + 1] = [record_of(message) for message in new]
    return with_records(recording, records)


def all_edited(recording: Recording, kind: str, edit: Edit) -> Recording:
    """Return the recording with every message of a kind as `edit` makes it; None drops it."""
    records: list[Record] = []
    for record in recording.records:
        message = edit(decode(record.data)) if record.kind == kind else None
        if record.kind != kind:
            records.append(record)
        elif message is not None:
            records.append(record_of(message))
    return with_records(recording, records)
