"""How near `simulate --why` comes to the event at which a planted bug did what is wrong."""

import time
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from cubepath.coordinator.simulation.causes import _Branches, cause_of
from cubepath.coordinator.simulation.faults import ListedFaults
from cubepath.coordinator.simulation.scenarios import ScenarioOptions
from cubepath.coordinator.simulation.swarm import FreeSwarm, LockstepSwarm, shrunk
from exploration.planted import WRONG, ForgetsCounts, IsDeaf, Raises, TakesDoubles
from exploration.planted_keepers import PLANTED

RESTLESS = f"{Path(__file__).parents[1] / 'samples' / 'restless.py'}:RESTLESS"
_LINES = ScenarioOptions("hex", "chain")
_FREE = ScenarioOptions(rule="random", clock="free")
_GUARDED = ScenarioOptions("agv:graph=grid2x9,n=6", RESTLESS, clock="free")
_SEEDS_MAX = 600


@cache
def planted() -> dict[str, tuple[Any, int]]:
    """Return by bug a simulator that has it, and from which seed on to look for it."""
    nodes = (TakesDoubles, ForgetsCounts, Raises, IsDeaf)
    found: dict[str, tuple[Any, int]] = {
        node.__name__: (LockstepSwarm(_LINES, node), 0) for node in nodes
    }
    for name, keeper in PLANTED.items():
        asked = _GUARDED if name == "locks no guards" else _FREE
        found[name] = FreeSwarm(asked, keeper), 100 if name == "forgets fences" else 0
    return found


class Verdict(NamedTuple):
    """What was found of a bug; the guilty event is its first wrong act without which all is well.

    It ends with the first event that this act changes.
    """

    seed: int
    events: int
    guilty: tuple[int, int]
    named: tuple[int, ...]
    """The event that decided it; if that is a fault, the last one as well."""
    seconds: float
    """Processor time."""

    @property
    def distance(self) -> int | None:
        """Return how far the guilty event is from the nearest named; None if none is named."""
        begin, end = self.guilty
        return min((max(0, begin - each, each - end) for each in self.named), default=None)


def judged(name: str) -> Verdict:
    """Find the first seed that fails with a bug, shrink it, and ask why it fails."""
    simulator, first = planted()[name]
    for seed in range(first, first + _SEEDS_MAX):
        WRONG.again()
        failing = simulator.run_of(seed)
        # One that fails without the bug's acts is no run of this bug.
        if failing.failure is not None and _acts(simulator, shrunk(failing, seed, simulator), seed):
            break
    else:
        raise AssertionError(f"{name}: no seed fails")
    run = shrunk(failing, seed, simulator)
    begin, end = _acts(simulator, run, seed) or (0, 0)
    WRONG.again()
    began = time.process_time()
    cause, _ = cause_of(run, seed, simulator)
    seconds = time.process_time() - began
    steps = _Branches(run, seed, simulator, lambda _: None).steps
    guilty = tuple(_event(steps, each) for each in (begin, end))
    named = () if cause.event is None else (cause.event, *[cause.events] * cause.fault)
    return Verdict(seed, cause.events, (guilty[0], guilty[1]), named, seconds)


def _event(steps: list[int], step: int) -> int:
    """Return the number of the last event that is no later than a step."""
    return sum(each <= step for each in steps) - 1


def _acts(simulator: Any, run: Any, seed: int) -> tuple[int, int] | None:
    """Return the step of the guilty act, and of the first difference it makes."""

    def play(right: int) -> bool:
        trace = WRONG.again(right)
        listed = ListedFaults(run.fired)
        return bool(simulator.play(seed, run.scenario, listed, trace).failure == run.failure)

    if not play(0):
        return None
    few, many = 0, len(WRONG.steps)
    if play(many):
        return None
    while many - few > 1:
        middle = (few + many) // 2
        few, many = (middle, many) if play(middle) else (few, middle)
    play(few)
    wrong, at = WRONG.trace.events, WRONG.steps[few]
    play(many)
    right = WRONG.trace.events
    pairs = enumerate(zip(wrong, right, strict=False), 1)
    return at, next((step for step, (one, other) in pairs if one != other), len(wrong))
