"""Which modules are slow in a run: the same ones under every rule, clock and core."""

from __future__ import annotations

import numpy as np

from cubepath.coordinator.experiments.setting import Setting
from cubepath.protocol.core.system import Scene

_STREAM = 3
"""What a stream of random numbers is for, beside those of rules, schedulers and late sights."""


def slow_modules(setting: Setting, scene: Scene, seed: int) -> list[int]:
    """Return the slow modules of a run by number: a share of all, drawn from its seed alone."""
    modules = len(scene.start)
    count = round(setting.faults.slow * modules)
    drawn = np.random.default_rng([seed, _STREAM]).permutation(modules)[:count]
    return sorted(drawn.tolist())


def thinking(setting: Setting, scene: Scene, seed: int) -> dict[int, float]:
    """Return how slowly each module thinks without rounds, in runs with messages.

    1 is 10 ms for a choice. Where no share of slow modules is given nobody takes time to think, and
    nothing is returned; where one is, all others think too, also if it comes to no module at all.
    """
    if not setting.faults.slow:
        return {}
    factors = dict.fromkeys(range(len(scene.start)), 1.0)
    slow = slow_modules(setting, scene, seed)
    return factors | dict.fromkeys(slow, float(setting.faults.slow_factor))
