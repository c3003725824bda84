"""A bridge between the router of a run and another: what crosses it is lost and doubled at will."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Generator
from dataclasses import dataclass, field
from queue import SimpleQueue
from threading import Thread
from typing import Any, TypeAlias

import zenoh

from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.sessions import open_client, put

_ALIVE = "cubepath/*/alive/coordinator"
_ORDERS = "cubepath/*/orders/*"
_ASK_S = 30.0

What: TypeAlias = tuple[int, str, str, int]
"""Round, kind, phase or an empty text, and process, -1 for the coordinator."""


def what_is(message: dict[str, Any]) -> What:
    """Return by what a message is chosen."""
    phase, process = message.get("phase", ""), message.get("process", -1)
    return message["round"], message["kind"], phase, process


@dataclass
class Bridge:
    """Whoever is on the far side hears every message twice; the first copies of some are lost."""

    lost: frozenset[What]
    done: set[What] = field(default_factory=set[What])
    """Which of them were lost, and came later."""
    _seen: set[bytes] = field(default_factory=set[bytes])
    _queue: SimpleQueue[tuple[zenoh.Session, str, bytes] | zenoh.Query | None] = field(
        default_factory=SimpleQueue
    )

    @contextlib.contextmanager
    def across(self, endpoint: str) -> Generator[str]:
        """Yield the endpoint on the far side of a router."""
        with (
            Router("tcp/127.0.0.1:0") as router,
            open_client(endpoint) as near,
            open_client(router.endpoint) as far,
        ):
            thread = Thread(target=self._carry, args=(near, far), daemon=True)
            thread.start()
            try:
                yield router.endpoint
            finally:
                self._queue.put(None)
                thread.join()

    def _carry(self, near: zenoh.Session, far: zenoh.Session) -> None:
        found: list[str] = []
        while not found:
            replies = near.liveliness().get(_ALIVE)
            found = [str(each.ok.key_expr) for each in replies if each.ok is not None]
        tokens = [far.liveliness().declare_token(found[0])]
        for one, other in ((near, far), (far, near)):
            self._listen(one, other)
        far.declare_queryable(_ORDERS, zenoh.handlers.Callback(self._queue.put, indirect=False))
        while (each := self._queue.get()) is not None:
            if isinstance(each, zenoh.Query):
                for reply in near.get(each.selector, payload=each.payload, timeout=_ASK_S):
                    if reply.ok is not None:
                        each.reply(each.key_expr, reply.ok.payload)
                        name = json.loads(reply.ok.payload.to_bytes())["orders"]["process"]
                        key = found[0].replace("coordinator", f"process_{name}")
                        tokens.append(near.liveliness().declare_token(key))
                continue
            to, key, data = each
            if not self._is_lost(data):
                for _ in range(2 if to is far else 1):
                    put(to, key, data)
        del tokens

    def _listen(self, one: zenoh.Session, other: zenoh.Session) -> None:
        def take(sample: zenoh.Sample) -> None:
            self._queue.put((other, str(sample.key_expr), sample.payload.to_bytes()))

        callback = zenoh.handlers.Callback(take, indirect=False)
        elsewhere = zenoh.Locality.REMOTE  # what it puts itself does not come back
        one.declare_subscriber("cubepath/**", callback, allowed_origin=elsewhere)

    def _is_lost(self, data: bytes) -> bool:
        """Return whether this copy is lost; its first, if it is chosen."""
        what = what_is(json.loads(data))
        if what not in self.lost:
            return False
        if data in self._seen:
            self.done.add(what)
            return False
        self._seen.add(data)
        return True
