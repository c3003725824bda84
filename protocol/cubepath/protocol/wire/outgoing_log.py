"""The outgoing messages of a sender without rounds: numbered, and kept for retransmission.

Messages are lost when a router dies. The recorder notices the gap in the numbers and asks for them.
Receivers accept late and duplicate messages, so the sender publishes the same bytes again.
"""

from collections import deque
from typing import Any

from msgspec.structs import replace

from cubepath.protocol.wire.free_messages import (
    CommitLog,
    Halted,
    Numbered,
    RetransmitRange,
    free_key,
)
from cubepath.protocol.wire.messages import encode
from cubepath.protocol.wire.nodes import Put

KEPT_MAX, KEPT_BYTES_MAX = 1000, 2**20
"""The most messages that a sender keeps, and the most bytes of them."""
REPEATED_MAX = 200
"""Messages in one answer to `RetransmitRange`."""
INCARNATIONS_OF_A_FLEET = 1_000_000
"""How much later incarnations begin in a run that is resumed: so it is known which came before."""


class OutgoingLog:
    """The messages of one sender in one of its incarnations."""

    def __init__(self, run: str, incarnation: int) -> None:
        """Begin an empty log."""
        self.sequence = 0
        """The number of the last message."""
        self._run, self._incarnation = run, incarnation
        self._kept: deque[tuple[int, Put]] = deque()
        self._bytes = 0

    def append(self, message: Numbered) -> Put:
        """Number the next message, without duplicate parts, and keep it; return how to put it."""
        self.sequence += 1
        parts: list[Any] = []
        for part in message.parts:
            if part not in parts:
                parts.append(part)
        put = self.stamp(
            message if len(parts) == len(message.parts) else replace(message, parts=parts)
        )
        self._kept.append((self.sequence, put))
        self._bytes += len(put.data)
        while len(self._kept) > KEPT_MAX or self._bytes > KEPT_BYTES_MAX:
            self._bytes -= len(self._kept.popleft()[1].data)
        return put

    def stamp(self, message: Numbered | Halted | CommitLog) -> Put:
        """Return how to put a message that carries the last number and has none itself."""
        numbered = replace(message, incarnation=self._incarnation, sequence=self.sequence)
        return Put(free_key(self._run, numbered), encode(numbered))

    def retransmit(self, asked: RetransmitRange) -> list[Put]:
        """Return the requested messages that are kept, `REPEATED_MAX` at most."""
        if asked.incarnation != self._incarnation:
            return []
        found = [put for number, put in self._kept if asked.after < number <= asked.upto]
        return found[:REPEATED_MAX]
