"""A replay of messages on any keys: nothing is gathered, and each is put as it was put then."""

import time
from contextlib import ExitStack
from typing import Any

import zenoh

from cubepath.coordinator.playback.machine import PendingOrder, Why
from cubepath.coordinator.playback.replay_comparison import ReplayResult
from cubepath.coordinator.playback.replay_session import PlayOptions, ReplaySession
from cubepath.coordinator.playback.selection import StateAt
from cubepath.coordinator.playback.timeline import Cursor, read_spot
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.plain_messages import ATTACHMENT, DELETE, PutSettings, key_in
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.wire import sessions

_NO_ROUNDS = "messages on any keys have no rounds"
_KEYS_MAX = 100
"""Of more keys it is asked who listens to those that begin alike."""
_KNOWN_S, _LOOK_S = 0.5, 0.02
"""For how long, and how often, nobody is waited for at the end."""
_NOWHERE = StateAt(0, (), frozenset())


class KeyReplaySession(ReplaySession):
    """A replay: a session that puts, at a router of its own or at one that is there."""

    def _prepare(self) -> None:
        """Find the keys on which it puts; of many how they begin."""
        topics = self.recording.topics()
        taken = [
            self._keys.key_of_topic(each)
            for each in topics
            if not each.endswith(ATTACHMENT) and self._selection.takes_topic(each)
        ]
        whole, begun = dict.fromkeys(taken), dict.fromkeys(f"{_first(each)}/**" for each in taken)
        self._put_on = next(
            (each for each in (whole, begun) if len(each) <= _KEYS_MAX), {"**": None}
        )
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._heard = False

    def _offer(self) -> None:
        """Offer nothing: it is no run."""

    def _listen(self) -> Any:
        """Ask from now on who listens to what it puts."""
        asked = ExitStack()
        for key in self._put_on:
            self._publishers[key] = asked.enter_context(sessions.publisher(self._mouth, key))
        return asked.close

    def _waited_for(self) -> list[str]:
        return [*self._put_on]

    def _notice_ears(self, key: str) -> None:
        if not self._heard:
            found = next(
                (each for each in (key, f"{_first(key)}/**") if each in self._put_on), "**"
            )
            self._heard = sessions.is_heard(self._publishers[found])

    def _gather(self) -> None:
        """Gather nothing, but wait until it is known whether anyone listens."""
        deadline = time.monotonic() + _KNOWN_S
        while self._arrived and not self._heard and time.monotonic() < deadline:
            self._heard = any(map(sessions.is_heard, self._publishers.values()))
            time.sleep(_LOOK_S)

    def _put(self, record: Record, key: str, mark: Cursor) -> None:
        put = record.put or PutSettings()
        given: Any = {
            # Whoever dropped then did so on another network: here the player waits.
            "congestion_control": zenoh.CongestionControl.BLOCK,
            "priority": getattr(zenoh.Priority, put.priority.upper()),
            "express": put.express,
            "attachment": self._attachment(record, mark),
        }
        if record.topic.endswith(DELETE):
            self._mouth.delete(key, **given)
        else:
            self._mouth.put(key, record.data, encoding=put.encoding, **given)
        self._notice_ears(key)
        self._arrived += 1
        if self._progress is not None:
            self._progress(1)

    def _attachment(self, record: Record, mark: Cursor) -> bytes | None:
        """Return the attachment of a message, which stands right before it."""
        _, before = next(self.reel.backward(mark), (mark, None))
        if before is None or before.topic != key_in(record.topic) + ATTACHMENT:
            return None
        return before.data

    def _jumped(self, why: Why) -> None:
        self._cover()
        self._tell_position(why, _NOWHERE)

    def _obey(self, asked: PendingOrder) -> None:
        order = asked.order
        if order.unit == "round" or (order.to and read_spot(order.to).seconds is None):
            asked.refuse(f"{order.name}: {_NO_ROUNDS}, expected messages, or a time such as 3.5s")
        else:
            super()._obey(asked)

    def result(self) -> ReplayResult:
        """Return how many messages were put; there is nothing to compare them with."""
        left_out = {
            topic: count.messages
            for topic, count in sorted(self.recording.counts().kinds.items())
            if not self._selection.takes_topic(topic)
        }
        return ReplayResult(
            log=str(self.recording.path),
            run=self.run,
            endpoint=self.endpoint,
            complete=not self.recording.problems,
            messages=self._arrived,
            seconds=round(time.monotonic() - self._began, 3),
            not_compared=("messages on any keys",),
            left_out=left_out,
            problems=self.recording.problems,
            clock="free",
            heard=self._heard or not self._arrived,
        )


def _first(key: str) -> str:
    return key.partition("/")[0]


def session_of(recording: Recording, options: PlayOptions) -> ReplaySession:
    """Return a replay of a recording; InputError for a wrong option. Nothing is opened yet."""
    if not recording.of_keys:
        return ReplaySession(recording, **options)
    for name in ("begin", "until"):
        spot = options.get(name)
        if spot is not None and read_spot(spot, name).seconds is None:  # type: ignore[arg-type]
            named = {"begin": "from"}.get(name, name)
            raise InputError(f"{named}={spot}: {_NO_ROUNDS}, expected a time such as 3.5s")
    return KeyReplaySession(recording, **options)
