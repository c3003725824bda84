"""The random streams of many modules in arrays: the same draws as numpy's, in compiled code.

A stream is a row of six numbers, see `Streams`. `streams_of` makes for all modules of all
environments what `actor.stream` makes for one, and draws from a row are those that numpy's
`Generator` makes from the same state.

Sources: M. O'Neill, PCG: A family of simple fast space-efficient statistically good algorithms for
random number generation (2014), the generator XSL-RR 128/64; D. Lemire, Fast random integer
generation in an interval (ACM TOMACS 29, 2019); and for seeding numpy's `SeedSequence`, after M.
O'Neill's seed_seq_fe. numpy keeps all of them as they are (NEP 19: the streams of bit generators
and of `SeedSequence` are stable); draws of `Generator` may change between versions, and a test
would tell.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.rules.vector_rule import Streams
from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.errors import InputError

_Words = NDArray[np.uint32]

# In plain Python these two are `operator.index`: then the functions below have Python's integers,
# and mask what would wrap around.
_word = np.uint64
_whole = np.int64

_MASK_32 = 0xFFFFFFFF
_SEED_STEPS, DRAW_STEPS = 8, 3
"""Microseconds in plain Python, to begin a stream and to draw from it."""


def streams_of(seeds: Sequence[int], modules: int, purpose: int) -> Streams:
    """Return the streams of all modules for one purpose, in one environment for each seed.

    Row (e, m) has the draws of ``stream(seeds[e], m, purpose)``. InputError for a negative seed.
    """
    streams = np.zeros((len(seeds), modules, 6), np.uint64)
    words = _seed_words(seeds, modules, purpose)
    _begin.for_work(len(seeds) * modules * _SEED_STEPS, by_entries=True)(words, streams)
    return streams


def _seed_words(seeds: Sequence[int], modules: int, purpose: int) -> NDArray[np.uint64]:
    """Return what ``SeedSequence(seed, spawn_key=(module, purpose))`` generates for a PCG64.

    Shape (seeds, modules, 4).
    """
    found = np.zeros((len(seeds), modules, 4), np.uint64)
    by_length: dict[int, list[int]] = {}
    entropy = [_entropy(seed) for seed in seeds]
    for row, words in enumerate(entropy):
        by_length.setdefault(len(words), []).append(row)
    for rows in by_length.values():
        drawn = np.array([entropy[row] for row in rows], np.uint32).T[:, :, np.newaxis]
        spawn_key = (np.arange(modules, dtype=np.uint32), np.full(1, purpose, np.uint32))
        pool = _mixed([*drawn, *spawn_key])
        halves = list(_generated(pool, 8))
        for word in range(4):
            low, high = (half.astype(np.uint64) for half in halves[2 * word : 2 * word + 2])
            found[rows, :, word] = low | high << np.uint64(32)
    return found


def _entropy(seed: int) -> list[int]:
    """Return the 32-bit words of a seed, the lowest first, and zeros up to the pool's four."""
    if seed < 0:
        raise InputError(f"seed={seed}: expected 0 or more")
    words = [seed >> shift & _MASK_32 for shift in range(0, max(seed.bit_length(), 1), 32)]
    return words + [0] * (4 - len(words))


def _mixed(entropy: Sequence[_Words]) -> list[_Words]:
    """Return the pool of `SeedSequence`: four words that each depend on all of the entropy.

    Its entries are arrays that broadcast together, of one word for each stream; at least four.
    """
    constants = _constants(0x43B0D7E5, 0x931E8875)
    pool = [_hashed(word, *next(constants)) for word in entropy[:4]]
    for source in range(4):
        for target in range(4):
            if source != target:
                pool[target] = _mix(pool[target], _hashed(pool[source], *next(constants)))
    for word in entropy[4:]:
        for target in range(4):
            pool[target] = _mix(pool[target], _hashed(word, *next(constants)))
    return pool


def _generated(pool: Sequence[_Words], count: int) -> Iterator[_Words]:
    """Yield so many words of the state that `SeedSequence` generates from its pool."""
    constants = _constants(0x8B51F9DD, 0x58F38DED)
    for word in range(count):
        yield _hashed(pool[word % 4], *next(constants))


def _constants(first: int, factor: int) -> Iterator[tuple[np.uint32, np.uint32]]:
    """Yield the constants of one hash after another: what is added, and what multiplies."""
    while True:
        after = first * factor & _MASK_32
        yield np.uint32(first), np.uint32(after)
        first = after


def _hashed(words: _Words, added: np.uint32, factor: np.uint32) -> _Words:
    found: _Words = (words ^ added) * factor
    return found ^ found >> np.uint32(16)


def _mix(one: _Words, other: _Words) -> _Words:
    found: _Words = one * np.uint32(0xCA01F9DD) - other * np.uint32(0x4973F715)
    return found ^ found >> np.uint32(16)


@compiled
def _begin(words: NDArray[np.uint64], streams: Streams) -> None:
    """Begin each stream at what its four words say: a state and an increment, high half first."""
    for environment in range(words.shape[0]):
        for module in range(words.shape[1]):
            high, low = words[environment, module, 2], words[environment, module, 3]
            full = _word(0xFFFFFFFFFFFFFFFF)
            streams[environment, module, 2] = ((high << _word(1)) & full) | (low >> _word(63))
            streams[environment, module, 3] = ((low << _word(1)) & full) | _word(1)
            _advance(streams, environment, module)
            high, low = streams[environment, module, 0], streams[environment, module, 1]
            sum_low = (low + words[environment, module, 1]) & full
            carry = _word(1) if sum_low < low else _word(0)
            sum_high = (high + words[environment, module, 0] + carry) & full
            streams[environment, module, 0] = sum_high
            streams[environment, module, 1] = sum_low
            _advance(streams, environment, module)


@compiled
def _advance(streams: Streams, environment: int, module: int) -> None:
    """Take the state of a stream to the next: times a constant, plus its increment, mod 2^128."""
    full, half = _word(0xFFFFFFFFFFFFFFFF), _word(0xFFFFFFFF)
    by_high, by_low = _word(0x2360ED051FC65DA4), _word(0x4385DF649FCCF645)
    high, low = streams[environment, module, 0], streams[environment, module, 1]
    # The high half of low * by_low, by halves of 32 bits, whose products fit.
    first = (low & half) * (by_low & half)
    second = (low >> _word(32)) * (by_low & half) + (first >> _word(32))
    third = (low & half) * (by_low >> _word(32)) + (second & half)
    carried = (
        (low >> _word(32)) * (by_low >> _word(32)) + (second >> _word(32)) + (third >> _word(32))
    )
    product = (low * by_low) & full
    after = (product + streams[environment, module, 3]) & full
    carry = _word(1) if after < product else _word(0)
    streams[environment, module, 0] = (
        carried + low * by_high + high * by_low + streams[environment, module, 2] + carry
    ) & full
    streams[environment, module, 1] = after


@compiled
def _draw_64(streams: Streams, environment: int, module: int) -> np.uint64:
    _advance(streams, environment, module)
    high, low = streams[environment, module, 0], streams[environment, module, 1]
    both, turn = high ^ low, high >> _word(58)
    back = (_word(64) - turn) & _word(63)
    found: np.uint64 = ((both >> turn) | (both << back)) & _word(0xFFFFFFFFFFFFFFFF)
    return found


@compiled
def _draw_32(streams: Streams, environment: int, module: int) -> np.uint64:
    """Draw 32 bits: the half that is kept, or one of the next 64, of which the other is kept."""
    if streams[environment, module, 4] != 0:
        streams[environment, module, 4] = 0
        kept: np.uint64 = streams[environment, module, 5]
        return kept
    found = _draw_64(streams, environment, module)
    streams[environment, module, 4] = 1
    streams[environment, module, 5] = found >> _word(32)
    return found & _word(0xFFFFFFFF)


@compiled
def draw_below(streams: Streams, environment: int, module: int, bound: int) -> np.int64:
    """Draw a number from 0 to `bound` - 1 from a module's stream: ``Generator.integers(bound)``.

    `bound` is at most 2^32 - 1. If it is 1 or less, the result is 0, and nothing is drawn.

    >>> streams = streams_of([7], modules=2, purpose=1)
    >>> [int(draw_below(streams, 0, 1, 6)) for draw in range(4)]
    [4, 2, 5, 5]
    """
    if bound <= 1:
        return _whole(0)
    half, count = _word(0xFFFFFFFF), _word(bound)
    found = _draw_32(streams, environment, module) * count
    if (found & half) < count:
        least = (_word(0x100000000) - count) % count
        while (found & half) < least:
            found = _draw_32(streams, environment, module) * count
    return _whole(found >> _word(32))


@compiled
def draw_fraction(streams: Streams, environment: int, module: int) -> float:
    """Draw a number from 0 to below 1 from a module's stream: ``Generator.random()``."""
    return (_draw_64(streams, environment, module) >> _word(11)) * (1.0 / 9007199254740992.0)
