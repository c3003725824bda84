"""Your own run as a page that is fed while the run is under way: paused, by steps, or at a rate.

It listens to the run and paces it, without taking part in it. Orders arrive in other threads than
that of the run, which asks between two rounds how long it should wait.
"""

import math
import threading
import time
from collections.abc import Callable
from typing import Any, Literal, Self, TypeAlias, get_args

from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.listeners import TappedMessage
from cubepath.coordinator.runs.run import Run
from cubepath.coordinator.tools.live.feed import HEARD, Feed
from cubepath.coordinator.tools.live.server import Server
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.options import real_number, whole_number

Order: TypeAlias = Literal["pause", "resume", "step", "rate"]
ORDERS: tuple[Order, ...] = get_args(Order)
RATE_MAX = 1000.0
"""Rounds a second; without a rate a run takes what it needs."""
STEPS_MAX = 1000
"""At most this many rounds can be asked for while a run is paused."""
_LATE_S = 0.05


class RoundPacer:
    """When the next round may begin.

    >>> pace = RoundPacer(paused=True)
    >>> pace.order("step")
    >>> pace.left(), pace.left()
    (0.0, inf)
    """

    def __init__(self, *, rate: float | None = None, paused: bool = False) -> None:
        """Begin paused or not, with this many rounds a second at most, or as many as there can be.

        InputError for a rate of 0 or less, or above `RATE_MAX`.
        """
        self.changed: Callable[[], None] = lambda: None
        """Called after an order was carried out, or a round begun while the run is paused."""
        self._rate = _checked(rate)
        self._paused = paused
        self._steps = 0
        self._due = -math.inf
        self._lock = threading.Lock()

    def left(self) -> float:
        """Return how many seconds the next round is to wait yet; at 0.0 it is taken to begin."""
        with self._lock:
            stepped = self._paused and self._steps > 0
            if self._paused and not stepped:
                return math.inf
            now = time.monotonic()
            if not stepped and now < self._due:
                return self._due - now
            self._steps -= stepped
            if self._rate is not None:
                # Rounds that were a little late do not make all that follow later.
                self._due = max(self._due, now - _LATE_S) + 1 / self._rate
        if stepped:
            self.changed()
        return 0.0

    def order(self, order: str, value: object = None) -> None:
        """Carry out an order: "pause", "resume", "step" by this many rounds, or a "rate" or None.

        A step pauses a run that continues. InputError for others, and for values that none can be.
        """
        rate = _checked(value) if order == "rate" else None
        steps = 0
        if order == "step":
            steps = whole_number("step", 1 if value is None else value, 1)
        elif order not in ORDERS:
            raise InputError(f"order {order!r:.40}: expected one of {', '.join(ORDERS)}")
        with self._lock:
            match order:
                case "rate":
                    self._rate, self._due = rate, -math.inf
                case "resume":
                    self._paused, self._steps = False, 0
                case _:
                    if self._steps + steps > STEPS_MAX:
                        raise InputError(f"step: expected at most {STEPS_MAX} rounds to come")
                    self._paused, self._steps = True, self._steps + steps
        self.changed()

    @property
    def state(self) -> dict[str, Any]:
        """Return ``paused``, the ``steps`` that are to come though it is, and the ``rate``."""
        with self._lock:
            return {"paused": self._paused, "steps": self._steps, "rate": self._rate}


def _checked(rate: object) -> float | None:
    if rate is None:
        return None
    found = real_number("rate", rate)
    if not 0.0 < found <= RATE_MAX:
        raise InputError(
            f"rate={found:g}: expected more than 0 and at most {RATE_MAX:g} rounds a second"
        )
    return found


_SHARE = 10
"""Without rounds all levels are read anew, which takes a tenth of the time at most."""


class LivePage:
    """A page of a run, as a context manager that serves it, and leaves nothing running.

    A run with rounds can be paused and stepped from the page: the thread that advances the run, by
    `step`, `until`, `play` or `run`, then waits before the next round.

    >>> with start("hex:n=4", processes=1, log="logs/live.mcap") as run, LivePage(run) as page:
    ...     page.address.startswith("http://127.0.0.1:")
    ...     run.play().ended
    True
    'goal'
    """

    def __init__(
        self, run: Run, *, port: int = 0, rate: float | None = None, paused: bool = False
    ) -> None:
        """Prepare the page, and serve nothing yet.

        Port 0 is any that is free. A run continues at `rate` rounds a second at most; `paused`, it
        waits until the page lets it continue. InputError if there are no rounds to pace, or a value
        cannot be.
        """
        free = run.plan.is_free
        if free and (paused or rate is not None):
            raise InputError("live: a run without rounds (clock=free) can be watched, not paced")
        self._run = run
        self._port = port
        self._pace = None if free else RoundPacer(rate=rate, paused=paused)
        self._given: list[tuple[Action, ...]] = []
        self._again = 0.0
        self._serving: tuple[Feed, Server] | None = None

    def __enter__(self) -> Self:
        """Serve the page; InputError if nobody can listen at the port."""
        run, pace = self._run, self._pace
        facts = (("rule", run.rule), ("seed", str(run.plan.seed)))
        feed = Feed(run.scene, step_name="level" if pace is None else "round", facts=facts)
        orders = None if pace is None else pace.order
        server = Server(feed, orders, port=self._port)
        self._serving = feed, server
        run.attend(self._watched)
        run.listen(self._hear)
        if pace is not None:
            pace.changed = self._tell
            run.pace = pace.left
            self._tell()
        return self

    def __exit__(self, *_: object) -> None:
        """Tell those who watch how the run stands, and serve nobody any more."""
        if self._serving is None:
            return
        (feed, server), self._serving = self._serving, None
        try:
            feed.end(self._ending(feed))
            server.leave()
        finally:
            feed.close()

    @property
    def address(self) -> str:
        """Return where the page is; it has the token without which nothing is served."""
        if self._serving is None:
            raise CheckError("the page is not served: expected 'with Live(run) as page:'")
        return self._serving[1].address

    def _tell(self) -> None:
        if self._serving is not None and self._pace is not None:
            self._serving[0].tell(self._pace.state)

    def _hear(self, heard: TappedMessage) -> None:
        if self._serving is not None and heard.kind in HEARD:
            self._serving[0].hear(heard.message)

    def _watched(self, gathered: Gathered) -> None:
        """Hand over what is new; in the thread of the run."""
        if self._serving is None:
            return
        if self._pace is not None:
            self._give(gathered, self._serving[0])
            return
        begun = time.monotonic()
        if begun >= self._again:
            self._give(gathered, self._serving[0])
            now = time.monotonic()
            self._again = now + _SHARE * (now - begun)

    def _give(self, gathered: Gathered, feed: Feed) -> None:
        steps, given = gathered.steps, self._given
        place = len(given)
        if self._pace is None:
            found = [step.actions for step in steps]
            both = enumerate(zip(given, found, strict=False))
            known = min(len(given), len(found))
            place = next((at for at, (one, other) in both if one != other), known)
            new = found[place:]
        else:
            new = [step.actions for step in steps[place:]]
        if new or place < len(given):
            given[place:] = new
            feed.give(place, new)

    def _ending(self, feed: Feed) -> dict[str, Any]:
        """Return how the run has ended, with all that was gathered handed over."""
        try:
            self._give(self._run.gathered, feed)
            outcome = self._run.outcome
        except CheckError:
            return {"ended": "left before its end", "error": None}
        return {"ended": outcome.ended, "error": outcome.error}
