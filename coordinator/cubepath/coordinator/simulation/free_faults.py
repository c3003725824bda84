"""Faults of runs without rounds: at any time and place, until they are over.

Nothing ends such a run, so what happens may take as long as it likes; after the faults every
process is back, or gone for good.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from random import Random

from cubepath.coordinator.simulation.faults import (
    ON_HOPS,
    ROUTER,
    SECOND_US,
    SWITCHED_OFF,
    Fault,
    Faults,
    between,
)

FREE_KINDS = (
    *ON_HOPS,
    "drag",
    "pause",
    "slow",
    "stall",
    "return",
    "cut",
    "torn",
    "leave",
    "crash",
    "late",
    "router",
    "partition",
)
"""Beside those of a run with rounds: a link is slow for a while; a process is killed after it has
written, and before it has said, what follows from a message, or while it writes that; a module
process leaves, and perhaps comes back, or comes late; some processes do not hear the others."""
_HOPS: Mapping[str, tuple[float, float]] = {
    "delay": (0.003, 0.3),
    "reorder": (0.003, 0.4),
    "duplicate": (0.003, 0.5),
    "loss": (0.003, 0.2),
    "drag": (0.0003, 0.01),
}
_HOST: Mapping[str, tuple[float, float]] = {
    "pause": (0.0005, 0.02),
    "slow": (0.0005, 0.01),
    "stall": (0.0002, 0.003),
    "return": (0.0005, 0.06),
    "cut": (0.0005, 0.06),
    "leave": (0.0002, 0.005),
    "crash": (0.0002, 0.004),
}
_KEEPER: Mapping[str, tuple[float, float]] = {
    "pause": (0.0005, 0.02),
    "slow": (0.0005, 0.01),
    "stall": (0.0002, 0.003),
    "return": (0.0005, 0.02),
    "cut": (0.001, 0.04),
    "torn": (0.001, 0.04),
}
_ROUTER: Mapping[str, tuple[float, float]] = {
    "router": (0.0002, 0.004),
    "partition": (0.0002, 0.006),
}
_START: Mapping[str, tuple[float, float]] = {"late": (0.05, 0.5)}
"""The least and the greatest rate of a kind: per hop, per message taken, per message routed,
and per module process at its start."""
_AMOUNTS_US: Mapping[str, tuple[float, float]] = {
    "delay": (300, 2 * SECOND_US),
    "reorder": (300, 5 * SECOND_US),
    "duplicate": (300, 10 * SECOND_US),
    "drag": (1000, 0.5 * SECOND_US),
    "pause": (100, 2 * SECOND_US),
    "slow": (100, 0.1 * SECOND_US),
    "stall": (11 * SECOND_US, 30 * SECOND_US),
    "return": (1000, 3 * SECOND_US),
    "cut": (1000, 3 * SECOND_US),
    "torn": (1000, 3 * SECOND_US),
    "late": (0.1 * SECOND_US, 10 * SECOND_US),
    "leave": (2 * SECOND_US, 15 * SECOND_US),
    "router": (1000, 5 * SECOND_US),
    "partition": (1000, 12 * SECOND_US),
}
STARTS = " starts"
"""Where a process starts is its name with this."""
_FOR_GOOD = 0.3
"""How probable it is that a process that leaves does not come back."""
_OUTAGES_US = 40 * SECOND_US
"""How long processes are away in a run, all together: faults are many rather than long."""
_BRIEF_US = 0.01 * SECOND_US

_Table = list[tuple[float, str]]


class FreeDrawn:
    """Faults at random: kinds are switched off and rates drawn for the whole run, then each fault.

    A seed in eight has no fault at all.
    """

    def __init__(self, random: Random, hosts: Iterable[str], keepers: Iterable[str]) -> None:
        """Draw the rates, of module processes and keepers each; others have faults on links."""
        self._random = random
        self._left_us = float(_OUTAGES_US)
        quiet = random.random() < 1 / 8
        off = {kind for kind in FREE_KINDS if quiet or random.random() < SWITCHED_OFF}
        self._hops = self._table(_HOPS, off)
        self._router = self._table(_ROUTER, off)
        host, keeper = self._table(_HOST, off), self._table(_KEEPER, off)
        names = list(hosts)
        start = self._table(_START, off)
        self._processes = dict.fromkeys(names, host) | dict.fromkeys(keepers, keeper)
        self._processes |= {name + STARTS: start for name in names}

    def _table(self, rates: Mapping[str, tuple[float, float]], off: set[str]) -> _Table:
        """Return the kinds, each with the sum of the rates so far, the largest first."""
        drawn = [
            (between(self._random, *bounds), kind)
            for kind, bounds in rates.items()
            if kind not in off
        ]
        found, total = [], 0.0
        for rate, kind in sorted(drawn, reverse=True):
            total += rate
            found.append((total, kind))
        return found

    def _drawn(self, table: _Table | None, where: str, nth: int) -> Fault | None:
        if not table:
            return None
        one = self._random.random()
        if one >= table[-1][0]:
            return None
        kind = next(kind for total, kind in table if one < total)
        amount = self._long(kind)
        if kind not in _HOPS and amount > _BRIEF_US:
            if amount > self._left_us:
                return None
            self._left_us -= amount
        return Fault(where, nth, kind, amount)

    def _long(self, kind: str) -> int:
        if kind == "leave" and self._random.random() < _FOR_GOOD:
            return 0
        bounds = _AMOUNTS_US.get(kind)
        return 0 if bounds is None else int(between(self._random, *bounds))

    def on_hop(self, where: str, nth: int) -> Fault | None:
        """Draw whether something happens to a message."""
        return self._drawn(self._hops, where, nth)

    def on_process(self, where: str, nth: int) -> Fault | None:
        """Draw whether something happens to a process."""
        return self._drawn(self._processes.get(where), where, nth)

    def on_router(self, nth: int) -> Fault | None:
        """Draw whether the router dies, or some processes do not hear the others."""
        return self._drawn(self._router, ROUTER, nth)

    def on_saying(self, where: str, nth: int, kinds: Sequence[str]) -> Fault | None:
        """Return None: nobody lies."""

    @property
    def liars(self) -> frozenset[str]:
        """Return no names."""
        return frozenset()


class Ending:
    """Faults that happen as long as they are not over."""

    def __init__(self, faults: Faults, over: Callable[[], bool]) -> None:
        """Ask `faults`, until `over` says that there are no more."""
        self._faults = faults
        self._over = over

    def on_hop(self, where: str, nth: int) -> Fault | None:
        """Return what happens to a message."""
        return None if self._over() else self._faults.on_hop(where, nth)

    def on_process(self, where: str, nth: int) -> Fault | None:
        """Return what happens to a process."""
        return None if self._over() else self._faults.on_process(where, nth)

    def on_router(self, nth: int) -> Fault | None:
        """Return what happens to the router."""
        return None if self._over() else self._faults.on_router(nth)

    def on_saying(self, where: str, nth: int, kinds: Sequence[str]) -> Fault | None:
        """Return what a liar says."""
        return None if self._over() else self._faults.on_saying(where, nth, kinds)

    @property
    def liars(self) -> frozenset[str]:
        """Return the names of those who may lie."""
        return self._faults.liars
