"""Messages as they are recorded, under either clock: their schemas, topics and parts."""

from collections.abc import Sequence
from typing import Any, TypeAlias

from cubepath.protocol.core.catalogue import schema_with_definitions
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.wire.free_messages import (
    FREE_KINDS,
    Attempt,
    Decision,
    Entered,
    EnterRequest,
    Forwarded,
    Forwards,
    Inquiry,
    PlaceState,
    Replies,
    Requests,
    Settled,
    TileQuery,
    TileUpdate,
    Turn,
    Turns,
    decode_free,
    free_sender,
    free_topic,
)
from cubepath.protocol.wire.keys import topic_of
from cubepath.protocol.wire.messages import KINDS, decode, encode, parts_of

_Part: TypeAlias = (
    Attempt
    | EnterRequest
    | TileQuery
    | Forwarded
    | Decision
    | Inquiry
    | Settled
    | Entered
    | PlaceState
    | Turn
)
SHOWN = "place"
"""The kind of the parts of `shows`, which need not say it."""


def schema_of(kind: str) -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of a kind of message, as recordings hold it.

    >>> schema_of("claim")["required"]
    ['kind', 'round', 'module', 'site', 'generator', 'at']
    """
    # Viewers want the top object itself, not a reference to it.
    top, definitions = schema_with_definitions({**KINDS, **FREE_KINDS}[kind])
    return {**top, "$defs": definitions} if definitions else top


def topic_in(data: bytes) -> str | None:
    """Return the topic of a message by what it says itself; None if it is none."""
    try:
        return topic_of(decode(data))
    except InputError:
        pass
    try:
        return free_topic(decode_free(data))
    except InputError:
        return None


def parts_in(kind: str, data: bytes) -> list[tuple[str, bytes]]:
    """Return topic and bytes of each part of a batch; InputError if it is none."""
    if kind in FREE_KINDS:
        return _free_parts(data)
    return [(topic_of(part), encode(part)) for part in parts_of(decode(data))]


def _free_parts(data: bytes) -> list[tuple[str, bytes]]:
    message = decode_free(data)
    parts: Sequence[_Part] = ()
    if isinstance(message, Requests | Forwards | Replies | TileUpdate | Turns):
        parts = message.parts
    sender = free_sender(message)
    found = []
    for part in parts:
        # A module speaks for itself, a keeper and a process for all that they have.
        speaker = (
            f"module_{part.module}" if isinstance(part, Attempt | EnterRequest | Turn) else sender
        )
        found.append((f"{part.__struct_config__.tag or SHOWN}/{speaker}", encode(part)))
    return found
