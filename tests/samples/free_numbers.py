"""Messages of a run without rounds with the numbers that their senders give them."""

from __future__ import annotations

from collections.abc import Sequence

from cubepath.protocol.wire.free_messages import (
    CommitLog,
    Forwards,
    FreeMessage,
    Halted,
    Replies,
    Requests,
    TileUpdate,
    Turns,
    decode_free,
    free_sender,
)
from cubepath.protocol.wire.sayings import Sayings


class Numbering:
    """The numbers that senders give their messages."""

    def __init__(self) -> None:
        """Begin before the first message."""
        self._sayings: dict[str, Sayings] = {}

    def numbered(self, message: FreeMessage) -> FreeMessage:
        """Return a message with its number, or the last one of its sender."""
        said = self._sayings.setdefault(free_sender(message), Sayings("run", 1))
        match message:
            case Requests() | Forwards() | Replies() | TileUpdate() | Turns():
                return decode_free(said.say(message).data)
            case CommitLog() | Halted():
                return decode_free(said.tell(message).data)
            case _:
                return message


def numbered(messages: Sequence[FreeMessage], processes: int = 2) -> list[FreeMessage]:
    """Return the messages with the numbers that their senders give, and the last of each."""
    return [*map(Numbering().numbered, (*messages, *map(Halted, range(processes))))]
