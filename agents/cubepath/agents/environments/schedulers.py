"""Who acts next under the free clock, in one process.

Each of them lets every module act again and again, and follows from the seed and from what came of
the turns so far.
"""

from __future__ import annotations

from collections.abc import Mapping
from heapq import heapify, heapreplace
from numbers import Real
from typing import Protocol

import numpy as np

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.given import real_number

_TICKS = 1000
"""Between two turns of a module with speed factor 1, on average."""
_PATIENCE = 30
"""An unfair scheduler lets a module wait for so many turns for each module that there is."""


class Scheduler(Protocol):
    """Chooses who acts."""

    def next(self, *, committed: bool) -> int:
        """Return which module acts, given what came of the turn before; False at first."""
        raise NotImplementedError

    @property
    def time(self) -> float:
        """Return when the last turn began; a module of speed factor 1 takes 1 for a turn."""
        raise NotImplementedError


class Turns:
    """One after the other, by number."""

    def __init__(self, modules: int) -> None:
        """Begin with module 0."""
        self._modules = modules
        self._next = self._turns = 0

    def next(self, *, committed: bool) -> int:
        """Return the next number."""
        del committed
        found, self._next = self._next, (self._next + 1) % self._modules
        self._turns += 1
        return found

    @property
    def time(self) -> float:
        """Return how many turns each module has had before, on average."""
        return max(self._turns - 1, 0) / self._modules


class AtRandom:
    """Each at a pace of its own: with factor f a module acts f times more rarely than with 1.

    The time between two of its turns is drawn from 1 - `jitter` to 1 + `jitter` times the average.
    """

    def __init__(self, modules: int, seed: int, speeds: Mapping[int, int], jitter: float) -> None:
        """Draw when each module acts first."""
        self._random = np.random.default_rng(seed)
        self._periods = [_TICKS * speeds.get(module, 1) for module in range(modules)]
        self._jitter = jitter
        self._now = 0
        self._due = [
            (int(self._random.integers(period)), module)
            for module, period in enumerate(self._periods)
        ]
        heapify(self._due)

    def next(self, *, committed: bool) -> int:
        """Return whose time comes first."""
        del committed
        due, module = self._due[0]
        spread = int(self._periods[module] * self._jitter)
        pause = self._periods[module] + int(self._random.integers(-spread, spread + 1))
        heapreplace(self._due, (due + max(pause, 1), module))
        self._now = due
        return module

    @property
    def time(self) -> float:
        """Return when the last turn began."""
        return self._now / _TICKS


class Unfair:
    """Whoever acted last acts again, as long as something comes of it.

    Then comes whoever acted last before that and has not acted in vain since the last commit. A
    module that has waited for `_PATIENCE` turns for each module goes before all others.
    """

    def __init__(self, modules: int) -> None:
        """Begin with the module of the highest number."""
        self._turn = 0
        self._acted = {module: module - modules for module in range(modules)}
        """When each module acted last."""
        self._in_vain: set[int] = set()
        self._last: int | None = None

    def next(self, *, committed: bool) -> int:
        """Return the least deserving module that is allowed."""
        if committed:
            self._in_vain.clear()
        elif self._last is not None:
            self._in_vain.add(self._last)
        self._turn += 1
        acted = self._acted
        waits = min(acted, key=lambda module: (acted[module], module))
        hopeful = [module for module in acted if module not in self._in_vain]
        if self._turn - acted[waits] <= _PATIENCE * len(acted) and hopeful:
            found = max(hopeful, key=lambda module: (acted[module], module))
        else:
            found = waits
        self._acted[found] = self._turn
        self._last = found
        return found

    @property
    def time(self) -> float:
        """Return how many turns each module has had before, on average."""
        return max(self._turn - 1, 0) / len(self._acted)


def scheduler_named(
    name: str, *, modules: int, seed: int, speeds: Mapping[int, int], jitter: float
) -> Scheduler:
    """Return a scheduler; InputError if there is none of that name, or it has no such speeds."""
    if not 0 <= real_number("jitter", jitter) <= 1:
        raise InputError(f"jitter={jitter}: expected 0 to 1")
    for module, factor in speeds.items():
        if module not in range(modules) or not isinstance(factor, Real) or factor < 1:
            raise InputError(
                f"speeds: module {module} with {factor}, expected modules 0 to {modules - 1} with"
                " factors of 1 or more"
            )
    if speeds and name != "random":
        raise InputError(f"speeds with scheduler={name!r}: expected scheduler='random'")
    match name:
        case "turns":
            return Turns(modules)
        case "random":
            return AtRandom(modules, seed, speeds, jitter)
        case "unfair":
            return Unfair(modules)
        case _:
            raise InputError(f"scheduler={name!r}: expected 'random', 'unfair' or 'turns'")
