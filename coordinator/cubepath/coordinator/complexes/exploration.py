"""Breadth-first exploration: all states that can be reached from a start, as rows of bits.

The result is the transition graph of the paper (lemma on the skeleta of the state complex), with
the action of each edge; a bound on the number of states limits time and memory.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.complexes.state_masks import (
    Bits,
    Numbers,
    Placing,
    Words,
    admissible_at,
    bits_in,
    row_of,
)
from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene

MAX_STATES = 2_000_000
"""The default bound on the number of states."""
_CHUNK = 1 << 12
_STEP = 64
_FREE = -1
_STATE_STEPS = 4
"""Steps of work for each action that a module of a state may propose."""

Progress = Callable[[int, int], None]
"""Called with the number of states that have been expanded, and the number known."""


@dataclass(frozen=True, slots=True)
class Explored:
    """States in the order of discovery, and from each the edges that leave it at end 0.

    Every edge of the transition graph leaves exactly one state at end 0 of its action, so the lists
    contain it once: the edges of state s are ``starts[s]`` to ``starts[s + 1]``, sorted by the
    number of their action, with the state that they lead to.
    """

    bits: Bits
    states: Words
    """Shape (states, words)."""
    starts: NDArray[np.int64]
    actions: Numbers
    targets: Numbers
    complete: bool
    """False if the bound stopped the exploration before all of these states were expanded."""

    @property
    def scene(self) -> Scene:
        """Return the scene that was explored."""
        return self.bits.scene

    @property
    def memory(self) -> int:
        """Return the size of states and edges in bytes."""
        return sum(array.nbytes for array in (self.states, self.starts, self.actions, self.targets))

    def state(self, number: int) -> frozenset[Site]:
        """Return the sites that are on in a state, including filled obstacles."""
        return self.bits.decode(self.states[number])


def explore(
    scene: Scene, *, max_states: int = MAX_STATES, progress: Progress | None = None
) -> Explored:
    """Return the states that can be reached from the start, if there are at most `max_states`.

    If there are more, the exploration stops within some dozens of states after it has found that. A
    non-local system is explored the same way; whatever its global rule forbids is not a state. The
    start always counts as a state.
    """
    walk = _Walk(scene)
    while walk.done < walk.known and walk.allowed <= max_states:
        # Take small steps near the bound, so as not to run far beyond it.
        chunk = min(_CHUNK, max(_STEP, (max_states - walk.allowed) // 8))
        walk.expand(min(walk.done + chunk, walk.known))
        if progress is not None:
            progress(walk.done, walk.known)
    return walk.explored()


class _Walk:
    """The states known so far, a hash table to find them, and their edges."""

    def __init__(self, scene: Scene) -> None:
        self.bits = Bits(scene)
        self.done = 0
        self.known = 1
        self.allowed = 1
        """The number of known states that are not forbidden."""
        self._meet(bits_in(row_of(self.bits.start, self.bits.words)))
        self._states = row_of(self.bits.start, self.bits.words).reshape(1, -1)
        self._forbidden = np.zeros(1, dtype=np.bool_)
        self._table = np.full(16, _FREE, dtype=np.int32)
        self._rehash(16)
        self._edges: list[tuple[Numbers, Numbers]] = []
        """For each chunk: the number of edges of each state, and (action, end, target) of each."""
        self._placing = self.bits.placing()

    def _meet(self, found: list[int]) -> bool:
        new = [bit for bit in found if bit not in self.bits.met]
        for bit in new:
            self.bits.meet(bit)
        return bool(new)

    def _rehash(self, size: int) -> None:
        self._table = np.full(size, _FREE, dtype=np.int32)
        _insert_all.for_work(4 * self.known)(self._table, self._states, self.known)

    def _room(self, more: int) -> None:
        """Make room for `more` further states, and for wider ones if new sites were met."""
        words = self.bits.words
        most = self.known + more
        if words > self._states.shape[1] or most > len(self._states):
            rows = max(most, 2 * len(self._states)) if most > len(self._states) else most
            states = np.zeros((max(rows, len(self._states)), words), dtype=np.uint64)
            states[: self.known, : self._states.shape[1]] = self._states[: self.known]
            wider = words > self._states.shape[1]
            forbidden = np.zeros(len(states), dtype=np.bool_)
            forbidden[: self.known] = self._forbidden[: self.known]
            self._states, self._forbidden = states, forbidden
            if wider:
                self._rehash(len(self._table))
        if 2 * most > len(self._table):
            self._rehash(1 << (2 * most).bit_length())

    def expand(self, stop: int) -> None:
        """Find the edges of the states from `done` up to `stop`, and the states they lead to."""
        here = np.bitwise_or.reduce(self._states[self.done : stop], axis=0)
        if self._meet(bits_in(here)):
            self._room(0)
            self._placing = self.bits.placing()
        placing = self._placing
        work = _STATE_STEPS * (stop - self.done) * self.bits.words
        widest = _widest.for_work(work)(placing, self._states[self.done : stop])
        room = np.empty((widest, 2), dtype=np.int32)
        work *= widest
        counts = np.zeros(stop - self.done, dtype=np.int32)
        known = _Known(self._states, self._forbidden, self._table)
        _count.for_work(work)(known, self.done, placing, room, counts)
        edges = np.empty((int(counts.sum()), 3), dtype=np.int32)
        self._room(len(edges))
        before = self.known
        known = _Known(self._states, self._forbidden, self._table)
        expand = _expand.for_work(work + _STATE_STEPS * len(edges))
        self.known = expand(known, before, self.done, placing, edges)
        self._edges.append((counts, edges))
        system = self.bits.scene.system
        if not system.local:
            for number in range(before, self.known):
                state = self.bits.decode(self._states[number])
                self._forbidden[number] = not system.legal(state)
        self.allowed += self.known - before - int(self._forbidden[before : self.known].sum())
        self.done = stop

    def explored(self) -> Explored:
        """Return what was found, without forbidden states and with each edge once."""
        kept = ~self._forbidden[: self.known]
        number = np.cumsum(kept, dtype=np.int64) - 1
        counts = np.concatenate([np.empty(0, np.int32), *(found for found, _ in self._edges)])
        edges = np.concatenate([np.empty((0, 3), np.int32), *(found for _, found in self._edges)])
        sources = np.repeat(np.arange(len(counts)), counts)
        up = (edges[:, 1] == 0) & kept[edges[:, 2]]
        sources, edges = number[sources[up]], edges[up]
        states = int(kept.sum())
        starts = np.zeros(states + 1, dtype=np.int64)
        np.cumsum(np.bincount(sources, minlength=states), out=starts[1:])
        return Explored(
            bits=self.bits,
            states=self._states[: self.known][kept],
            starts=starts,
            actions=edges[:, 0].copy(),
            targets=number[edges[:, 2]].astype(np.int32),
            complete=self.done == self.known,
        )


class _Known(NamedTuple):
    """States, which of them are forbidden, and a hash table of their numbers."""

    states: Words
    forbidden: NDArray[np.bool_]
    table: Numbers


@compiled
def _hash(state: Words) -> np.uint64:
    found = np.uint64(0)
    for word in range(state.shape[0]):
        found = (found ^ state[word]) * np.uint64(0x9E3779B97F4A7C15)
        found ^= found >> np.uint64(32)
    return found


@compiled
def _slot(table: Numbers, states: Words, state: Words) -> int:
    """Return the slot of the table that holds the state, or the free slot where it belongs."""
    last = len(table) - 1
    slot = np.int64(_hash(state) & np.uint64(last))
    while table[slot] != _FREE:
        other = table[slot]
        same = True
        for word in range(state.shape[0]):
            if states[other, word] != state[word]:
                same = False
                break
        if same:
            break
        slot = (slot + 1) & last
    return int(slot)


@compiled
def _insert_all(table: Numbers, states: Words, known: int) -> None:
    for number in range(known):
        table[_slot(table, states, states[number])] = number


@compiled
def _proposals(placing: Placing, state: Words) -> int:
    """Return the number of actions that the modules of a state may propose, admissible or not."""
    one = np.uint64(1)
    found = 0
    for word in range(state.shape[0]):
        left = state[word]
        bit = 64 * word
        while left:
            if left & one:
                found += placing.mover_starts[bit + 1] - placing.mover_starts[bit]
            left >>= one
            bit += 1
    return found


@compiled
def _widest(placing: Placing, states: Words) -> int:
    """Return the greatest number of actions that the modules of one of the states may propose."""
    most = 0
    for number in range(len(states)):
        most = max(most, _proposals(placing, states[number]))
    return most


@compiled
def _count(known: _Known, first: int, placing: Placing, room: Numbers, counts: Numbers) -> None:
    """Count the actions that are admissible at each of the states from `first` on."""
    for place in range(len(counts)):
        if not known.forbidden[first + place]:
            counts[place] = admissible_at(placing, known.states[first + place], room)


@compiled
def _expand(known: _Known, size: int, first: int, placing: Placing, edges: Numbers) -> int:
    """Fill in (action, end, target) by state and action; return the new number of known states."""
    states, table = known.states, known.table
    after = np.zeros(states.shape[1], dtype=np.uint64)
    state = first
    filled = 0
    while filled < len(edges):
        found = edges[filled:]
        count = 0 if known.forbidden[state] else admissible_at(placing, states[state], found)
        for place in range(count):
            action = found[place, 0]
            for word in range(len(after)):
                turned = placing.masks[action, 3, word] ^ placing.masks[action, 4, word]
                after[word] = states[state, word] ^ turned
            slot = _slot(table, states, after)
            if table[slot] == _FREE:
                states[size] = after
                table[slot] = size
                size += 1
            found[place, 2] = table[slot]
        filled += count
        state += 1
    return size
