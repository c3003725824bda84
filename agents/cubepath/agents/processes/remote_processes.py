"""Processes that join a run from elsewhere, from the coordinator's side.

A session answers requests for a configuration and watches which processes are alive. Its callbacks
only enqueue; `look` does the work.
"""

import contextlib
import math
import re
import time
from collections.abc import Callable, Mapping, Sequence
from queue import Empty, SimpleQueue
from typing import NamedTuple

import zenoh

from cubepath.agents.processes.membership import (
    ANY,
    ENDED,
    GONE_S,
    JoinRequest,
    Liveness,
    Membership,
    alive_key,
    orders_key,
    read_request,
    spans,
)
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.wire.credentials import COORDINATOR, Credentials
from cubepath.protocol.wire.sessions import open_client

_POLL_S = 0.05
_SAY_S = 1.0
_NAME = re.compile(r"(?:process|keeper)_(?:0|[1-9][0-9]{0,8})", re.ASCII)
QUESTIONS_MAX, LOOK_MAX = 1024, 64
"""The most questions that wait, and that are answered at a time. A process without an answer asks
again; between two looks the run continues, or is interrupted."""


class Changes(NamedTuple):
    """Whose places others have taken, who wants to begin there, and who gives a place back."""

    taken: list[str]
    begun: list[str]
    returned: dict[str, bytes]
    """With the log of a keeper."""


class RemoteProcesses:
    """The joiners of one run."""

    def __init__(
        self, endpoint: str, run: str, membership: Membership, credentials: Credentials
    ) -> None:
        """Open a session as the coordinator, and let everyone know that the run is there."""
        self._run = run
        self._membership = membership
        self._changes = Changes([], [], {})
        self._asking: dict[str, zenoh.Query] = {}
        self._queue: SimpleQueue[zenoh.Query] = SimpleQueue()
        self.dropped = 0
        """How many questions came while too many waited."""
        self._waiting: dict[str, zenoh.Query] = {}
        self._offers: dict[str, bytes] = {}
        self._session = open_client(endpoint, None, credentials=credentials)
        self._liveness = Liveness(self._session, alive_key(run))
        self._queryable = self._session.declare_queryable(
            orders_key(run), zenoh.handlers.Callback(self._enqueue, indirect=False)
        )
        self._token = self._session.liveliness().declare_token(alive_key(run, COORDINATOR))

    def close(self) -> None:
        """Tell those who still wait that the run has ended, and close the session."""
        for query in self._waiting.values():
            with contextlib.suppress(zenoh.ZError):  # the router may be gone
                query.reply_err(ENDED)
        self._waiting.clear()
        self._session.close()

    def gather(
        self, check: Callable[[], None], say: Callable[[str], None], patience_s: float
    ) -> list[list[int]]:
        """Wait until all are there, and return the modules of each by its number.

        `check` may raise to end the waiting. `say` reports what is missing after a second, and
        whenever that has changed. CheckError if no process joins for `patience_s`.
        """
        began = changed = time.monotonic()
        reported, before = -1, self._membership.missing
        while not self._membership.complete:
            check()
            self.look(_POLL_S)
            now = time.monotonic()
            self._membership.forget(now)
            missing = self._membership.missing
            if missing < before:
                changed = now
            before = missing
            what = f"{missing} process{'es' if missing > 1 else ''}"
            what += f": modules {spans(self._membership.free) or 'none'}"
            if missing and now - changed >= patience_s:
                raise CheckError(f"no process joined within {patience_s:g} s, expected {what}")
            if missing not in (0, reported) and now - began >= _SAY_S:
                reported = missing
                say(f"waiting for {what}")
        return self._membership.number()

    @property
    def names(self) -> list[str]:
        """Return the names of those that have joined, when all are there."""
        return self._membership.names

    def send(self, name: str, data: bytes) -> None:
        """Answer a process with its offer, now and when it asks again."""
        self._offers[name] = data
        self._liveness.expect(alive_key(self._run, name))
        for joiner in list(self._waiting):
            with contextlib.suppress(zenoh.ZError):
                self._answer(joiner)

    def look(self, timeout_s: float = 0.0) -> Changes:
        """Take the questions that have come, waiting this long for the first.

        Who has taken a place waits for its offer, and who begins or leaves there for `answer`.
        """
        with contextlib.suppress(Empty):
            query = self._queue.get(timeout=timeout_s) if timeout_s else self._queue.get_nowait()
            self._take(query)
            for _ in range(LOOK_MAX - 1):
                self._take(self._queue.get_nowait())
        found, self._changes = self._changes, Changes([], [], {})
        return found

    def answer(self, name: str, reason: str | None = None) -> None:
        """Let a process begin or leave that wants to, or say why not."""
        query = self._asking.pop(name, None)
        if query is None:
            return
        with contextlib.suppress(zenoh.ZError):
            query.reply(query.key_expr, b"") if reason is None else query.reply_err(reason)

    def withdraw(self, name: str) -> None:
        """Have nobody at a place any more: who had it may not begin there."""
        self._membership.leave(name)
        self._offers.pop(name, None)

    def _enqueue(self, query: zenoh.Query) -> None:
        if self._queue.qsize() < QUESTIONS_MAX:
            self._queue.put(query)
        else:
            self.dropped += 1

    def _take(self, query: zenoh.Query) -> None:
        with contextlib.suppress(zenoh.ZError):  # who asked, or the router, may be gone
            self._reply(query)

    def _reply(self, query: zenoh.Query) -> None:
        who = str(query.key_expr).rpartition("/")[2]
        data = b"" if query.payload is None else query.payload.to_bytes()
        try:
            request = read_request(data)
            named = None if who == ANY else _name(who)
        except InputError as error:
            query.reply_err(str(error))
            return
        known = self._membership.name_of(request.joiner)
        if request.wants != "join":
            self._begins_or_leaves(known, request, query)
            return
        reason = self._membership.ask(request.joiner, request.modules, named, time.monotonic())
        if reason is not None:
            # Whose place it wants may just have left: then it gets no answer yet, and asks again.
            if self._membership.vacant.keys() >= set(self.gone(0.0)):
                query.reply_err(reason)
            return
        name = self._membership.name_of(request.joiner)
        if name is not None and known is None:
            self._offers.pop(name, None)
            self._changes.taken.append(name)
        self._waiting[request.joiner] = query
        self._answer(request.joiner)

    def _begins_or_leaves(self, name: str | None, request: JoinRequest, query: zenoh.Query) -> None:
        if name is None:
            query.reply_err("another process has taken this place")
            return
        self._asking[name] = query
        if request.wants == "begin":
            self._changes.begun.append(name)
        else:
            self._changes.returned[name] = request.log

    def _answer(self, joiner: str) -> None:
        name = self._membership.name_of(joiner)
        if name is not None and name in self._offers:
            query = self._waiting.pop(joiner)
            who = str(query.key_expr).rpartition("/")[2]
            query.reply(orders_key(self._run, who), self._offers[name])

    def gone(self, patience_s: float = GONE_S, heard: float = math.inf) -> list[str]:
        """Return the names of those that joined, were alive, and are not, as `Liveness.gone`."""
        gone = set(self._liveness.gone(patience_s, heard))
        return sorted(name for name in self._offers if alive_key(self._run, name) in gone)

    def wait(self, patience_s: float) -> None:
        """Wait this long for those that were told to stop: they need the router to hear it."""
        deadline = time.monotonic() + patience_s
        while len(self.gone(0.0)) < len(self._offers) and time.monotonic() < deadline:
            time.sleep(_POLL_S)

    def vacate(self, places: Mapping[str, Sequence[int]]) -> None:
        """Let others take these places, and no other ones."""
        self._membership.vacant = places

    def is_there(self, name: str) -> bool:
        """Return whether one that has joined shows that it is alive."""
        return self._liveness.is_there(alive_key(self._run, name))


def _name(name: str) -> str:
    """Return the name of a process or a keeper; InputError if it is none."""
    if _NAME.fullmatch(name) is None:
        raise InputError(f"{name}: expected process_N, keeper_K, or {ANY}")
    return name
