"""Who is alive on the network: zenoh's liveliness tokens, watched across restarts of the router."""

from __future__ import annotations

import time
from queue import SimpleQueue

import zenoh

from cubepath.protocol.wire.sessions import routers_of, watch

GONE_S = 1.0
"""A token that is not there for so long has gone, at a router that is there."""
SETTLE_S = 10.0
"""Within this time sessions find a router that came back, and declare their tokens again."""


class Liveness:
    """Which tokens of a key expression were there, and are there no more.

    While a router is away all of them are; so none has gone before sessions could find it again.
    """

    def __init__(self, session: zenoh.Session, key: str, *expected: str) -> None:
        """Watch the tokens from now on, those that are there already included.

        A token that is `expected` has gone if it was never seen.
        """
        self._session = session
        self._absent: dict[str, float | None] = dict.fromkeys(expected, time.monotonic())
        self._changes: SimpleQueue[tuple[str, bool]] = SimpleQueue()
        self._routers = routers_of(session)
        self._changed_s = time.monotonic() - SETTLE_S
        self._subscriber = watch(session, key, lambda *change: self._changes.put(change))

    def _look(self) -> float:
        """Take note of what has changed; return the time."""
        now = time.monotonic()
        while not self._changes.empty():
            key, alive = self._changes.get_nowait()
            if alive:
                self._absent[key] = None
            elif self._absent.get(key) is None:
                self._absent[key] = now
        routers = routers_of(self._session)
        if routers != self._routers:
            self._routers, self._changed_s = routers, now
        return now

    def gone(self) -> list[str]:
        """Return the keys of tokens that have gone for good, as far as one can tell."""
        now = self._look()
        if not self._routers or now - self._changed_s < SETTLE_S:
            return []
        absent = sorted(self._absent.items())
        return [key for key, since in absent if since is not None and now - since >= GONE_S]

    def is_alone(self) -> bool:
        """Return whether there has been no router for longer than it takes to come back."""
        now = self._look()
        return not self._routers and now - self._changed_s >= SETTLE_S
