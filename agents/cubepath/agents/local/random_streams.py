"""Random choices from a counter: hashes of the run's seed, a purpose, a module and an index.

A stream has a key, and its draw number `index` is ``hashed(key, index)``. The only state is a
count, so a module draws the same numbers alone, in arrays and in compiled code. Keys are draws too:
a seed and a purpose have a key, and under it draw number `module` is the module's key.

Source: G. Steele, D. Lea and C. Flood, Fast splittable pseudorandom number generators (OOPSLA
2014), the generator SplitMix64, which mixes with D. Stafford's variant 13.

>>> hashed(1234567, 0)
6457827717110365317
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.errors import InputError

RULE, HESITATE, PACE, SHARED = 0, 1, 2, 4
"""What a stream is for; of claims `arbitration` has another."""

Streams: TypeAlias = NDArray[np.uint64]
"""Streams of the modules of many environments, shape (E, n): key and count in one number each.

Drawing changes them.
"""

DRAW_STEPS = 2
"""Microseconds in plain Python, to draw from a stream in an array."""
_MASK = 0xFFFFFFFFFFFFFFFF
_STEP = 0x9E3779B97F4A7C15

# In plain Python these two are `operator.index`: then compiled functions have Python's integers.
_word = np.uint64
_whole = np.int64


def hashed(key: Any, index: Any) -> Any:
    """Return draw number `index` of the stream with this key: 64 bits, or an array of them.

    Both are from 0 to 2^64 - 1, in arrays and compiled code of type uint64.
    """
    found = (key + index * _STEP + _STEP) & _MASK
    found = ((found ^ (found >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    found = ((found ^ (found >> 27)) * 0x94D049BB133111EB) & _MASK
    return found ^ (found >> 31)


hashed_compiled = compiled(hashed)


@lru_cache(maxsize=64)
def seed_key(seed: int, purpose: int) -> int:
    """Return the key of a seed of any length for a purpose; InputError if it is negative."""
    if seed < 0:
        raise InputError(f"seed={seed}: expected 0 or more")
    key: int = hashed(0, purpose)
    while True:
        key = hashed(key, seed & _MASK)
        seed >>= 64
        if not seed:
            return key


class RandomStream:
    """The random choices of one module for one purpose.

    `drawn` counts the draws of `fraction` and `below`. The key is a hash, so neither it nor
    `generator` tells the seed of the run; `shared` is the key of a stream that all modules have.
    """

    __slots__ = ("_generator", "drawn", "key", "shared")

    def __init__(self, key: int, shared: int = 0) -> None:
        """Begin the stream with a key from 0 to 2^64 - 1."""
        self.key = key
        self.shared = shared
        self.drawn = 0
        self._generator: np.random.Generator | None = None

    def _draw(self) -> int:
        self.drawn += 1
        found: int = hashed(self.key, self.drawn - 1)
        return found

    def fraction(self) -> float:
        """Draw a number from 0 to below 1."""
        return (self._draw() >> 11) * 2.0**-53

    def below(self, bound: int) -> int:
        """Draw a number from 0 to `bound` - 1, where `bound` is from 1 to 2^32.

        Each is as probable as the others to within 2^-32.
        """
        return (self._draw() >> 32) * bound >> 32

    @property
    def generator(self) -> np.random.Generator:
        """A numpy generator that is seeded with the key, for other kinds of draws."""
        if self._generator is None:
            self._generator = np.random.default_rng(self.key)
        return self._generator


def stream(seed: int, module: int, purpose: int) -> RandomStream:
    """Return a module's stream for one purpose; InputError for a negative seed."""
    return RandomStream(hashed(seed_key(seed, purpose), module), seed_key(seed, SHARED))


def streams_of(seeds: Sequence[int], modules: int, purpose: int) -> Streams:
    """Return the streams of all modules for one purpose, in one environment for each seed.

    Entry (e, m) has the draws of ``stream(seeds[e], m, purpose)``. InputError for a negative seed.
    """
    keys = np.array([seed_key(seed, purpose) for seed in seeds], np.uint64)
    found: Streams = hashed(keys[:, np.newaxis], np.arange(modules, dtype=np.uint64))
    return found


def draws(streams: Streams, playing: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """Draw 64 bits from each stream where `playing`, whose shape broadcasts to theirs."""
    found: NDArray[np.uint64] = hashed(streams, np.uint64(0))
    streams += np.where(playing, np.uint64(_STEP), np.uint64(0))
    return found


def shared_streams_of(seeds: Sequence[int]) -> Streams:
    """Return the streams that the modules of each environment share, of shape (E, 1)."""
    return np.array([[seed_key(seed, SHARED)] for seed in seeds], np.uint64)


@compiled
def _draw(streams: Streams, environment: int, module: int) -> np.uint64:
    found: np.uint64 = hashed_compiled(streams[environment, module], _word(0))
    streams[environment, module] = (streams[environment, module] + _word(_STEP)) & _word(_MASK)
    return found


@compiled
def draw_below(streams: Streams, environment: int, module: int, bound: int) -> np.int64:
    """Draw a number from 0 to `bound` - 1 from a module's stream, as `RandomStream.below`.

    >>> streams = streams_of([7], modules=2, purpose=RULE)
    >>> [int(draw_below(streams, 0, 1, 6)) for draw in range(4)]
    [5, 2, 4, 2]
    """
    found = (_draw(streams, environment, module) >> _word(32)) * _word(bound)
    return _whole(found >> _word(32))


@compiled
def draw_fraction(streams: Streams, environment: int, module: int) -> float:
    """Draw a number from 0 to below 1 from a module's stream, as `RandomStream.fraction`."""
    return (_draw(streams, environment, module) >> _word(11)) * 2.0**-53
