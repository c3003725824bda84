"""A hash table of states that keeps their hashes, compiled.

The hash of a state is the exclusive or of a key for each bit that is on (Zobrist, *A new hashing
method with application for game playing*, 1970). So the hash after an action is that of the state
and one number of the action; and it stays the same when rows become wider.

A slot holds the hash in its upper half and the number of a state in its lower half. States are
compared only where the hashes agree, so equal hashes cost time and decide nothing; and the table
grows without a look at the states.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.complexes.state_masks import Words
from cubepath.protocol.compiled import compiled

Table: TypeAlias = NDArray[np.uint64]
"""Shape (a power of 2,), at most half of it in use."""
Keys: TypeAlias = NDArray[np.uint64]

FREE = 2**64 - 1
"""What a slot holds that holds no state."""
_HALF = 32
_LOWER = 2**_HALF - 1


def keys_of_bits(count: int) -> Keys:
    """Return the keys of the first `count` bits: numbers of 32 bits, the same on every machine.

    They are the upper halves of what splitmix64 gives for the bits' numbers.
    """
    key = np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return (key ^ (key >> np.uint64(31))) >> np.uint64(_HALF)


def empty_table(size: int) -> Table:
    """Return a table of `size` free slots."""
    return np.full(size, FREE, dtype=np.uint64)


def grown(table: Table, size: int) -> Table:
    """Return a table of `size` slots with what this one holds."""
    found = empty_table(size)
    _put_all.for_work(4 * len(table))(table, found)
    return found


@compiled
def slot_of(table: Table, states: Words, state: Words, key: np.uint64) -> int:
    """Return the slot that holds the state with this hash, or the free slot where it belongs."""
    last = np.uint64(len(table) - 1)
    one, half = np.uint64(1), np.uint64(_HALF)
    slot = key & last
    while table[slot] != np.uint64(FREE):
        if table[slot] >> half == key:
            other = table[slot] & np.uint64(_LOWER)
            same = True
            for word in range(state.shape[0]):
                if states[other, word] != state[word]:
                    same = False
                    break
            if same:
                break
        slot = (slot + one) & last
    return int(slot)


@compiled
def entry(key: np.uint64, number: int) -> np.uint64:
    """Return what the slot of the state with this hash and number holds."""
    return (key << np.uint64(_HALF)) | np.uint64(number)


@compiled
def number_in(held: np.uint64) -> int:
    """Return the number of the state that a slot holds."""
    return int(np.int64(held & np.uint64(_LOWER)))


@compiled
def _put_all(table: Table, larger: Table) -> None:
    last = np.uint64(len(larger) - 1)
    one, half = np.uint64(1), np.uint64(_HALF)
    for place in range(len(table)):
        if table[place] != np.uint64(FREE):
            slot = (table[place] >> half) & last
            while larger[slot] != np.uint64(FREE):
                slot = (slot + one) & last
            larger[slot] = table[place]
