"""The event that decided that a run fails, found by playing on from its points with other chances.

A run is played again up to one of its events: a process takes a message, comes back, or puts
something since its timer has run out, or a fault happens. From there on delays differ, and the
faults that are left come elsewhere. At first few of these runs fail in the same way, at the end all
of them; bisection finds the event after which more do.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from itertools import chain
from random import Random
from typing import Any

from cubepath.coordinator.simulation.faults import (
    ROUTER,
    SECOND_US,
    BranchedFaults,
    Fault,
    ListedFaults,
)
from cubepath.coordinator.simulation.network import Event, Trace
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.core.statistics import share_interval

_FIRST, _EACH, _PLAYS_MAX = 16, 4, 32
"""How often a run is played on from its start; from another point at least and at most."""
_SIDE, _GRID, _GRID_PLAYS = 24, 16, 8
"""How often before and after the event; the number of other points of the curve; how often there.
"""
_STEPS_MAX = 800_000
"""After this many steps in all no more points are added to the curve."""
_AROUND = 5
"""This many messages before the event are shown, and after it; and before the last."""


@dataclass(slots=True)
class Point:
    """How many of the runs fail that share this many first events with a failing run."""

    event: int
    seconds: float
    """The virtual time of the last of these events."""
    plays: int = 0
    failures: int = 0

    @property
    def share(self) -> float:
        """Return the share of the runs that fail."""
        return self.failures / self.plays

    @property
    def interval(self) -> tuple[float, float]:
        """Return the 95 % interval of the probability."""
        found = share_interval(self.failures, self.plays)
        return found.low or 0.0, found.high or 0.0


@dataclass(frozen=True, slots=True)
class Cause:
    """Why a run fails: how the probability rises, and after which event."""

    events: int
    """The number of events of the run."""
    points: tuple[Point, ...]
    event: int | None
    """The number of the event after which most runs fail; None if they do so from the start."""
    what: str
    around: tuple[str, ...] = ()
    """The messages around it, one a line; the event itself is marked. With `fault` also the last.
    """
    fault: bool = False
    """Whether a fault decided it; what is wrong then comes later, and shows in the last event."""
    place: tuple[int, str] | None = None
    """When it was, in microseconds, and at which process, or from which if it is the router's."""

    def document(self) -> dict[str, Any]:
        """Return the value of ``cause`` in ``cubepath simulate --json``."""
        found = asdict(self)
        del found["place"]
        for point, keys in zip(self.points, found["points"], strict=True):
            keys["probability"], (keys["low"], keys["high"]) = point.share, point.interval
        return found


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
        listed = ListedFaults(self.run.fired)
        again = self.simulator.play(self.seed, self.run.scenario, listed, self.trace)
        if again.failure != self.run.failure:
            raise CheckError(
                f"seed {self.seed}: fails in another way or not at all when the same run is played"
                " again, expected a rule that depends on nothing but what it is given"
            )
        self._asked = listed.asked
        events, fired = self.trace.events, self.run.fired
        put = {(arrow.sender, arrow.begin_us) for arrow in self.trace.arrows}
        ends = [*(each.fired for each in events[1:]), len(fired)]
        for step, (each, end) in enumerate(zip(events, ends, strict=True), 1):
            idle = each.what == "timer runs out" and (each.process, each.at_us) not in put
            if (each.what and not idle) or end > each.fired or step == len(events):
                self.steps.append(step)
                self.faults.append(fired[each.fired : end])

    @property
    def last(self) -> int:
        """Return the number of the last event."""
        return len(self.steps) - 1

    def of(self, event: int) -> Event:
        """Return an event by its number, from 1."""
        return self.trace.events[self.steps[event] - 1]

    def play(self, event: int, plays: int) -> None:
        """Play on from a point until that was done this often."""
        seconds = self.of(event).at_us / SECOND_US if event else 0.0
        point = self.points.setdefault(event, Point(event, seconds))
        while point.plays < plays:
            random = Random(f"{self.seed}/{event}/{point.plays}")  # noqa: S311 - not for secrets
            rest = list(chain.from_iterable(self.faults[event + 1 :]))
            listed = ListedFaults(self.run.fired)
            faults = BranchedFaults(listed, self.steps[event] + 1, rest, random, self._asked)
            found = self.simulator.play(self.seed, self.run.scenario, faults)
            point.plays += 1
            point.failures += (found.failure and found.failure.kind) == self.run.failure.kind
            self.spent += found.steps
            self.played(sum(each.plays for each in self.points.values()))

    def above(self, event: int, limit: float) -> bool:
        """Return whether the probability after an event is above a limit, as far as can be told."""
        for plays in range(_EACH, _PLAYS_MAX + 1, _EACH):
            self.play(event, plays)
            low, high = self.points[event].interval
            if not low <= limit <= high:
                break
        return self.points[event].share > limit

    def text(self, number: int) -> str:
        """Return an event in words: when, what happens, and to which message."""
        event = self.of(number)
        text = f"event {number}, {event.at_us / 1000:.3f} ms: {event.process}"
        text += f" {event.what or 'passes on' if event.put or event.what else 'is hit'}"
        if event.put is not None:
            text += f" {self.simulator.label(event.put.data)} of {event.sender} ({event.put.key})"
        faults = ", ".join(f"{fault.kind} at {fault.where}" for fault in self.faults[number])
        return text + (f"; fault: {faults}" if faults else "")

    def around(self, event: int) -> tuple[str, ...]:
        """Return what processes take before and after an event, and the faults among that."""
        told = [
            number
            for number in range(1, self.last + 1)
            if number in (event, self.last) or self.of(number).put or self.faults[number]
        ]
        place = told.index(event)
        shown = {*told[max(0, place - _AROUND) : place + _AROUND + 1]}
        if self.faults[event]:
            shown.update(told[-_AROUND - 1 :])
        lines = ((">" if each == event else " ", self.text(each)) for each in sorted(shown))
        return tuple(f"{mark} {text}" for mark, text in lines)


def cause_of(
    run: Any, seed: int, simulator: Any, played: Callable[[int], object] = lambda _: None
) -> tuple[Cause, Trace]:
    """Return why a failing run of a seed fails, and its trace; the same each time.

    `played` is called with the number of runs so far. CheckError if the run does not fail again.
    """
    branches = _Branches(run, seed, simulator, played)
    points, low, high = branches.points, 0, branches.last
    branches.play(0, _FIRST)
    always = points[0].share == 1.0
    while high - low > 1 and not always:
        middle = (low + high) // 2
        if branches.above(middle, (1 + points[low].share) / 2):
            high = middle
        else:
            low = middle
    for event in () if always else (low, high):
        branches.play(event, _SIDE)
    grid = [branches.last * part // _GRID for part in range(_GRID + 1)]
    for plays in range(1, _GRID_PLAYS + 1):
        for event in grid:
            if branches.spent < _STEPS_MAX:
                branches.play(event, plays)
    curve = tuple(points[event] for event in sorted(points))
    if always:
        what = "it fails from the start on, whatever the delays and wherever the faults are"
        return Cause(branches.last, curve, None, what), branches.trace
    named = branches.of(high)
    place = named.at_us, named.sender if named.process == ROUTER else named.process
    return Cause(
        events=branches.last,
        points=curve,
        event=high,
        what=branches.text(high),
        around=branches.around(high),
        fault=bool(branches.faults[high]),
        place=place if place[1] else None,
    ), branches.trace
