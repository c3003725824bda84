"""A run of one's own as a page that is fed while it goes on.

It listens to the run and paces it; it takes no part in it.
"""

from __future__ import annotations

import time
from types import TracebackType
from typing import Any, Self

from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.running import Running
from cubepath.coordinator.runs.tap import Overheard
from cubepath.coordinator.tools.live.feed import Feed
from cubepath.coordinator.tools.live.hearing import HEARD
from cubepath.coordinator.tools.live.pacing import Pace
from cubepath.coordinator.tools.live.server import Server
from cubepath.coordinator.tools.viewing.pages import page_text
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import CheckError, InputError

_SHARE = 10
"""Without rounds all levels are read anew, which takes a tenth of the time at most."""


class Live:
    """A page of a run, as a context manager that serves it, and leaves nothing running.

    A run with rounds can be paused and stepped from the page: whoever goes on with the run, by
    `step`, `until`, `play` or `run`, then waits before the next round.

    >>> with start("hex:n=4", processes=1, log="logs/live.mcap") as run, Live(run) as page:
    ...     page.address.startswith("http://127.0.0.1:")
    ...     run.play().ended
    True
    'goal'
    """

    def __init__(
        self,
        run: Running,
        *,
        port: int = 0,
        rate: float | None = None,
        paused: bool = False,
    ) -> None:
        """Prepare the page, and serve nothing yet.

        Port 0 is any that is free. A run goes on at `rate` rounds a second at most; `paused`, it
        waits until the page lets it go on. InputError if there are no rounds to pace, or a value
        cannot be.
        """
        free = run.plan.is_free
        if free and (paused or rate is not None):
            raise InputError("live: a run without rounds (clock=free) can be watched, not paced")
        self._run = run
        self._port = port
        self._pace = None if free else Pace(rate=rate, paused=paused)
        self._given: list[tuple[Action, ...]] = []
        self._again = 0.0
        self._serving: tuple[Feed, Server] | None = None

    def __enter__(self) -> Self:
        """Serve the page; InputError if nobody can listen at the port."""
        run, pace = self._run, self._pace
        facts = (("rule", run.rule), ("seed", str(run.plan.seed)))
        feed = Feed(run.scene, step_name="level" if pace is None else "round", facts=facts)
        orders = None if pace is None else pace.order
        try:
            server = Server(page_text(feed.document, live=True), feed, orders, port=self._port)
        except BaseException:
            feed.close()
            raise
        self._serving = feed, server
        run.attend(self._watched)
        run.listen(self._hear)
        if pace is not None:
            pace.changed = self._tell
            run.pace = pace.left
            self._tell()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
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

    def _hear(self, heard: Overheard) -> None:
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
