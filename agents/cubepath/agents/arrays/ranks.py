"""The ranks of claims in compiled code: BLAKE2b, as `cubepath.agents.local.arbitration.priority`.

Source: RFC 7693, for digests of 8 bytes without a key. The steps for one text wait for each other,
so several texts are hashed side by side, each in a *lane*, round by round.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays.tables import Ints
from cubepath.protocol.compiled import compiled, inner

Bytes: TypeAlias = NDArray[np.uint8]
Words: TypeAlias = NDArray[np.uint64]

_START = np.array(
    [
        0x6A09E667F3BCC908,
        0xBB67AE8584CAA73B,
        0x3C6EF372FE94F82B,
        0xA54FF53A5F1D36F1,
        0x510E527FADE682D1,
        0x9B05688C2B3E6C1F,
        0x1F83D9ABFB41BD6B,
        0x5BE0CD19137E2179,
    ],
    np.uint64,
)
_ORDER = np.array(
    [
        [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15],
        [14, 10, 4, 8, 9, 15, 13, 6, 1, 12, 0, 2, 11, 7, 5, 3],
        [11, 8, 12, 0, 5, 2, 15, 13, 10, 14, 3, 6, 7, 1, 9, 4],
        [7, 9, 3, 1, 13, 12, 11, 14, 2, 6, 5, 10, 4, 0, 15, 8],
        [9, 0, 5, 7, 2, 4, 10, 15, 14, 1, 11, 12, 6, 8, 3, 13],
        [2, 12, 6, 10, 0, 11, 8, 3, 4, 13, 7, 5, 15, 14, 1, 9],
        [12, 5, 1, 15, 14, 13, 4, 10, 0, 7, 6, 3, 9, 2, 8, 11],
        [13, 11, 7, 14, 12, 1, 3, 9, 5, 0, 15, 4, 8, 6, 2, 10],
        [6, 15, 14, 9, 11, 3, 0, 8, 12, 2, 13, 7, 1, 4, 10, 5],
        [10, 2, 8, 4, 7, 6, 1, 5, 15, 11, 9, 14, 3, 12, 13, 0],
    ],
    np.uint8,
)
_BLOCK, _ROUNDS = 128, 12
_LANES = 8
# What the words are for, a row of lanes each: the states, what is worked on, and the block; how
# many bytes were taken with it, all bits if it is the last, where the text ends, a common block.
_WORK, _TEXT, _TAKEN = 8 * _LANES, 24 * _LANES, 40 * _LANES
_LAST, _ENDS, _COMMON = 41 * _LANES, 42 * _LANES, 43 * _LANES
HASHING_WORDS = _COMMON + 16
Four: TypeAlias = tuple[np.uint64, np.uint64, np.uint64, np.uint64]


@inner
def mix(
    a: np.uint64, b: np.uint64, c: np.uint64, d: np.uint64, one: np.uint64, other: np.uint64
) -> Four:
    """Return four words with two words of the message mixed in (the function G)."""
    a = a + b + one
    d = d ^ a
    d = (d >> np.uint64(32)) | (d << np.uint64(32))
    c = c + d
    b = b ^ c
    b = (b >> np.uint64(24)) | (b << np.uint64(40))
    a = a + b + other
    d = d ^ a
    d = (d >> np.uint64(16)) | (d << np.uint64(48))
    c = c + d
    b = b ^ c
    b = (b >> np.uint64(63)) | (b << np.uint64(1))
    return a, b, c, d


@inner
def absorb(words: Any, lanes: int) -> None:
    """Take the block of each lane into its state."""
    for lane in range(lanes):
        for row in range(8):
            words[_WORK + _LANES * row + lane] = words[_LANES * row + lane]
            words[_WORK + _LANES * (8 + row) + lane] = _START[row]
        words[_WORK + _LANES * 12 + lane] ^= words[_TAKEN + lane]
        words[_WORK + _LANES * 14 + lane] ^= words[_LAST + lane]
    for turn in range(_ROUNDS):
        at = _ORDER[turn % 10]
        for lane in range(lanes):
            text, work = _TEXT + lane, _WORK + lane
            a, b, c, d = (
                words[work + 0 * _LANES],
                words[work + 1 * _LANES],
                words[work + 2 * _LANES],
                words[work + 3 * _LANES],
            )
            e, f, g, h = (
                words[work + 4 * _LANES],
                words[work + 5 * _LANES],
                words[work + 6 * _LANES],
                words[work + 7 * _LANES],
            )
            i, j, k, m = (
                words[work + 8 * _LANES],
                words[work + 9 * _LANES],
                words[work + 10 * _LANES],
                words[work + 11 * _LANES],
            )
            n, o, p, q = (
                words[work + 12 * _LANES],
                words[work + 13 * _LANES],
                words[work + 14 * _LANES],
                words[work + 15 * _LANES],
            )
            a, e, i, n = mix(a, e, i, n, words[text + _LANES * at[0]], words[text + _LANES * at[1]])
            b, f, j, o = mix(b, f, j, o, words[text + _LANES * at[2]], words[text + _LANES * at[3]])
            c, g, k, p = mix(c, g, k, p, words[text + _LANES * at[4]], words[text + _LANES * at[5]])
            d, h, m, q = mix(d, h, m, q, words[text + _LANES * at[6]], words[text + _LANES * at[7]])
            a, f, k, q = mix(a, f, k, q, words[text + _LANES * at[8]], words[text + _LANES * at[9]])
            b, g, m, n = mix(
                b, g, m, n, words[text + _LANES * at[10]], words[text + _LANES * at[11]]
            )
            c, h, i, o = mix(
                c, h, i, o, words[text + _LANES * at[12]], words[text + _LANES * at[13]]
            )
            d, e, j, p = mix(
                d, e, j, p, words[text + _LANES * at[14]], words[text + _LANES * at[15]]
            )
            words[work + 0 * _LANES], words[work + 1 * _LANES] = a, b
            words[work + 2 * _LANES], words[work + 3 * _LANES] = c, d
            words[work + 4 * _LANES], words[work + 5 * _LANES] = e, f
            words[work + 6 * _LANES], words[work + 7 * _LANES] = g, h
            words[work + 8 * _LANES], words[work + 9 * _LANES] = i, j
            words[work + 10 * _LANES], words[work + 11 * _LANES] = k, m
            words[work + 12 * _LANES], words[work + 13 * _LANES] = n, o
            words[work + 14 * _LANES], words[work + 15 * _LANES] = p, q
    for lane in range(lanes):
        for row in range(8):
            words[_LANES * row + lane] ^= (
                words[_WORK + _LANES * row + lane] ^ words[_WORK + _LANES * (8 + row) + lane]
            )


@inner
def digits(number: Any, text: Bytes, at: int) -> int:
    """Write a number that is not negative in decimal digits; return where they end."""
    end = at + 1
    rest = number // 10
    while rest > 0:
        end += 1
        rest //= 10
    for place in range(end - 1, at - 1, -1):
        text[place] = 48 + number % 10
        number //= 10
    return end


@compiled
def rank_claims(
    text: Bytes,
    length: int,
    claimants: Ints,
    chosen: Ints,
    count: int,
    words: Words,
    ranks: Words,
) -> None:
    """Write the ranks of the first `count` chosen claims: digests as numbers, first byte highest.

    What is hashed are the first `length` bytes of `text`, which has room for more digits, and the
    number of the claimant. `words`, `HASHING_WORDS` many, are overwritten.
    """
    for first in range(0, count, _LANES):
        lanes = min(_LANES, count - first)
        for lane in range(lanes):
            for row in range(8):
                words[_LANES * row + lane] = _START[row]
            words[lane] ^= np.uint64(0x01010000 ^ 8)
        done, longest = 0, 1
        while done < longest:
            for word in range(16):
                words[_COMMON + word] = np.uint64(0)
            for at in range(done, min(length, done + _BLOCK)):
                words[_COMMON + ((at - done) >> 3)] |= np.uint64(text[at]) << np.uint64(
                    8 * (at & 7)
                )
            for lane in range(lanes):
                end = digits(np.int64(claimants[chosen[first + lane]]), text, length)
                longest = max(longest, end)
                for word in range(16):
                    words[_TEXT + _LANES * word + lane] = words[_COMMON + word]
                for at in range(max(length, done), min(end, done + _BLOCK)):
                    words[_TEXT + _LANES * ((at - done) >> 3) + lane] |= np.uint64(
                        text[at]
                    ) << np.uint64(8 * (at & 7))
                words[_ENDS + lane] = np.uint64(end)
                words[_TAKEN + lane] = np.uint64(min(end, done + _BLOCK))
                words[_LAST + lane] = ~np.uint64(0) if end <= done + _BLOCK else np.uint64(0)
            absorb(words, lanes)
            for lane in range(lanes):
                if done < np.int64(words[_ENDS + lane]) <= done + _BLOCK:
                    rank = np.uint64(0)
                    for at in range(8):
                        byte = (words[lane] >> np.uint64(8 * at)) & np.uint64(255)
                        rank = (rank << np.uint64(8)) | byte
                    ranks[chosen[first + lane]] = rank
            done += _BLOCK
