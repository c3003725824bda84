"""A failing run made small: fewer modules, fewer rounds and fewer faults, as long as it fails so.

The faults of a run are a list, so taking one away leaves the others where they are: first halves of
the list are tried, then smaller parts (delta debugging, Zeller, 1999).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Generic, Protocol, Self, TypeVar

from cubepath.coordinator.simulation.faults import Fault, Faults, Listed

_RUNS_MAX = 250
"""How many runs are tried in all."""
_DRAWS = 12
"""How often faults are drawn anew for a scenario with fewer modules."""


class Failed(Protocol):
    """What did not hold of a run."""

    @property
    def kind(self) -> str:
        """Return the kind by which failures are the same."""
        ...


class Shrinkable(Protocol):
    """What a seed stands for."""

    def smaller(self) -> Sequence[Self]:
        """Return the same with fewer modules and processes, the smallest first."""
        ...

    def shorter(self, long: int) -> Sequence[Self]:
        """Return the same with less to do than a run of this length did."""
        ...

    def plainer(self) -> Sequence[Self]:
        """Return the same with fewer peculiarities."""
        ...


class SimulatedRun(Protocol):
    """A run that may have failed."""

    @property
    def scenario(self) -> Any:
        """Return what it was of."""
        ...

    @property
    def fired(self) -> tuple[Fault, ...]:
        """Return the faults that came to pass."""
        ...

    @property
    def failure(self) -> Failed | None:
        """Return what did not hold, if anything."""
        ...

    @property
    def long(self) -> int:
        """Return how much it did, in rounds or moves."""
        ...


_Run = TypeVar("_Run", bound=SimulatedRun)
Play = Callable[[Any, Faults], _Run]
"""Simulates a scenario under faults."""
Draw = Callable[[Any, str], Faults]
"""Draws faults for a scenario, from a text."""


class _Shrinking(Generic[_Run]):
    """The smallest failing run so far, and how many more may be tried."""

    def __init__(self, found: _Run, play: Play[_Run], draw: Draw) -> None:
        self.best = found
        self.left = _RUNS_MAX
        self._play = play
        self._draw = draw

    def fails(self, scenario: Shrinkable, faults: Faults) -> bool:
        """Try a run; return whether it fails in the same way, and take it if it does."""
        if self.left == 0:
            return False
        self.left -= 1
        tried = self._play(scenario, faults)
        if (tried.failure and tried.failure.kind) != (self.best.failure and self.best.failure.kind):
            return False
        self.best = tried
        return True

    def shorter(self) -> None:
        for scenario in self.best.scenario.shorter(max(1, self.best.long)):
            if self.fails(scenario, Listed(self.best.fired)):
                return

    def plainer(self) -> None:
        for scenario in self.best.scenario.plainer():
            if self.fails(scenario, Listed(self.best.fired)):
                return

    def fewer_modules(self) -> None:
        for scenario in self.best.scenario.smaller():
            if any(self.fails(scenario, faults) for faults in self._faults_for(scenario)):
                return

    def _faults_for(self, scenario: Shrinkable) -> Iterable[Faults]:
        fired = self.best.fired
        yield Listed(fired)
        for number in range(_DRAWS if fired else 0):
            yield self._draw(scenario, f"{number}/smaller")

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


def shrunk(found: _Run, play: Play[_Run], draw: Draw) -> _Run:
    """Return the smallest run found that fails in the same way as a failing run."""
    if found.failure is None:
        raise ValueError("a run that holds has nothing to shrink")
    shrinking = _Shrinking(found, play, draw)
    while shrinking.left:
        before = shrinking.best
        shrinking.shorter()
        shrinking.fewer_modules()
        shrinking.fewer_faults()
        shrinking.plainer()
        if shrinking.best is before:
            break
    return shrinking.best
