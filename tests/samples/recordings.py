"""Real recordings, small and made once a session, and ways to tamper with them."""

import atexit
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from msgspec.structs import replace as with_fields

from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import run
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.wire.keys import topic_of
from cubepath.protocol.wire.messages import (
    Bundle,
    ChosenActions,
    Message,
    Observations,
    Reports,
    decode,
    encode,
    kind_of,
    parts_of,
)

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
    run(
        Plan(
            spec,
            rule,
            seed=seed,
            hesitate=hesitate,
            processes=processes,
            max_rounds=rounds,
            log=path,
        )
    )
    return read_recording(path)


def with_records(recording: Recording, records: Iterable[Record]) -> Recording:
    """Return the recording with other messages, in their order of writing."""
    kept = (replace(record, sequence=number) for number, record in enumerate(records))
    return replace(recording, records=tuple(kept))


def parts(recording: Recording, *kinds: str) -> list[Any]:
    """Return the messages of these kinds, among them what batches bring, in order; each once.

    A part that is said to several regions stands in several batches.
    """
    found = dict.fromkeys(
        encode(part)
        for record in recording.records
        for part in parts_of(decode(record.data))
        if not kinds or kind_of(part) in kinds
    )
    return [decode(data) for data in found]


def first(recording: Recording, kind: str, where: Where = lambda _: True) -> Any:
    """Return the first message of a kind of which `where` holds, a part of a batch or its own."""
    return next(message for message in parts(recording, kind) if where(message))


def record_of(message: Message, round_number: int | None = None) -> Record:
    """Return a message as it would stand in a recording."""
    number = message.round if round_number is None else round_number
    return Record(topic_of(message), encode(message), number, 0, 0)


def edited(recording: Recording, old: Message, *new: Message) -> Recording:
    """Return the recording with one message replaced by others, or by none.

    A part is replaced in every batch that brings it.
    """

    def edit(message: Any) -> list[Message]:
        return list(new) if message == old else [message]

    records = _edited(recording, edit)
    assert records != list(recording.records), "there is no such message"
    return with_records(recording, records)


def all_edited(recording: Recording, kind: str, edit: Edit) -> Recording:
    """Return the recording with every message of a kind as `edit` makes it; None drops it."""

    def each(message: Any) -> list[Message]:
        if kind_of(message) != kind:
            return [message]
        made = edit(message)
        return [] if made is None else [made]

    return with_records(recording, _edited(recording, each))


def _edited(recording: Recording, edit: Callable[[Any], list[Message]]) -> list[Record]:
    """Return the records with every message, or every part of it, as `edit` makes it."""
    records: list[Record] = []
    for record in recording.records:
        message: Any = decode(record.data)
        made = [each for part in parts_of(message) for each in edit(part)]
        if isinstance(message, Bundle | Reports | Observations | ChosenActions):
            made = [with_fields(message, parts=made)] if made != message.parts else [message]
            made = edit(made[0])
        if made == [message]:
            records.append(record)
        else:
            records += [record_of(each) for each in made]
    return records
