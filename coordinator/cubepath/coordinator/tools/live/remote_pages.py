"""A run elsewhere as a page: what the run sends to its guests, step by step.

The viewer is a guest of the run's router; the run is not touched. The moves of a run without rounds
may arrive in any order that they allow; their levels are computed here.
"""

import dataclasses
import math
import threading
import time
from bisect import insort
from collections import deque
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Self

import msgspec
import zenoh

from cubepath.coordinator.runs.asking import (
    MOVES_MAX,
    Released,
    RunInfo,
    about_key,
    ask,
    ask_path,
    find_run,
)
from cubepath.coordinator.tools.live.feed import HEARD, Feed, Words
from cubepath.coordinator.tools.live.server import Server
from cubepath.coordinator.tools.recorder.recorder import guest_at
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.options import seconds
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.recordings.description import FREE_FORMAT
from cubepath.protocol.scenes.toml import scene_from_toml
from cubepath.protocol.wire.credentials import has_ended
from cubepath.protocol.wire.free_messages import decode_free
from cubepath.protocol.wire.keys import topic_key
from cubepath.protocol.wire.messages import Edges, Message, Summary, decode
from cubepath.protocol.wire.sessions import open_client, routers_of, subscribe, watch

_encode = msgspec.json.Encoder().encode


class Levels:
    """Moves by level, in a level by generator and place, as recordings have them."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._levels: list[list[tuple[str, bytes]]] = []
        self._actions: dict[tuple[str, bytes], Action] = {}
        self._changed: int | None = None

    def __len__(self) -> int:
        """Return the greatest level."""
        return len(self._levels)

    def add(self, moves: Iterable[Released]) -> None:
        """Take further moves; InputError for one that the system does not have."""
        for move in moves:
            if not 1 <= move.level <= len(self._levels) + 1:
                raise InputError(f"level {move.level}: expected 1 to {len(self._levels) + 1}")
            if move.level > len(self._levels):
                self._levels.append([])
            insort(self._levels[move.level - 1], self._named(move))
            self._change(move.level)

    def put(self, level: int, moves: Iterable[Released]) -> None:
        """Say what a level has, in the place of what was known of it."""
        while len(self._levels) < level:
            self._levels.append([])
        found = sorted(map(self._named, moves))
        if found != self._levels[level - 1]:
            self._levels[level - 1] = found
            self._change(level)

    def _named(self, move: Released) -> tuple[str, bytes]:
        key = move.generator, _encode(move.at)
        if key not in self._actions:
            self._actions[key] = self._system.action(move.generator, move.at)
        return key

    def _change(self, level: int) -> None:
        self._changed = level if self._changed is None else min(self._changed, level)

    def changed(self) -> tuple[int, list[tuple[Action, ...]]] | None:
        """Return the levels from the first on that has changed, and its place from 0."""
        if self._changed is None:
            return None
        place, self._changed = self._changed - 1, None
        return place, [tuple(self._actions[key] for key in level) for level in self._levels[place:]]


_RESULTS = ("edges", "summary")
_SAID = ("to", "reports")
_SAID_FREE = ("requests", "forwards", "replies", "commit", "commits")
"""The keys of what modules say, with rounds and without, and of what keepers answer."""
_ASK_S = 0.1
_ASKED_S_MAX = 2.0
_SHARE = 10
"""At least this many times as long as asking took, nothing is asked again."""
_LOOK_S = 0.25
_WAITING_MAX = 100_000
"""At most this many steps wait to be looked at; who falls behind more has missed some."""


class RemoteRunPage:
    """A run elsewhere, with the page that shows it; as a context manager it leaves both.

    The page begins where the run stands; of a run without rounds it has all levels. It has an
    `address`, and is fed by `wait`.

    >>> with start("hex:n=4", processes=1, log="logs/far.mcap") as running:
    ...     running.step(2)
    ...     with RemoteRunPage(running.endpoint) as watched:
    ...         outcome = running.play()
    ...         watched.wait(10), watched.begins, watched.round == outcome.rounds
    True
    (True, 2, True)
    """

    def __init__(
        self,
        endpoint: str,
        run: str | None = None,
        *,
        port: int = 0,
        secure: Path | str | None = None,
        patience_s: float = 10.0,
    ) -> None:
        """Attach to the run, and serve the page, as ``view --connect`` does.

        `endpoint` is where the run can be listened to (`Run.endpoint`), `run` its name where there
        are several. `secure` is a folder with the certificate of `guest`. A run or router that is
        gone is waited for for `patience_s` seconds.

        InputError for a replay, CheckError if no run answers within `patience_s`,
        CubepathError if there is no router at the endpoint.
        """
        credentials = guest_at(endpoint, secure)
        seconds("patience_s", patience_s)
        self.ended: str | None = None
        """How the run has ended, or why it is watched no more; None while it continues."""
        self.error: str | None = None
        """What went wrong, in a line, if anything did."""
        self.run: str
        """Its name in keys."""
        self.scene: Scene
        """Where the page begins."""
        self.round: int
        """The last round, or the greatest level, that the page shows."""
        self.begins: int
        """How many rounds were over before: the page has none of these."""
        self._waiting: deque[Message] = deque(maxlen=_WAITING_MAX)
        self._messages: deque[Words] = deque()
        """Messages from before there is a feed, which bounds and counts what waits."""
        self._take_words: Callable[[Words], None] = self._messages.append
        self._known = 0  # moves of a run without rounds that were told
        self._again_s = 0.0
        self._news = threading.Event()
        self._alive = True
        self._gone_s = math.inf
        """Since when the run or the router is gone."""
        self._endpoint, self._patience_s = endpoint, patience_s
        self._session = open_client(endpoint, patience_s, credentials=credentials)
        try:
            about = _run_at(self._session, endpoint, run, patience_s)
            self.run = about.run
            self._free = about.format == FREE_FORMAT
            self._listen(about)
            scene = scene_from_toml(about.scene, f"run {about.run}")
            self._levels = Levels(scene.system)
            self.round = self.begins = 0
            if not self._free:
                # Without rounds a run tells all its moves; with them it says where it stands.
                status = ask(endpoint, about.run, credentials=credentials, timeout_s=patience_s)
                self.round = self.begins = status.round
                scene = dataclasses.replace(scene, start=status.sites)
            self.scene = scene
            self._feed = Feed(
                self.scene,
                step_name="level" if self._free else "round",
                facts=self._facts(about),
                before=self.begins,
            )
            self._hand_over()
            self._take_words = self._feed.hear
            self._server = Server(self._feed, None, port=port)
        except BaseException:
            self._session.close()
            raise
        self.address = self._server.address
        """Where the page is."""

    def _listen(self, about: RunInfo) -> None:
        session = self._session
        kinds = _SAID_FREE if self._free else _SAID
        self._subscribers = [
            *(subscribe(session, topic_key(self.run, kind), self._hear) for kind in _RESULTS),
            *(subscribe(session, topic_key(self.run, kind), self._listen_in) for kind in kinds),
        ]
        self._token = watch(session, about_key(about.run), self._tell_alive)

    def _facts(self, about: RunInfo) -> list[tuple[str, str]]:
        known = about.parameters
        facts: list[tuple[str, str]] = [
            (key, known[key]) for key in ("rule", "seed") if key in known
        ]
        facts.append(("run", about.run))
        if self.begins:
            facts.append(("", f"watched from the end of round {self.begins} on"))
        return facts

    # In threads of zenoh.

    def _hear(self, sample: zenoh.Sample) -> None:
        try:
            message = decode(sample.payload.to_bytes())
        except CubepathError:  # others may say anything at a router that is open to all
            return
        self._waiting.append(message)
        self._news.set()

    def _listen_in(self, sample: zenoh.Sample) -> None:
        data = sample.payload.to_bytes()
        try:
            message = decode_free(data) if self._free else decode(data)
        except CubepathError:
            return
        parts: Iterable[Words] = getattr(message, "parts", (message,))
        for part in parts:
            if part.__struct_config__.tag in HEARD:
                self._take_words(part)

    def _tell_alive(self, _key: str, alive: bool) -> None:  # noqa: FBT001 - as `watch` tells it
        self._alive = alive
        self._news.set()

    # For who watches.

    def wait(self, timeout_s: float) -> bool:
        """Feed the page for `timeout_s`, or until the run ends; return whether it has ended."""
        until = time.monotonic() + timeout_s
        while self.ended is None:
            self._news.clear()
            self._hand_over()
            while self._waiting and self.ended is None:
                self._take(self._waiting.popleft())
            if self.ended is None and self._free:
                self._ask_on()
            if self.ended is None:
                self._look()
            left = until - time.monotonic()
            if self.ended is not None or left <= 0:
                break
            self._news.wait(min(left, _ASK_S if self._free else _LOOK_S))
        return self.ended is not None

    def _hand_over(self) -> None:
        while self._messages:
            self._feed.hear(self._messages.popleft())

    def _ask_on(self) -> None:
        """Ask for the moves since the last, unless that was a short while ago."""
        begun = time.monotonic()
        if begun < self._again_s:
            return
        more = True
        while more:
            moves = ask_path(self._session, self.run, self._known, _ASKED_S_MAX)
            self._known += len(moves)
            self._levels.add(moves)
            more = len(moves) == MOVES_MAX
        self._give_levels()
        self._again_s = time.monotonic() + max(_ASK_S, _SHARE * (time.monotonic() - begun))

    def _give_levels(self) -> None:
        changed = self._levels.changed()
        if changed is not None:
            self._feed.give(*changed)
        self.round = len(self._levels)

    def _take(self, message: Message) -> None:
        match message:
            case Edges(round=number) if self._free:  # all of them, before the summary
                moves = (Released(number, each.generator, each.at) for each in message.moves)
                self._levels.put(number, moves)
            case Edges(round=number) if number == self.round + 1:
                self.round = number
                self._feed.give(number - 1 - self.begins, [self._actions(message)])
            case Edges(round=number) if number > self.round + 1:
                self._end("missed", f"round {self.round + 1} was not heard, but {number}")
            case Summary(ended=ended, error=error):
                if self._free:
                    self._give_levels()
                self._end(ended, error)
            case _:
                pass

    def _actions(self, edges: Edges) -> tuple[Action, ...]:
        return tuple(self.scene.system.action(each.generator, each.at) for each in edges.moves)

    def _look(self) -> None:
        if self._alive and routers_of(self._session):
            self._gone_s = math.inf
            return
        now = time.monotonic()
        self._gone_s = min(self._gone_s, now)
        if now - self._gone_s > self._patience_s or has_ended(self._endpoint):
            self._end("gone", "the run is gone, and has not said how it ended")

    def _end(self, ended: str, error: str | None) -> None:
        self.ended, self.error = ended, error
        document: dict[str, Any] = {"ended": ended, "error": error}
        self._feed.end(document)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self.ended is None:
            self._end("left", "the process that fed this page has left the run")
        self._session.close()
        try:
            self._server.leave()
        finally:
            self._feed.close()


def _run_at(session: zenoh.Session, endpoint: str, run: str | None, patience_s: float) -> RunInfo:
    about = find_run(session, endpoint, run, patience_s)
    if about.is_replay:
        raise InputError(
            f"{about.run} at {endpoint}: a replay, expected a run; the page of a recording is made"
            " by cubepath view LOG -o PAGE.html"
        )
    return about
