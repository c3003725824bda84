"""The ranks of claims in compiled code: BLAKE2b, as `cubepath.agents.local.arbitration.priority`.

Room: agents. Source: RFC 7693, for digests of 8 bytes without a key.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled

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
Four: TypeAlias = tuple[np.uint64, np.uint64, np.uint64, np.uint64]


@compiled
def turned(value: np.uint64, by: int) -> np.uint64:
    """Return a word turned right by so many bits."""
    return (value >> np.uint64(by)) | (value << np.uint64(64 - by))


@compiled
def mix(
    a: np.uint64, b: np.uint64, c: np.uint64, d: np.uint64, one: np.uint64, other: np.uint64
) -> Four:
    """Return four words with two words of the message mixed in (the function G)."""
    a = a + b + one
    d = turned(d ^ a, 32)
    c = c + d
    b = turned(b ^ c, 24)
    a = a + b + other
    d = turned(d ^ a, 16)
    c = c + d
    b = turned(b ^ c, 63)
    return a, b, c, d


@compiled
def absorb(state: Words, words: Any, length: int, final: int) -> None:
    """Take a block of 16 words into the state; `length` bytes have been taken with it."""
    a, b, c, d = state[0], state[1], state[2], state[3]
    e, f, g, h = state[4], state[5], state[6], state[7]
    i, j, k, m = _START[0], _START[1], _START[2], _START[3]
    n, o, p, q = _START[4] ^ np.uint64(length), _START[5], _START[6], _START[7]
    if final:
        p = ~p
    for turn in range(_ROUNDS):
        at = _ORDER[turn % 10]
        a, e, i, n = mix(a, e, i, n, words[at[0]], words[at[1]])
        b, f, j, o = mix(b, f, j, o, words[at[2]], words[at[3]])
        c, g, k, p = mix(c, g, k, p, words[at[4]], words[at[5]])
        d, h, m, q = mix(d, h, m, q, words[at[6]], words[at[7]])
        a, f, k, q = mix(a, f, k, q, words[at[8]], words[at[9]])
        b, g, m, n = mix(b, g, m, n, words[at[10]], words[at[11]])
        c, h, i, o = mix(c, h, i, o, words[at[12]], words[at[13]])
        d, e, j, p = mix(d, e, j, p, words[at[14]], words[at[15]])
    state[0] ^= a ^ i
    state[1] ^= b ^ j
    state[2] ^= c ^ k
    state[3] ^= d ^ m
    state[4] ^= e ^ n
    state[5] ^= f ^ o
    state[6] ^= g ^ p
    state[7] ^= h ^ q


@compiled
def digits(number: int, text: Bytes, at: int) -> int:
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
def rank(text: Bytes, length: int, state: Words, words: Words) -> np.uint64:
    """Return the digest of the first `length` bytes (1 or more), as a number, first byte highest.

    `text` has room for whole blocks; `state` and `words`, 8 and 16 words, are overwritten.
    """
    state[:] = _START
    state[0] ^= np.uint64(0x01010000 ^ 8)
    done = 0
    while True:
        more = length - done > _BLOCK
        words[:] = np.uint64(0)
        for at in range(done, done + _BLOCK if more else length):
            words[(at & (_BLOCK - 1)) >> 3] |= np.uint64(text[at]) << np.uint64(8 * (at & 7))
        done += _BLOCK
        if not more:
            break
        absorb(state, words, done, 0)
    absorb(state, words, length, 1)
    found = np.uint64(0)
    for at in range(8):
        found = (found << np.uint64(8)) | ((state[0] >> np.uint64(8 * at)) & np.uint64(255))
    return found
