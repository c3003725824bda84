"""A failing run made small: fewer modules, fewer rounds and fewer faults, as long as it fails so.

Room: coordinator. The faults of a run are a list, so taking one away leaves the others where they
are: first halves of the list are tried, then smaller parts (delta debugging, Zeller, 1999).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from random import Random

from cubepath.coordinator.simulation.faults import LIES, Drawn, Fault, Faults, Listed
from cubepath.coordinator.simulation.scenarios import Scenario
from cubepath.coordinator.simulation.simulated import (
    COORDINATOR,
    PATIENCE_US,
    MakeNode,
    Simulated,
    host_node,
    process_names,
    simulate,
)

_RUNS_MAX = 250
"""How many runs are tried in all."""
_DRAWS = 12
"""How often faults are drawn anew for a scenario with fewer modules."""


class _Shrinking:
    """The smallest failing run so far, and how many more may be tried."""

    def __init__(self, found: Simulated, fault_seed: int, make: MakeNode) -> None:
        self.best = found
        self.left = _RUNS_MAX
        self._fault_seed = fault_seed
        self._make = make

    def fails(self, scenario: Scenario, faults: Faults) -> bool:
        """Try a run; return whether it fails in the same way, and take it if it does."""
        if self.left == 0:
            return False
        self.left -= 1
        tried = simulate(scenario, faults, fault_seed=self._fault_seed, make=self._make)
        if (tried.failure and tried.failure.kind) != (self.best.failure and self.best.failure.kind):
            return False
        self.best = tried
        return True

    def fewer_rounds(self) -> None:
        rounds = max(1, self.best.rounds)
        for most in sorted({1, 2, 3, rounds // 4, rounds // 2, rounds - 1, rounds}):
            scenario = self.best.scenario
            if 0 < most < scenario.max_rounds and self.fails(
                replace(scenario, max_rounds=most), Listed(self.best.fired)
            ):
                return

    def plainer(self) -> None:
        scenario = self.best.scenario
        if scenario.hesitate:
            self.fails(replace(scenario, hesitate=0.0), Listed(self.best.fired))

    def fewer_modules(self) -> None:
        for scenario in self.best.scenario.smaller():
            if any(self.fails(scenario, faults) for faults in self._faults_for(scenario)):
                return

    def _faults_for(self, scenario: Scenario) -> Iterable[Faults]:
        fired = self.best.fired
        yield Listed(fired)
        if not fired:
            return
        lying = any(fault.kind in LIES for fault in fired)
        for number in range(_DRAWS):
            random = Random(f"{self._fault_seed}/{number}/smaller")  # noqa: S311 - not for secrets
            lies = Random(f"{self._fault_seed}/{number}/lies") if lying else None  # noqa: S311
            yield Drawn(random, COORDINATOR, process_names(scenario), PATIENCE_US, lies)

    def fewer_faults(self) -> None:
        if self.best.fired and self.fails(self.best.scenario, Listed(())):
            return
        for kind in sorted({fault.kind for fault in self.best.fired}):
            self._without(kind)
        parts = 2
        while len(self.best.fired) > 1 and self.left:
            size = -(-len(self.best.fired) // parts)
            if any(self._drop(start, size) for start in range(0, len(self.best.fired), size)):
                parts = max(2, parts - 1)
            elif size == 1:
                break
            else:
                parts = min(2 * parts, len(self.best.fired))
        fired = self.best.fired
        if len(fired) > 1:
            any(self._keep([fault]) for fault in fired)

    def _without(self, kind: str) -> bool:
        return self._keep([fault for fault in self.best.fired if fault.kind != kind])

    def _drop(self, start: int, size: int) -> bool:
        return self._keep([*self.best.fired[:start], *self.best.fired[start + size :]])

    def _keep(self, kept: Sequence[Fault]) -> bool:
        """Try with these faults only; what then happens may be fewer, but not more."""
        before = self.best
        if self.fails(before.scenario, Listed(kept)) and len(self.best.fired) < len(before.fired):
            return True
        self.best = before
        return False


def shrunk(found: Simulated, fault_seed: int, *, make: MakeNode = host_node) -> Simulated:
    """Return the smallest run found that fails in the same way as a failing run."""
    if found.failure is None:
        raise ValueError("a run that holds has nothing to shrink")
    shrinking = _Shrinking(found, fault_seed, make)
    while shrinking.left:
        before = shrinking.best
        shrinking.fewer_rounds()
        shrinking.fewer_modules()
        shrinking.fewer_faults()
        shrinking.plainer()
        if shrinking.best is before:
            break
    return shrinking.best
