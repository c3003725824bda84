"""The random streams of modules, which tell nothing of the seed that they come from.

numpy keeps with a generator the seed sequence that it was made from: the seed of the run, from
which the streams of all other modules follow. A rule is given a generator without it.
"""

from __future__ import annotations

from typing import Any, NoReturn

import numpy as np
from numpy.random.bit_generator import ISpawnableSeedSequence

RULE, HESITATE = 0, 1
"""What a stream is for."""


class NoSeed(ISpawnableSeedSequence):
    """Stands where numpy keeps the seed sequence of a generator, and knows no seed."""

    def generate_state(self, n_words: int, dtype: Any = np.uint32) -> Any:
        """Return `n_words` zeros: the state of the generator is set afterwards."""
        return np.zeros(n_words, dtype)

    def spawn(self, n_children: int) -> NoReturn:
        """Raise TypeError: other streams would follow from the seed."""
        raise TypeError(f"asked for {n_children} more streams: a module has the one that it draws")


def stream(seed: int, module: int, purpose: int) -> np.random.Generator:
    """Return a module's own stream for one purpose, `RULE` or `HESITATE`.

    Its draws are those of ``default_rng(SeedSequence(seed, spawn_key=(module, purpose)))``.
    """
    seeded = np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(module, purpose)))
    return stream_at(seeded.state)


def stream_at(state: Any) -> np.random.Generator:
    """Return a stream that goes on from a state of numpy's PCG64."""
    nothing: Any = NoSeed()  # numpy takes it, and its annotations do not say so
    bits = np.random.PCG64(nothing)
    bits.state = state
    return np.random.Generator(bits)
