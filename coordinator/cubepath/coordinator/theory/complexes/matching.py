"""Which actions are admissible at a state: `actions.end_at` on rows of 64-bit words, compiled.

A module's proposals are filed under the bit of its site. Of each only the words that matter are
kept: those where its local state needs something besides the module itself, which is known to be
there. Words in which it needs other modules come first, since few sites are on, and most proposals
fail there. So a state costs about one comparison for each proposal, however many words it has.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.complexes.state_masks import Bits, Numbers, Words
from cubepath.coordinator.theory.complexes.state_table import Keys, keys_of_bits
from cubepath.protocol.compiled import compiled


class Placing(NamedTuple):
    """The actions that a module at each bit may apply, what they need, and what they turn."""

    mover_starts: Numbers
    """For each bit, where its proposals begin, shape (bits + 1,)."""
    proposals: Numbers
    """Action and end, shape (proposals, 2)."""
    need_starts: Numbers
    """For each proposal, where its rows of `needs` begin."""
    needs: Words
    """A word of the state, which of its bits matter, and how they must be, shape (any, 3)."""
    guard_starts: Numbers
    """For each action, where its rows of `guards` begin."""
    guards: Numbers
    """Pairs of bits, where the first needs the second, shape (any, 2)."""
    turn_starts: Numbers
    """For each action, where its rows of `turns` begin."""
    turns: Words
    """A word of the state, and which of its bits the action turns, shape (any, 2)."""
    keys: Keys
    """For each bit, its part of a state's hash."""
    turn_keys: Keys
    """For each action, by what a state's hash changes."""


def placing(bits: Bits) -> Placing:
    """Return all that is known of sites and actions, for compiled code."""
    masks = bits.masks()
    mover_starts, proposals = _ranges(bits.movers)
    bit = np.repeat(np.arange(len(bits.movers)), np.diff(mover_starts))
    action, end = proposals[:, 0], proposals[:, 1]
    need, shown = masks[action, 0], masks[action, 3 + end]
    # The module itself is there, or it would propose nothing.
    rows, its_word = np.arange(len(bit)), bit >> 6
    itself = np.uint64(1) << (bit & 63).astype(np.uint64)
    known = itself & shown[rows, its_word]
    need[rows, its_word] &= ~known
    shown[rows, its_word] &= ~known
    proposal, word = np.nonzero(need)
    need, shown = need[proposal, word], shown[proposal, word]
    order = np.lexsort((word, -_bits(shown).sum(axis=1, dtype=np.int64), proposal))
    columns = (word.astype(np.uint64)[order], need[order], shown[order])
    turned = masks[:, 3] ^ masks[:, 4]
    turning, at = np.nonzero(turned)
    turned = turned[turning, at]
    keys = keys_of_bits(64 * bits.words)
    turn_keys = np.zeros(len(masks), dtype=np.uint64)
    by_word = np.where(_bits(turned), keys.reshape(-1, 64)[at], np.uint64(0))
    np.bitwise_xor.at(turn_keys, turning, np.bitwise_xor.reduce(by_word, axis=1))
    return Placing(
        mover_starts,
        proposals,
        _starts(proposal, len(proposals)),
        np.stack(columns, axis=1),
        *_ranges(bits.guards),
        _starts(turning, len(masks)),
        np.stack((at.astype(np.uint64), turned), axis=1),
        keys,
        turn_keys,
    )


def _ranges(lists: list[list[tuple[int, int]]]) -> tuple[Numbers, Numbers]:
    starts = np.zeros(len(lists) + 1, dtype=np.int32)
    np.cumsum([len(found) for found in lists], out=starts[1:])
    flat = [pair for found in lists for pair in found]
    return starts, np.array(flat, dtype=np.int32).reshape(-1, 2)


def _starts(owners: NDArray[np.intp], count: int) -> Numbers:
    """Return where the rows of each of `count` owners begin; `owners` is sorted."""
    return np.searchsorted(owners, np.arange(count + 1)).astype(np.int32)


def _bits(words: Words) -> NDArray[np.uint8]:
    """Return the bits of each word of a row, the lowest first, shape (words, 64)."""
    bytes_ = np.ascontiguousarray(words, dtype="<u8").view(np.uint8).reshape(-1, 8)
    return np.unpackbits(bytes_, axis=1, bitorder="little")


# The 64 products of a power of two with this number differ in their upper six bits. Source:
# Leiserson, Prokop and Randall, "Using de Bruijn sequences to index a 1 in a computer word" (1998).
_DE_BRUIJN = 0x03F79D71B4CB0A89
_PLACES = np.zeros(64, dtype=np.int64)
_PLACES[[(_DE_BRUIJN << bit) % 2**64 >> 58 for bit in range(64)]] = np.arange(64)


@compiled
def modules_of(state: Words, on: Numbers) -> int:
    """Write the bits that are on in a row of words to `on`, ascending; return their number.

    `on` has room for all bits of the row.
    """
    one = np.uint64(1)
    size = 0
    for word in range(state.shape[0]):
        left = state[word]
        while left:
            lowest = left & (~left + one)
            on[size] = 64 * word + _PLACES[(lowest * np.uint64(_DE_BRUIJN)) >> np.uint64(58)]
            size += 1
            left ^= lowest
    return size


@compiled
def proposals_of(placing: Placing, modules: Numbers) -> int:
    """Return the number of proposals of the modules at these bits, admissible or not."""
    found = 0
    for module in modules:
        found += int(placing.mover_starts[module + 1] - placing.mover_starts[module])
    return found


@compiled
def hash_of(placing: Placing, modules: Numbers) -> np.uint64:
    """Return the hash of the state at which these bits are on."""
    found = np.uint64(0)
    for module in modules:
        found ^= placing.keys[int(module)]
    return found


@compiled
def turn(placing: Placing, state: Words, action: int, after: Words) -> None:
    """Write the state after an action that is admissible at `state` to `after`."""
    for word in range(state.shape[0]):
        after[word] = state[word]
    for row in range(placing.turn_starts[action], placing.turn_starts[action + 1]):
        after[placing.turns[row, 0]] ^= placing.turns[row, 1]


@compiled
def guarded(placing: Placing, state: Words, action: int) -> bool:
    """Return whether the state keeps all guards of the action."""
    one = np.uint64(1)
    for place in range(placing.guard_starts[action], placing.guard_starts[action + 1]):
        a, b = placing.guards[place]
        on = (state[a >> 6] >> np.uint64(a & 63)) & one
        held = (state[b >> 6] >> np.uint64(b & 63)) & one
        if on and not held:
            return False
    return True


@compiled
def admissible_at(placing: Placing, state: Words, modules: Numbers, found: Numbers) -> int:
    """Write each (action, end) that the state shows to `found`, by action; return their number.

    `modules` are the bits that are on; `found` has shape (any, 2), with room for all proposals.
    """
    size = 0
    for module in modules:
        for proposal in range(placing.mover_starts[module], placing.mover_starts[module + 1]):
            shown = True
            for row in range(placing.need_starts[proposal], placing.need_starts[proposal + 1]):
                word = placing.needs[row, 0]
                if state[word] & placing.needs[row, 1] != placing.needs[row, 2]:
                    shown = False
                    break
            action = placing.proposals[proposal, 0]
            if not shown or not guarded(placing, state, action):
                continue
            at = size
            while at and found[at - 1, 0] > action:
                found[at] = found[at - 1]
                at -= 1
            found[at, 0], found[at, 1] = action, placing.proposals[proposal, 1]
            size += 1
    return size
