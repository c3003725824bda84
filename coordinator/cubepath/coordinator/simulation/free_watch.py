"""The coordinator of a simulated run without rounds, as a node: it gathers, and decides nothing.

It asks keepers for what they have committed again and again, as that of a run over zenoh does.
"""

from __future__ import annotations

from cubepath.protocol.wire.free_messages import Fetch, Tail, decode_free, free_key
from cubepath.protocol.wire.messages import encode
from cubepath.protocol.wire.nodes import Effect, Listen, Put, Timer

FETCH_S = 0.5


class Watch:
    """Fetches the commits of all keepers."""

    def __init__(self, run: str, keepers: int) -> None:
        """Begin without any."""
        self.tails: dict[int, Tail] = {}
        """By keeper its last answer that has all of its commits."""
        self._run = run
        self._known = dict.fromkeys(range(keepers), 0)
        self.ticks = 0

    def start(self) -> list[Effect]:
        """Listen to the keepers."""
        return [Listen((f"cubepath/{self._run}/tail/**",)), Timer(FETCH_S)]

    def receive(self, key: str, data: bytes) -> list[Effect]:
        """Take what keepers have committed."""
        tail = decode_free(data)
        if isinstance(tail, Tail) and key == free_key(self._run, tail):
            known = self._known[tail.keeper]
            if tail.parts and tail.parts[0].serial <= known + 1:
                known = self._known[tail.keeper] = max(known, tail.parts[-1].serial)
            if tail.serial == known:
                self.tails[tail.keeper] = tail
        return []

    def tick(self) -> list[Effect]:
        """Fetch what is new."""
        self.ticks += 1
        fetches = [Fetch(keeper, serial) for keeper, serial in self._known.items()]
        puts = [Put(free_key(self._run, fetch), encode(fetch)) for fetch in fetches]
        return [*puts, Timer(FETCH_S)]
