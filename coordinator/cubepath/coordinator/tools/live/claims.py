"""What modules say while a run goes on, step by step: claims with their outcomes, and deliveries.

A message may come after the step that it belongs to; then the step is told again. What strangers
say at an open router, and what cannot be, is passed over.
"""

from __future__ import annotations

from itertools import chain
from typing import Any, TypeAlias

from cubepath.coordinator.tools.viewing.run_view import (
    DELIVERIES_MAX,
    Entry,
    claim_entry,
    delivery_entries,
)
from cubepath.coordinator.tools.viewing.worlds import NumberedWorld
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.wire.free_messages import (
    Attempt,
    Commit,
    CommitLog,
    Decision,
    Forwarded,
    FreeMessage,
)
from cubepath.protocol.wire.messages import Claim, Message, Report

HEARD = ("claim", "report", "attempt", "forwarded", "decision", "commit", "commits")
"""The kinds of messages, and of their parts, that are of use here."""
_KEPT = 64
"""A step can be told again until so many others have followed."""
_NO_SITE = (CubepathError, TypeError, ValueError, LookupError, AttributeError, OverflowError)
"""What systems raise for a value that is none of their sites."""
_Key: TypeAlias = tuple[int, ...]
Words: TypeAlias = Message | FreeMessage | Attempt | Forwarded | Decision
"""A message, or a part of one."""


class ClaimListener:
    """The claims and deliveries of a run, by the steps of a page, which count from 1."""

    def __init__(self, world: NumberedWorld, *, free: bool, before: int = 0) -> None:
        """Begin with nothing heard; so many rounds lie before the first step of the page."""
        self._world = world
        self._count = len(world.scene.start)
        self._free = free
        self._before = before
        self._top = 0
        """The greatest level of a move so far, without rounds."""
        self._claims: dict[int, dict[_Key, tuple[int, str, Site, Site]]] = {}
        """For each step its claims: the module, the generator, its place, and where it stands."""
        self._step_of: dict[_Key, int] = {}
        self._outcomes: dict[_Key, str] = {}
        self._heard: dict[int, dict[int, list[Entry]]] = {}
        self._kinds: dict[str, int] = {}
        self._deliveries = 0
        self._changed: set[int] = set()

    def begin(self) -> dict[str, Any]:
        """Return the fields of a path in which nothing was heard yet."""
        claims: dict[str, Any] = {"ends": [], "module": [], "row": [], "won": []}
        heard: dict[str, Any] = {"kinds": [], "ends": [], "kind": [], "from": [], "to": []}
        return {"claims": claims} if self._free else {"claims": claims, "heard": heard}

    def take(self, message: Words) -> None:
        """Take a message, or a part of one."""
        match message:
            case Claim():
                key = message.module, message.round
                self._claim(key, message.round - self._before, message)
            case Report():
                self._report(message)
            case CommitLog():
                for moved in message.parts:
                    self._moved(moved)
            case Commit():
                self._moved(message)
            case Forwarded():
                self._attempt(message.attempt)
            case Attempt():
                self._attempt(message)
            case Decision():
                self._decision(message)
            case _:
                pass

    def _attempt(self, attempt: Attempt) -> None:
        # It is said before anybody can know its level: that is above all that it may have seen.
        if attempt.generator is not None:
            self._claim((attempt.module, attempt.epoch, attempt.number), self._top + 1, attempt)

    def _decision(self, decision: Decision) -> None:
        key = decision.module, decision.epoch, decision.number
        if decision.commit is not None:
            self._moved(decision.commit)
        elif key not in self._outcomes:
            self._came(key, "lost")

    def _moved(self, moved: Commit) -> None:
        self._top = max(self._top, moved.level)
        self._came((moved.module, moved.epoch, moved.number), "granted")

    def told(self, steps: int) -> dict[str, Any] | None:
        """Return what is new of the first so many steps; None if nothing is.

        Each list of ``claims`` and of ``heard`` is that of a whole step, three numbers for each
        entry. With more deliveries than a page holds there are none, and ``left_out`` has their
        number so far.
        """
        ready = sorted(step for step in self._changed if step <= steps)
        if not ready:
            return None
        self._changed.difference_update(ready)
        found: dict[str, Any] = {"claims": [self._claims_of(step) for step in ready]}
        if self._deliveries > DELIVERIES_MAX:
            found["left_out"] = self._deliveries
            self._heard.clear()
        elif not self._free:
            found["kinds"] = list(self._kinds)
            found["heard"] = [[step, self._heard_in(step)] for step in ready]
        for step in [step for step in self._claims if step <= steps - _KEPT]:
            self._forget(step)
        return found

    def _claims_of(self, step: int) -> list[Any]:
        claims = sorted(self._claims.get(step, {}).items())
        entries = (
            claim_entry(self._world, *claim, outcome=self._outcomes.get(key, ""))
            for key, claim in claims
        )
        return [step, list(chain.from_iterable(entry for entry in entries if entry is not None))]

    def _heard_in(self, step: int) -> list[int]:
        entries = chain.from_iterable(self._heard.get(step, {}).values())
        return list(chain.from_iterable(sorted(entries)))

    def _forget(self, step: int) -> None:
        for key in self._claims.pop(step):
            del self._step_of[key]
            self._outcomes.pop(key, None)
        self._heard.pop(step, None)

    def _claim(self, key: _Key, step: int, said: Claim | Attempt) -> None:
        if step < 1 or said.module >= self._count or key in self._step_of:
            return
        try:
            at, site = site_from_json(said.at), site_from_json(said.site)
            self._world.scene.system.move_named(site, str(said.generator), at)
        except _NO_SITE:
            return
        self._step_of[key] = step
        claims = self._claims.setdefault(step, {})
        claims[key] = said.module, str(said.generator), at, site
        self._changed.add(step)

    def _came(self, key: _Key, outcome: str) -> None:
        if self._outcomes.get(key) != outcome and (not self._free or key in self._step_of):
            self._outcomes[key] = outcome
            if key in self._step_of:
                self._changed.add(self._step_of[key])

    def _report(self, report: Report) -> None:
        step, module = report.round - self._before, report.module
        if step < 1 or module >= self._count:
            return
        if report.claim != "none":
            self._came((module, report.round), report.claim)
        heard = self._heard.setdefault(step, {})
        if module in heard:
            return
        entries = [each for each in delivery_entries(report, self._kinds) if each[1] < self._count]
        self._deliveries += len(entries)
        heard[module] = entries if self._deliveries <= DELIVERIES_MAX else []
        self._changed.add(step)
