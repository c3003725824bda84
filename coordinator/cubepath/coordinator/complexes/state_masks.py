"""A system's sites and actions as bit masks, added as an exploration meets them.

The array form of the formal core: it has `actions.end_at` and `actions.commute` on rows of 64-bit
words instead of sets, for compiled code. Sites get bits and actions get numbers in the order in
which they are met, which depends only on the scene.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.ordinals import Ordinals
from cubepath.protocol.core.sites import Site, in_order, site_text
from cubepath.protocol.core.system import Scene

Words = NDArray[np.uint64]
Numbers = NDArray[np.int32]


class Placing(NamedTuple):
    """Masks of the actions, the modules that may apply them, and their guards."""

    masks: Words
    mover_starts: Numbers
    """For each bit, where its rows of `movers` begin, shape (bits + 1,)."""
    movers: Numbers
    """The actions and ends that a module at a bit may apply, shape (any, 2)."""
    guard_starts: Numbers
    guards: Numbers
    """Pairs of bits of each action, where the first needs the second, shape (any, 2)."""


class Bits:
    """Bits for sites and masks for actions; filled obstacles need no bit, since they stay on."""

    def __init__(self, scene: Scene) -> None:
        """Begin with the sites of the start."""
        self.scene = scene
        self.sites: list[Site] = []
        self.actions: list[Action] = []
        self.met: set[int] = set()
        """Bits of the sites whose moves are known."""
        self._filled = scene.system.filled
        self._bit = Ordinals[Site]()
        self._number: dict[Action, int | None] = {}
        self._masks: list[tuple[int, ...]] = []
        self._guards: list[list[tuple[int, int]]] = []
        self._movers: list[list[tuple[int, int]]] = []
        self._filed: set[tuple[int, int]] = set()
        self.start = self.encode(scene.start)

    @property
    def words(self) -> int:
        """Return the number of 64-bit words of a state."""
        return max(1, -(-len(self.sites) // 64))

    def _bit_of(self, site: Site) -> int:
        found = self._bit[site]
        if found == len(self.sites):
            self.sites.append(site)
            self._movers.append([])
        return found

    def encode(self, sites: Iterable[Site]) -> int:
        """Return the mask of these sites as one number; filled obstacles are left out."""
        found = 0
        for site in in_order(sites):
            if site not in self._filled:
                found |= 1 << self._bit_of(site)
        return found

    def decode(self, row: Words) -> frozenset[Site]:
        """Return the sites that are on in a row of words, including filled obstacles."""
        return frozenset(self.sites[bit] for bit in bits_in(row)) | self._filled

    def meet(self, bit: int) -> None:
        """Learn the moves of a module at the site of this bit."""
        self.met.add(bit)
        site = self.sites[bit]
        for move in self.scene.system.moves_at(site):
            number = self._number_of(move.action)
            if number is not None:
                sources = frozenset(source for source, _ in move.motion)
                end = 0 if sources == move.action.ends[0] & move.action.trace else 1
                # Equal actions, listed under two names or with two movers, are one edge.
                if (number, end) not in self._filed:
                    self._filed.add((number, end))
                    self._movers[bit].append((number, end))

    def _number_of(self, action: Action) -> int | None:
        if action not in self._number:
            self._number[action] = self._register(action)
        return self._number[action]

    def _register(self, action: Action) -> int | None:
        fixed = action.support - action.free
        # The action applies only if a filled obstacle in its support is on at both ends.
        if fixed & self._filled != action.ends[0] & self._filled:
            return None
        # If the first site of a guard is a filled obstacle, the second must always be on.
        needed = {b for a, b in action.guards if a in self._filled} - self._filled
        if not needed & fixed <= action.ends[0]:
            return None
        fixed |= needed
        ends = [self.encode(end | needed) for end in action.ends]
        self._masks.append(
            (
                self.encode(fixed),
                self.encode(action.trace),
                self.encode(action.support),
                *ends,
            )
        )
        self._guards.append(
            [
                (self._bit_of(a), self._bit_of(b))
                for a, b in sorted(action.guards, key=site_text)
                if a not in self._filled and b not in self._filled
            ]
        )
        self.actions.append(action)
        return len(self.actions) - 1

    def masks(self) -> Words:
        """Return all masks, shape (actions, 5, words): need, trace, support, end 0, end 1.

        Need holds the sites of the support that must agree with an end.
        """
        size = 8 * self.words
        data = b"".join(mask.to_bytes(size, "little") for masks in self._masks for mask in masks)
        return np.frombuffer(data, dtype="<u8").reshape(-1, 5, self.words).copy()

    def placing(self) -> Placing:
        """Return everything known about sites and actions as arrays."""
        return Placing(self.masks(), *_ranges(self._movers), *_ranges(self._guards))


def _ranges(lists: list[list[tuple[int, int]]]) -> tuple[Numbers, Numbers]:
    starts = np.zeros(len(lists) + 1, dtype=np.int32)
    np.cumsum([len(found) for found in lists], out=starts[1:])
    flat = [pair for found in lists for pair in found]
    return starts, np.array(flat, dtype=np.int32).reshape(-1, 2)


def row_of(mask: int, words: int) -> Words:
    """Return a mask as a row of words."""
    return np.frombuffer(mask.to_bytes(8 * words, "little"), dtype="<u8").copy()


def bits_in(row: Words) -> list[int]:
    """Return the numbers of the bits that are on in a row of words."""
    found = np.unpackbits(row.astype("<u8").view(np.uint8), bitorder="little")
    return [int(bit) for bit in np.flatnonzero(found)]


@compiled
def commutes(masks: Words, one: int, other: int) -> bool:
    """Return whether two actions commute: `actions.commute` on masks."""
    for word in range(masks.shape[2]):
        if masks[one, 1, word] & masks[other, 2, word]:
            return False
        if masks[other, 1, word] & masks[one, 2, word]:
            return False
    return True


@compiled
def shows(placing: Placing, state: Words, action: int, end: int) -> bool:
    """Return whether the state shows this end of the action: `actions.end_at` on masks."""
    masks = placing.masks
    for word in range(masks.shape[2]):
        if state[word] & masks[action, 0, word] != masks[action, 3 + end, word]:
            return False
    one = np.uint64(1)
    for place in range(placing.guard_starts[action], placing.guard_starts[action + 1]):
        a, b = placing.guards[place]
        on = (state[a >> 6] >> np.uint64(a & 63)) & one
        held = (state[b >> 6] >> np.uint64(b & 63)) & one
        if on and not held:
            return False
    return True


@compiled
def admissible_at(placing: Placing, state: Words, found: Numbers) -> int:
    """Write each (action, end) that the state shows to `found`, by action; return their number.

    `found` has shape (any, 2 or more), with room for all.
    """
    one = np.uint64(1)
    size = 0
    for word in range(state.shape[0]):
        left = state[word]
        bit = 64 * word
        while left:
            if left & one:
                for place in range(placing.mover_starts[bit], placing.mover_starts[bit + 1]):
                    action, end = placing.movers[place]
                    if not shows(placing, state, action, end):
                        continue
                    at = size
                    while at and found[at - 1, 0] > action:
                        found[at] = found[at - 1]
                        at -= 1
                    found[at, 0], found[at, 1] = action, end
                    size += 1
            left >>= one
            bit += 1
    return size
