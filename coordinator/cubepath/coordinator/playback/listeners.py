"""Who listens to a run, as its router tells.

Room: coordinator.
"""

from __future__ import annotations

from collections.abc import Set as AbstractSet

import msgspec
import zenoh

_SUBSCRIBERS = "@/*/router/subscriber/**"
_TIMEOUT_S = 5.0


class _Sources(msgspec.Struct):
    routers: list[str] = []
    peers: list[str] = []
    clients: list[str] = []


def others_listening(session: zenoh.Session, key: str, own: AbstractSet[str]) -> int:
    """Return how many sessions subscribe to something that a key expression has in common.

    Sessions whose ids are among `own` do not count; nor does the router itself.
    """
    wanted = zenoh.KeyExpr(key)
    found: set[str] = set()
    for reply in session.get(_SUBSCRIBERS, timeout=_TIMEOUT_S):
        sample = reply.ok
        if sample is None:
            continue
        told = str(sample.key_expr).split("/", 4)
        try:
            there = wanted.intersects(zenoh.KeyExpr(told[4]))
            sources = msgspec.json.decode(sample.payload.to_bytes(), type=_Sources)
        except (IndexError, zenoh.ZError, msgspec.DecodeError):
            continue
        if there:
            found.update(sources.clients, sources.peers, set(sources.routers) - {told[1]})
    return len(found - own)
