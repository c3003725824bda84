"""The event that decided that a run fails, found by playing on from its points with other chances.

A run is played again up to one of its events: a process takes a message, a timer runs out, a fault
happens. From there on delays differ, and the faults that are left come elsewhere. At first few of
these runs fail in the same way, at the end all of them. Bisection finds the event after which more
do.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import sqrt
from random import Random
from typing import Any

from cubepath.coordinator.simulation.faults import SECOND_US, BranchedFaults, Fault
from cubepath.coordinator.simulation.network import Event, Trace
from cubepath.protocol.core.errors import CheckError

_FIRST, _EACH, _PLAYS_MAX = 16, 4, 32
"""How often a run is played on from its start; from another point at least and at most."""
_SIDE, _GRID, _GRID_PLAYS = 24, 16, 8
"""How often before and after the event; the number of other points of the curve; how often there.
"""
_STEPS_MAX = 800_000
"""After this many steps in all no more points are added to the curve."""
_AROUND = 5
"""This many messages before the event are shown, and after it."""
_Z = 1.959964
"""The quantile of the normal distribution for intervals of 95 %."""


@dataclass(slots=True)
class Point:
    """How many of the runs fail whose first events are those of a failing run."""

    event: int
    """The number of these events."""
    seconds: float
    """The virtual time of the last of them."""
    plays: int = 0
    failures: int = 0

    @property
    def share(self) -> float:
        """Return the share of the runs that fail."""
        return self.failures / self.plays if self.plays else 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """Return the 95 % interval of the probability (Wilson 1927)."""
        of = self.plays + _Z * _Z
        middle = (self.failures + _Z * _Z / 2) / of
        spread = self.failures * (1 - self.share) + _Z * _Z / 4
        return max(0.0, middle - _Z * sqrt(spread) / of), min(1.0, middle + _Z * sqrt(spread) / of)

    def document(self) -> dict[str, Any]:
        """Return the point as keys of a document."""
        low, high = (round(each, 4) for each in self.interval)
        return {
            "event": self.event,
            "seconds": self.seconds,
            "plays": self.plays,
            "failures": self.failures,
            "probability": round(self.share, 4),
            "low": low,
            "high": high,
        }


@dataclass(frozen=True, slots=True)
class Cause:
    """Why a run fails: how the probability rises, and after which event."""

    events: int
    """The number of events of the run."""
    points: tuple[Point, ...]
    event: int | None
    """The number of the event after which most runs fail; None if most fail from the start."""
    what: str
    around: tuple[str, ...]
    """The messages around it, one a line, each with its event; the event itself is marked."""

    def document(self) -> dict[str, Any]:
        """Return the value of ``cause`` in ``cubepath simulate --json``."""
        return {
            "events": self.events,
            "event": self.event,
            "what": self.what,
            "around": list(self.around),
            "points": [point.document() for point in self.points],
        }


@dataclass(slots=True)
class _Branches:
    """A failing run, and the runs that have its first events."""

    run: Any  # of the simulator's own kind, as its scenario
    seed: int
    simulator: Any
    played: Callable[[int], object]
    trace: Trace = field(default_factory=Trace)
    steps: list[int] = field(default_factory=lambda: [0])
    """By event its step."""
    faults: list[tuple[Fault, ...]] = field(default_factory=lambda: [()])
    """By event the faults that happen in it."""
    points: dict[int, Point] = field(default_factory=dict)
    spent: int = 0
    """The steps of all runs so far."""
    _asked: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        listed = BranchedFaults(self.run.fired)
        again = self.simulator.play(self.seed, self.run.scenario, listed, self.trace)
        if again.failure != self.run.failure:
            found = "holds" if again.failure is None else again.failure.detail
            raise CheckError(
                f"seed {self.seed}: the same run, played again, {found}; expected the same failure:"
                " what it does depends on something other than its messages"
            )
        self._asked = listed.asked
        fired = [each.fired for each in self.trace.events] + [len(self.run.fired)]
        for step, each in enumerate(self.trace.events, 1):
            if each.what or fired[step] > fired[step - 1]:
                self.steps.append(step)
                self.faults.append(self.run.fired[fired[step - 1] : fired[step]])

    @property
    def last(self) -> int:
        """Return the number of the last event."""
        return len(self.steps) - 1

    def of(self, event: int) -> Event:
        """Return an event by its number, from 1."""
        return self.trace.events[self.steps[event] - 1]

    def point(self, event: int) -> Point:
        """Return the point after an event; 0 is the start."""
        if event not in self.points:
            at_us = self.of(event).at_us if event else 0
            self.points[event] = Point(event, at_us / SECOND_US)
        return self.points[event]

    def play(self, event: int) -> None:
        """Play one more run on from a point."""
        point, step = self.point(event), self.steps[event]
        random = Random(f"{self.seed}/{event}/{point.plays}")  # noqa: S311 - not for secrets
        rest = [fault for faults in self.faults[event + 1 :] for fault in faults]
        faults = BranchedFaults(self.run.fired, step + 1, rest, random, self._asked)
        found = self.simulator.play(self.seed, self.run.scenario, faults)
        point.plays += 1
        same = found.failure is not None and found.failure.kind == self.run.failure.kind
        point.failures += same
        self.spent += found.steps
        self.played(sum(each.plays for each in self.points.values()))

    def above(self, event: int, limit: float) -> bool:
        """Return whether the probability after an event is above a limit, as far as can be told."""
        point = self.point(event)
        while point.plays < _PLAYS_MAX:
            for _ in range(_EACH):
                self.play(event)
            low, high = point.interval
            if not low <= limit <= high:
                break
        return point.share > limit


def cause_of(
    run: Any, seed: int, simulator: Any, played: Callable[[int], object] = lambda _: None
) -> tuple[Cause, Trace]:
    """Return why a failing run of a seed fails, and its trace; the same each time.

    `played` is called with the number of runs so far. CheckError if the run does not fail again.
    """
    branches = _Branches(run, seed, simulator, played)
    low, high = 0, branches.last
    for _ in range(_FIRST):
        branches.play(0)
    branches.play(high)
    always = branches.point(0).share == 1.0
    while high - low > 1 and not always:
        middle = (low + high) // 2
        if branches.above(middle, (1 + branches.point(low).share) / 2):
            high = middle
        else:
            low = middle
    _fill(branches, () if always else (low, high))
    points = tuple(point for _, point in sorted(branches.points.items()))
    if always:
        what = "it fails from the start on, whatever the delays and wherever the faults are"
        return Cause(branches.last, points, None, what, ()), branches.trace
    return Cause(
        branches.last, points, high, _text(branches, high), _around(branches, high)
    ), branches.trace


def _fill(branches: _Branches, sides: tuple[int, ...]) -> None:
    """Play from both sides of the event, and from points that are spread over the whole run."""
    for event in sides:
        while branches.point(event).plays < _SIDE:
            branches.play(event)
    grid = sorted({branches.last * part // _GRID for part in range(_GRID + 1)})
    for plays in range(1, _GRID_PLAYS + 1):
        for event in grid:
            if branches.point(event).plays < plays and branches.spent < _STEPS_MAX:
                branches.play(event)
    for event in [event for event, point in branches.points.items() if not point.plays]:
        del branches.points[event]


def _text(branches: _Branches, number: int) -> str:
    """Return an event in words: when, what happens, and to which message."""
    event, label = branches.of(number), branches.simulator.label
    what = event.what or ("passes on" if event.data else "is hit")
    text = f"event {number}, {event.at_us / 1000:.3f} ms: {event.process} {what}"
    if event.data is not None:
        text += f" {label(event.data)} of {event.sender} ({event.key})"
    faults = ", ".join(f"{fault.kind} at {fault.where}" for fault in branches.faults[number])
    return text + (f"; fault: {faults}" if faults else "")


def _around(branches: _Branches, event: int) -> tuple[str, ...]:
    """Return what processes take before and after an event, and the faults among that."""

    def told(number: int) -> bool:
        each = branches.of(number)
        return each.data is not None or bool(branches.faults[number])

    before = [number for number in range(1, event) if told(number)][-_AROUND:]
    after = [number for number in range(event + 1, branches.last + 1) if told(number)][:_AROUND]
    return tuple(
        f"{'>' if number == event else ' '} {_text(branches, number)}"
        for number in (*before, event, *after)
    )
