"""Which modules are slow in a run: the same ones under every rule, clock and core.

Room: coordinator.
"""

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
