"""The messages of a recording, whole rounds at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cubepath.protocol.recordings.recording import Recording
    from cubepath.protocol.recordings.records import Record


def rounds_in_turn(recording: Recording) -> Iterator[Sequence[Record]]:
    """Yield the messages of some rounds at a time, in the order of rounds, each round whole.

    They come while the file is read, so that memory does not grow with it. Of a run without rounds
    all messages come at once: a commit of any level may be told again at the very end.
    """
    if recording.clock == "free":
        yield recording.records
        return
    pending: list[Record] = []
    for records, least in recording.blocks():
        pending += records
        ready = [record for record in pending if record.round < least]
        if ready:
            pending = [record for record in pending if record.round >= least]
            yield ready
    yield pending
