"""A system's sites and actions as bit masks, added as an exploration meets them.

The array form of the formal core: it has `actions.end_at` and `actions.commute` on rows of 64-bit
words instead of sets, for compiled code. Sites get bits and actions get numbers in the order in
which they are met, which depends only on the scene.

The hash of a state is the exclusive or of a key for each bit that is on (Zobrist, *A new hashing
method with application for game playing*, 1970), so it changes by one number of an action, and
stays the same when rows become wider. A slot of the table holds the hash in its upper half and the
number of a state in its lower half; states are compared only where the hashes agree.

A module's proposals are filed under the bit of its site. Of each only the words that matter are
kept, those in which it needs other modules first, since few sites are on, and most proposals fail
there. So a state costs about one comparison for each proposal, however many words it has.
"""

from collections.abc import Iterable
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.sites import Ordinals, Site, in_order, site_text
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
            (self.encode(fixed), self.encode(action.trace), self.encode(action.support), *ends)
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
