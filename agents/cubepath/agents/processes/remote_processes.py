"""Processes that join a run from elsewhere, from the coordinator's side.

A session answers requests for a configuration and watches which processes are alive. Its callbacks
only enqueue; `look` does the work.
"""

import contextlib
import time
from collections.abc import Callable, Mapping
from queue import Empty, SimpleQueue

import zenoh

from cubepath.agents.processes.config import ProcessConfig
from cubepath.agents.processes.membership import (
    ANY,
    ENDED,
    Liveness,
    Membership,
    alive_key,
    offer,
    orders_key,
    read_request,
    spans,
)
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.wire.credentials import COORDINATOR, Credentials, process_name
from cubepath.protocol.wire.sessions import open_client

_POLL_S = 0.05
_SAY_S = 1.0
QUESTIONS_MAX, LOOK_MAX = 1024, 64
"""So many questions wait at most, and so many are answered at a time. Who is not answered asks
again; and between two looks the run goes on, or is interrupted."""


class RemoteProcesses:
    """The joiners of one run."""

    def __init__(
        self, endpoint: str, run: str, modules: int, expected: int, credentials: Credentials
    ) -> None:
        """Open a session as the coordinator, and let everyone know that the run is there."""
        self._run = run
        self._roster = Membership(modules, expected)
        self._queue: SimpleQueue[zenoh.Query] = SimpleQueue()
        self.dropped = 0
        """How many questions came while too many waited."""
        self._waiting: dict[str, zenoh.Query] = {}
        self._offers: Mapping[int, bytes] = {}
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
        said, before = -1, self._roster.missing
        while not self._roster.complete:
            check()
            self.look(_POLL_S)
            now = time.monotonic()
            self._roster.forget(now)
            missing = self._roster.missing
            if missing < before:
                changed = now
            before = missing
            what = f"{missing} process{'es' if missing > 1 else ''}"
            what += f": modules {spans(self._roster.free) or 'none'}"
            if missing and now - changed >= patience_s:
                raise CheckError(f"no process joined within {patience_s:g} s, expected {what}")
            if missing not in (0, said) and now - began >= _SAY_S:
                said = missing
                say(f"waiting for {what}")
        return self._roster.number()

    def send(self, orders: Mapping[int, ProcessConfig]) -> None:
        """Answer all with their orders, now and when they ask again."""
        self._offers = {process: offer(each) for process, each in orders.items()}
        for joiner in list(self._waiting):
            with contextlib.suppress(zenoh.ZError):
                self._answer(joiner)

    def look(self, timeout_s: float = 0.0) -> None:
        """Take the questions that have come, waiting this long for the first."""
        try:
            query = self._queue.get(timeout=timeout_s) if timeout_s else self._queue.get_nowait()
            self._take(query)
            for _ in range(LOOK_MAX - 1):
                self._take(self._queue.get_nowait())
        except Empty:
            return

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
            named = None if who == ANY else _number(who)
        except InputError as error:
            query.reply_err(str(error))
            return
        reason = self._roster.ask(request.joiner, request.modules, named, time.monotonic())
        if reason is not None:
            query.reply_err(reason)
            return
        self._waiting[request.joiner] = query
        self._answer(request.joiner)

    def _answer(self, joiner: str) -> None:
        number = self._roster.number_of(joiner)
        if number is not None and number in self._offers:
            query = self._waiting.pop(joiner)
            who = str(query.key_expr).rpartition("/")[2]
            query.reply(orders_key(self._run, who), self._offers[number])

    def gone(self) -> list[int]:
        """Return the processes that joined, were alive, and are no longer."""
        gone = set(self._liveness.gone())
        names = {process: alive_key(self._run, process_name(process)) for process in self._offers}
        return sorted(process for process, key in names.items() if key in gone)


def _number(name: str) -> int:
    """Return the number of a process; InputError if it is no name of one."""
    head, _, number = name.partition("_")
    if head != "process" or not (number.isascii() and number.isdigit()) or len(number) > 9:
        raise InputError(f"{name}: expected process_N, or {ANY}")
    return int(number)
