"""Who listens at a router: everything that is heard, and whether anybody does."""

import time
from queue import Empty, SimpleQueue

import zenoh

from cubepath.protocol.wire.sessions import is_heard, publisher, put, subscribe

_HEARD_S = 10.0
_STRAY_S = 0.3
_AGAIN_S = 0.005
PROBE = "cubepath/0123456789ab/probe/all"


def wait_for_subscriber(session: zenoh.Session, key: str) -> None:
    """Wait until a session knows of a subscriber to a key elsewhere; what is put before is lost."""
    with publisher(session, key) as found:
        deadline = time.monotonic() + _HEARD_S
        while not is_heard(found):
            assert time.monotonic() < deadline, f"no subscriber on {key}"
            time.sleep(_AGAIN_S)


class Ear:
    """A session that listens."""

    def __init__(self, session: zenoh.Session) -> None:
        """Listen from now on."""
        self._heard: SimpleQueue[str] = SimpleQueue()
        self._subscriber = subscribe(
            session, "cubepath/**", lambda sample: self._heard.put(str(sample.key_expr))
        )

    def hears(self, speaker: zenoh.Session, keys: list[str], expected: int) -> list[str]:
        """Return on which of the keys something is heard that the speaker puts, in that order.

        When as many as are expected were heard, it listens some time for more.
        """
        wait_for_subscriber(speaker, PROBE)
        for key in keys:
            put(speaker, key, b"{}")
        found = [self._heard.get(timeout=_HEARD_S) for _ in range(expected)]
        try:
            while True:
                found.append(self._heard.get(timeout=_STRAY_S))
        except Empty:
            return found
