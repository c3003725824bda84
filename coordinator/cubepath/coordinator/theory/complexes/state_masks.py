"""A system's sites and actions as bit masks, added as an exploration meets them.

The array form of the formal core: it has `actions.end_at` and `actions.commute` on rows of 64-bit
words instead of sets, for compiled code. Sites get bits and actions get numbers in the order in
which they are met, which depends only on the scene.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.ordinals import Ordinals
from cubepath.protocol.core.sites import Site, in_order, site_text
from cubepath.protocol.core.system import Scene

Words = NDArray[np.uint64]
Numbers = NDArray[np.int32]


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
        self._rows = np.zeros((0, 5, 0), dtype=np.uint64)
        """The first of these masks as they were last returned."""
        self.guards: list[list[tuple[int, int]]] = []
        """For each action pairs of bits, where the first needs the second."""
        self.movers: list[list[tuple[int, int]]] = []
        """For each bit the actions and ends that a module there may apply."""
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
            self.movers.append([])
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
                    self.movers[bit].append((number, end))

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
        self.guards.append(
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

        Need holds the sites of the support that must agree with an end. The array is kept to be
        added to, so nobody may write to it.
        """
        words, known = self.words, self._rows
        size = 8 * words
        new = self._masks[len(known) :]
        data = b"".join(mask.to_bytes(size, "little") for masks in new for mask in masks)
        found = np.zeros((len(self._masks), 5, words), dtype=np.uint64)
        found[: len(known), :, : known.shape[2]] = known
        found[len(known) :] = np.frombuffer(data, dtype="<u8").reshape(-1, 5, words)
        self._rows = found
        return found


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
