"""Messages of a run without rounds with the numbers that their senders give them."""

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
from cubepath.protocol.wire.outgoing_log import OutgoingLog


class Numbering:
    """The numbers that senders give their messages."""

    def __init__(self) -> None:
        """Begin before the first message."""
        self._outgoing: dict[str, OutgoingLog] = {}

    def numbered(self, message: FreeMessage) -> FreeMessage:
        """Return a message with its number, or the last one of its sender."""
        said = self._outgoing.setdefault(free_sender(message), OutgoingLog("run", 1))
        match message:
            case Requests() | Forwards() | Replies() | TileUpdate() | Turns():
                return decode_free(said.append(message).data)
            case CommitLog() | Halted():
                return decode_free(said.stamp(message).data)
            case _:
                return message


def numbered(messages: Sequence[FreeMessage], processes: int = 2) -> list[FreeMessage]:
    """Return the messages with the numbers that their senders give, and the last of each."""
    return [*map(Numbering().numbered, (*messages, *map(Halted, range(processes))))]
