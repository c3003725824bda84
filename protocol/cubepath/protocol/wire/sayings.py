"""What one sender says in a run without rounds: numbered, and kept for a while to be said again.

A router that dies takes messages with it. Whoever records notices by the numbers, and asks for
them. All receivers take what is late or doubled, so the same message is put again.
"""

from __future__ import annotations

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
"""So many messages a sender keeps at most, and so many bytes of them."""
REPEATED_MAX = 200
"""Messages in one answer to `RetransmitRange`."""
INCARNATIONS_OF_A_FLEET = 1_000_000
"""How much later incarnations begin in a run that is resumed: so it is known which came before."""


class Sayings:
    """The messages of one sender in one of its incarnations."""

    def __init__(self, run: str, incarnation: int) -> None:
        """Begin with nothing said."""
        self.said = 0
        """The number of the last message."""
        self._run, self._incarnation = run, incarnation
        self._kept: deque[tuple[int, Put]] = deque()
        self._bytes = 0

    def say(self, message: Numbered) -> Put:
        """Return how the next message is put, with its number, and keep it; each part once."""
        self.said += 1
        parts: list[Any] = []
        for part in message.parts:
            if part not in parts:
                parts.append(part)
        put = self.tell(
            message if len(parts) == len(message.parts) else replace(message, parts=parts)
        )
        self._kept.append((self.said, put))
        self._bytes += len(put.data)
        while len(self._kept) > KEPT_MAX or self._bytes > KEPT_BYTES_MAX:
            self._bytes -= len(self._kept.popleft()[1].data)
        return put

    def tell(self, message: Numbered | Halted | CommitLog) -> Put:
        """Return how a message is put that tells the last number and has none of its own."""
        numbered = replace(message, incarnation=self._incarnation, sequence=self.said)
        return Put(free_key(self._run, numbered), encode(numbered))

    def again(self, asked: RetransmitRange) -> list[Put]:
        """Return what was asked for, as far as it is kept, and not too much at once."""
        if asked.incarnation != self._incarnation:
            return []
        found = [put for number, put in self._kept if asked.after < number <= asked.upto]
        return found[:REPEATED_MAX]
