"""What a recorder does with messages on any keys where those of a run have rounds or levels."""

from collections.abc import Iterator, Sequence

import zenoh

from cubepath.coordinator.runs.asking import RunInfo
from cubepath.coordinator.tools.recorder.backlog import ReceivedMessage, RecordedMessage
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.cutting import MessageSelection
from cubepath.protocol.recordings.description import KEYS, KEYS_FORMAT
from cubepath.protocol.recordings.plain_messages import ATTACHMENT, DELETE


def about_keys(keys: str) -> RunInfo:
    """Return how a recording of these keys begins; InputError if they are no key expression."""
    try:
        zenoh.KeyExpr(keys)
    except zenoh.ZError:
        raise InputError(
            f"keys={keys}: no key expression, expected parts with / in between, as robot/**"
        ) from None
    return RunInfo("", KEYS_FORMAT, {KEYS: keys, "log_time": "wall"}, "")


class KeyTopics:
    """The topics of messages on any keys, which are their keys."""

    def __init__(self, topics: Sequence[str] = (), exclude: Sequence[str] = ()) -> None:
        """Record what `MessageSelection` takes."""
        self.has = MessageSelection(tuple(topics), tuple(exclude)).takes_topic

    def of(self, key: str) -> tuple[str, bool]:
        """Return the topic of a key, and whether it is recorded."""
        return key, self.has(key)


def stored_messages(topic: str, heard: ReceivedMessage) -> Iterator[RecordedMessage]:
    """Yield what stands in a recording for a message on any key: its attachment, and itself."""
    plain = heard.plain
    if plain is None:
        raise AssertionError("a message of a run")  # it has a round or a level
    if plain.attachment is not None:
        yield _stored(topic + ATTACHMENT, plain.attachment, heard)
    yield _stored(topic + DELETE if plain.deleted else topic, heard.data, heard)


def _stored(topic: str, data: bytes, heard: ReceivedMessage) -> RecordedMessage:
    plain, at = heard.plain, heard.wall_ns
    sent_ns = at if plain is None or plain.sent_ns is None else plain.sent_ns
    return RecordedMessage(topic, data, at, at, 0, sent_ns, None if plain is None else plain.put)
