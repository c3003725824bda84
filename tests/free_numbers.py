"""Messages of a run without rounds with the numbers that their senders give them."""

from __future__ import annotations

from collections.abc import Sequence

from cubepath.protocol.wire.free_messages import (
    Asks,
    FreeMessage,
    Passes,
    Rest,
    Shows,
    Tail,
    Tells,
    Turns,
    decode_free,
    free_sender,
)
from cubepath.protocol.wire.sayings import Sayings


def numbered(messages: Sequence[FreeMessage], processes: int = 2) -> list[FreeMessage]:
    """Return the messages with the numbers that their senders give, and the last of each."""
    sayings: dict[str, Sayings] = {}
    found: list[FreeMessage] = []
    for message in (*messages, *map(Rest, range(processes))):
        said = sayings.setdefault(free_sender(message), Sayings("run", 1))
        match message:
            case Asks() | Passes() | Tells() | Shows() | Turns():
                found.append(decode_free(said.say(message).data))
            case Tail() | Rest():
                found.append(decode_free(said.tell(message).data))
            case _:
                found.append(message)
    return found
