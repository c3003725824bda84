"""Which messages of a free run have arrived, by their senders' numbers, and which are lost."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from cubepath.protocol.wire.free_messages import FreeMessage, Repeat, Rest, Tail, free_sender

ASKS_MAX = 12
"""So often it is asked for the same messages; then they are given up."""


@dataclass(slots=True)
class _Birth:
    """What has come of a sender since it was born."""

    birth: int
    upto: int = 0
    """All messages up to this number have come, or were given up."""
    beyond: set[int] = field(default_factory=set)
    last: int = 0
    """The greatest number that is known to have been given."""
    left: int = 0
    """How many messages are still lacking since it was last asked."""
    asks: int = 0

    def take(self, said: int, *, own: bool) -> None:
        self.last = max(self.last, said)
        if own and said > self.upto:
            self.beyond.add(said)
            self._close()

    def _close(self) -> None:
        while self.upto + 1 in self.beyond:
            self.upto += 1
            self.beyond.remove(self.upto)

    @property
    def lacking(self) -> int:
        return self.last - self.upto - len(self.beyond)

    def give_up(self) -> None:
        self.upto, self.asks = min(self.beyond, default=self.last + 1) - 1, 0
        self._close()


class Heard:
    """What has come of all senders; of those that were born again only the last birth counts."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._births: dict[str, _Birth] = {}

    def take(self, message: FreeMessage) -> None:
        """Take note of a message."""
        said = getattr(message, "said", 0)
        birth = getattr(message, "birth", 0)
        if not said:
            return
        sender = free_sender(message)
        known = self._births.get(sender)
        if known is None or known.birth < birth:
            known = self._births[sender] = _Birth(birth)
        if known.birth == birth:
            known.take(said, own=not isinstance(message, Rest | Tail))

    @property
    def lacking(self) -> int:
        """Return how many messages are known to be missing and were not given up."""
        return sum(known.lacking for known in self._births.values())

    def asks(self) -> Iterator[Repeat]:
        """Yield what to ask of whom; what does not come after many times is given up."""
        for sender, known in sorted(self._births.items()):
            lacking = known.lacking
            if not lacking:
                continue
            known.asks = known.asks + 1 if lacking == known.left else 1
            known.left = lacking
            if known.asks > ASKS_MAX:
                known.give_up()
            elif known.asks > 1:  # what has just been said may be on its way
                before = min(known.beyond, default=known.last + 1)
                yield Repeat(sender, known.birth, known.upto, before - 1)
