"""Breadth-first exploration: all states reachable from a start, as rows of bits.

The result is the transition graph of the paper (lemma on the skeleta of the state complex), with
the action of each edge; a bound on the number of states limits time and memory.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.progress import StageProgress, progress_bar
from cubepath.coordinator.theory.complexes.state_masks import (
    FREE,
    Bits,
    Numbers,
    Placing,
    Table,
    Words,
    admissible_at,
    bits_in,
    empty_table,
    entry,
    grown,
    hash_of,
    modules_of,
    number_in,
    placing,
    proposals_of,
    row_of,
    slot_of,
    turn,
)
from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene

MAX_STATES = 2_000_000
"""The default bound on the number of states."""
_CHUNK = 1 << 12
_STEP = 64
_TABLE_LEAST = 16
_BLOCK = 1 << 16
"""The room for edges that is taken at a time."""
_STATE_STEPS = 4
"""Steps of work for each action that a module of a state may propose."""

Progress = Callable[[int, int], None]
"""Called with the number of states that have been expanded, and the number known."""


@dataclass(frozen=True, slots=True)
class Exploration:
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
    scene: Scene, *, max_states: int = MAX_STATES, progress: Progress | bool | None = None
) -> Exploration:
    """Return the states that can be reached from the start, if there are at most `max_states`.

    If there are more, the exploration stops within some dozens of states after it has found that. A
    non-local system is explored the same way; whatever its global rule forbids is not a state. The
    start always counts as a state. With True as `progress` there is a bar of `tqdm`.

    >>> found = explore(scene_from_spec("agv:graph=K5,n=2"))
    >>> found.complete, len(found.starts) - 1
    (True, 10)
    """
    if progress is True:
        with progress_bar("explore", " states") as bar:
            tell = partial(StageProgress(bar).tick, "explore")
            return explore(scene, max_states=max_states, progress=tell)
    walk = _Walk(scene)
    while walk.done < walk.known and walk.allowed <= max_states:
        # Take small steps near the bound, so as not to run far beyond it.
        chunk = min(_CHUNK, max(_STEP, (max_states - walk.allowed) // 8))
        walk.expand(min(walk.done + chunk, walk.known))
        if callable(progress):
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
        start = row_of(self.bits.start, self.bits.words)
        self._meet(start)
        self._states = row_of(self.bits.start, self.bits.words).reshape(1, -1)
        self._forbidden = np.zeros(1, dtype=np.bool_)
        self._counts = np.zeros(1, dtype=np.int32)
        """For each state, the number of edges that leave it at end 0."""
        self._placing = placing(self.bits)
        key = np.bitwise_xor.reduce(self._placing.keys[bits_in(start)], initial=np.uint64(0))
        self._table = empty_table(_TABLE_LEAST)
        self._table[int(key) % _TABLE_LEAST] = entry.plain(key, 0)
        self._blocks: list[Numbers] = []
        """The edges in order, as action and target; the last block has `_filled` of them."""
        self._filled = 0

    def _meet(self, row: Words) -> bool:
        """Learn the moves at the bits of a row; return whether there are new ones."""
        new = [bit for bit in bits_in(row) if bit not in self.bits.met]
        for bit in new:
            self.bits.meet(bit)
        return bool(new)

    def _room(self, more: int) -> None:
        """Make room for `more` further states and edges, and for wider states."""
        words = self.bits.words
        most = self.known + more
        if words > self._states.shape[1] or most > len(self._states):
            rows = len(self._states)
            if most > rows:
                rows = max(most, 2 * rows)
            states = np.empty((rows, words), dtype=np.uint64)
            states[: self.known, : self._states.shape[1]] = self._states[: self.known]
            states[: self.known, self._states.shape[1] :] = 0
            self._states = states
            self._forbidden = _longer(self._forbidden, rows)
            self._counts = _longer(self._counts, rows)
        if 2 * most > len(self._table):
            self._table = grown(self._table, 1 << (2 * most).bit_length())
        if not self._blocks or len(self._blocks[-1]) < self._filled + more:
            self._close()
            self._blocks.append(np.empty((max(_BLOCK, more), 2), dtype=np.int32))

    def _close(self) -> None:
        """Cut the last block down to its edges."""
        if self._blocks:
            self._blocks[-1] = self._blocks[-1][: self._filled]
        self._filled = 0

    def expand(self, stop: int) -> None:
        """Find the edges of the states from `done` up to `stop`, and the states they lead to."""
        if self._meet(np.bitwise_or.reduce(self._states[self.done : stop], axis=0)):
            self._placing = placing(self.bits)
        before = self.known
        more = 0
        while self.done < stop:
            self._room(more)
            expand = _expand.for_work(self._steps(stop))
            known = _Known(self._states, self._forbidden, self._counts, self._table)
            numbers = (self.done, stop, self.known)
            found = expand(known, numbers, self._placing, self._blocks[-1], self._filled)
            # Plain Python leaves some of them as numbers of numpy.
            self.done, self.known, self._filled, more = map(int, found)
        system = self.bits.scene.system
        if not system.local:
            for number in range(before, self.known):
                state = self.bits.decode(self._states[number])
                self._forbidden[number] = not system.legal(state)
        self.allowed += self.known - before - int(self._forbidden[before : self.known].sum())

    def _steps(self, stop: int) -> int:
        """Return roughly how many steps it takes to expand the states up to `stop`."""
        starts = self._placing.mover_starts
        modules = bits_in(self._states[self.done])
        proposals = sum(int(starts[bit + 1] - starts[bit]) for bit in modules)
        return _STATE_STEPS * (stop - self.done) * (self.bits.words + proposals)

    def explored(self) -> Exploration:
        """Return what was found, without forbidden states and with each edge once."""
        self._close()
        edges = np.concatenate([np.empty((0, 2), np.int32), *self._blocks])
        self._blocks.clear()
        states, counts = self._states[: self.known], self._counts[: self.known]
        forbidden = self._forbidden[: self.known]
        if forbidden.any():
            kept = ~forbidden
            number = np.cumsum(kept, dtype=np.int32) - np.int32(1)
            to_kept = kept[edges[:, 1]]
            sources = np.repeat(np.arange(self.known), counts)[to_kept]
            counts = np.bincount(sources, minlength=self.known)[kept].astype(np.int32)
            edges = edges[to_kept]
            edges[:, 1] = number[edges[:, 1]]
            states = states[kept]
        starts = np.zeros(len(states) + 1, dtype=np.int64)
        np.cumsum(counts, out=starts[1:])
        return Exploration(
            bits=self.bits,
            states=states,
            starts=starts,
            actions=edges[:, 0].copy(),
            targets=edges[:, 1].copy(),
            complete=self.done == self.known,
        )


_Row = TypeVar("_Row", bound=np.generic)


def _longer(row: NDArray[_Row], size: int) -> NDArray[_Row]:
    """Return the row with zeros at its end."""
    found = np.zeros(size, dtype=row.dtype)
    found[: len(row)] = row
    return found


class _Known(NamedTuple):
    """States, which of them are forbidden, how many edges go up from each, and their table."""

    states: Words
    forbidden: NDArray[np.bool_]
    counts: Numbers
    table: Table


@compiled
def _expand(
    known: _Known, numbers: tuple[int, int, int], placing: Placing, edges: Numbers, filled: int
) -> tuple[int, int, int, int]:
    """Fill in (action, target) by state and action, for the edges that leave a state at end 0.

    `numbers` are the first state, the end of the range of states, and how many are known. Return
    the first state that was not expanded, the numbers of known states and of edges now, and how
    much more room that state may need. Where there is less room than that, it is not begun.
    """
    states, table = known.states, known.table
    state, stop, size = numbers
    after = np.zeros(states.shape[1], dtype=np.uint64)
    on = np.empty(64 * states.shape[1], dtype=np.int32)
    found = np.empty((0, 2), dtype=np.int32)
    while state < stop:
        modules = on[: modules_of(states[state], on)]
        most = proposals_of(placing, modules)
        room = min(len(edges) - filled, len(states) - size, len(table) // 2 - size)
        if most > room:
            return state, size, filled, most
        if most > len(found):
            found = np.empty((most, 2), dtype=np.int32)
        shown = (
            0 if known.forbidden[state] else admissible_at(placing, states[state], modules, found)
        )
        here = hash_of(placing, modules)
        first = filled
        for place in range(shown):
            action = int(found[place, 0])
            turn(placing, states[state], action, after)
            key = here ^ placing.turn_keys[action]
            slot = slot_of(table, states, after, key)
            if table[slot] == np.uint64(FREE):
                states[size] = after
                table[slot] = entry(key, size)
                size += 1
            if found[place, 1] == 0:
                edges[filled, 0], edges[filled, 1] = action, number_in(table[slot])
                filled += 1
        known.counts[state] = filled - first
        state += 1
    return state, size, filled, 0
