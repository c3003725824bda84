"""The heap of pieces on arrays, compiled: sites and actions are numbers, columns blocks of a pool.

It does the same as `cubepath.coordinator.normal_form.heap`, which is the reference and has the
proofs, but with 32-bit integers in flat arrays instead of objects. Sources: Viennot, heaps of
pieces; Cartier and Foata, normal form; Crisp, Godelle and Wiest for linear time with cancellation.

*Columns.* Over a site lie its writers, and between two of them a group of readers. They form one
block of the pool `slots`, a stack that grows upward: the levels of a group, then a frame of three
slots for the writer over it, then the next group, and so on. A small group is unordered and is
scanned. A large one is a binary heap with the greatest level first. Readers leave it in any order;
a level that is gone before it is the greatest waits in a second binary heap until it is. The second
heaps of all groups form a stack that grows downward from the end of the block. At most half of a
group's levels are gone ones, so little memory is wasted, and a reader costs at most the logarithm
of the readers since the last writer, amortised. The cost of outgrowing and packing blocks is
amortised too, by doubling.

*Actions.* The pieces that equal an action are a stack of pairs (level, number of the move) in the
pool `pieces`. A move cancels iff the topmost of them lies exactly at the greatest level beneath the
move; `cubepath.coordinator.normal_form.heap.Heap` has the proof.

*Space.* Four bytes for each site that a piece reads, twelve for each that it writes, eight for the
piece, and at most four for the size of its level.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.compiled import compiled

Numbers = NDArray[np.int32]
Totals = NDArray[np.int64]

# A block of a pool: where it begins and ends, its first free slot, and its last free slot.
BASE, END, UP, DOWN = 0, 1, 2, 3
# A column: where the group of readers on top begins, how many of its levels are gone, and the level
# of the last writer, 0 if there is none.
GROUP, GONE, WRITER = 4, 5, 6
# An action: the level of its last piece, and the indices in `sites` where its trace begins, where
# its other sites begin, and where they end.
LAST, FIRST, READS, STOP = 4, 5, 6, 7
FIELDS = 8

# Entries of `totals`. The last two are the parts of each pool that belong to blocks.
MOVES, REDUCED, CUBES, SLOTS_USED, PIECES_USED = 0, 1, 2, 3, 4
TOTALS = 5

FRAME = 3
"""Slots of a writer: the writer before it, the size of the group under it, and its gone levels."""
PIECE = 2
"""Slots of a piece in `pieces`: its level, and the number of its move."""
PLAIN = 16
"""The largest group of readers that is unordered and scanned; a larger one is a heap."""
_LEAST = 4

at = np.uint32
"""An index that is never negative. numba then omits the check for counting from the end, which is a
third of the work in the innermost loop."""


class Arrays(NamedTuple):
    """The whole state of the heap; the arrays may be longer than the part in use.

    `columns` has shape (sites, 8) and `actions` (actions, 8), with the fields above. `sizes` holds
    the number of pieces of each level, from 0.
    """

    columns: Numbers
    actions: Numbers
    sites: Numbers
    slots: Numbers
    pieces: Numbers
    sizes: Numbers
    totals: Totals


# One function, since a call costs as much as a move: arrays are passed with all their metadata.
@compiled
def append_moves(  # noqa: C901, PLR0912, PLR0915, PLR0917 - see above
    heap: Arrays,
    numbers: Numbers,
    begin: int,
    reserved: bool,  # noqa: FBT001 - compiled functions take arguments by position
    levels: Numbers,
    partners: Numbers,
) -> int:
    """Append the moves with these action numbers, from place `begin` on; return where it stopped.

    It stops if a pool has no room for the next move (never with `reserved`, which promises that
    there is room for all moves). `sizes` must have room for all.

    `levels` and `partners` receive what became of the last moves, as many as they have entries,
    counted from the end of `numbers`; they may be empty. A move in the heap has its level and -1. A
    move that was undone has 0 and the number of the move that undid it. A move that undid another
    has minus the level where the other lay, and the other's number. Moves are numbered from 0.
    """
    columns, actions, sites = heap.columns, heap.actions, heap.sites
    slots, pieces, sizes, totals = heap.slots, heap.pieces, heap.sizes, heap.totals
    move, cubes, reduced = totals[MOVES], totals[CUBES], totals[REDUCED]
    first = move + len(numbers) - begin - len(levels)
    labelled = len(levels) > 0
    place = begin
    while place < len(numbers):
        number = at(numbers[place])
        if not reserved and not _room(heap, int(number)):
            break
        begins, reads, stops = (
            actions[number, FIRST],
            actions[number, READS],
            actions[number, STOP],
        )
        last = actions[number, LAST]
        # A piece is on top if it is the last piece of each column that it writes, and has no writer
        # over it where it reads. One test for all sites, as half of the branches are mispredicted.
        over = 1 if last == 0 else 0
        for index in range(begins, reads):
            site = at(sites[at(index)])
            over |= columns[site, UP] - columns[site, GROUP]
            over |= columns[site, WRITER] ^ last
        below = 0
        for index in range(reads, stops):
            below = max(below, columns[at(sites[at(index)]), WRITER])
        if over == 0 and below < last:
            up = actions[number, UP] - PIECE
            partner = pieces[at(up + 1)]
            actions[number, UP] = up
            actions[number, LAST] = pieces[up - PIECE] if up > actions[number, BASE] else 0
            for index in range(begins, reads):
                site = at(sites[at(index)])
                up = columns[site, UP] - FRAME
                columns[site, UP] = up
                columns[site, GROUP] = up - slots[at(up + 1)]
                columns[site, GONE] = slots[at(up + 2)]
                columns[site, WRITER] = slots[at(up)]
            for index in range(reads, stops):
                site = at(sites[at(index)])
                up = columns[site, UP] - 1
                if up - columns[site, GROUP] >= PLAIN:
                    _unread(columns, slots, int(site), last)
                    continue
                # A small group is unordered, so the last level takes the place of this one.
                found = up
                while slots[at(found)] != last:
                    found -= 1
                slots[at(found)] = slots[at(up)]
                columns[site, UP] = up
            sizes[at(last - 1)] -= 1
            # Under every piece lies one of the level below: only the last level can become empty.
            if sizes[at(last - 1)] == 0:
                cubes -= 1
            reduced -= 1
            if labelled:
                levels[at(move - first)] = -last
                partners[at(move - first)] = partner
                if partner >= first:
                    levels[at(partner - first)] = 0
                    partners[at(partner - first)] = move
        else:
            for index in range(begins, reads):
                site = at(sites[at(index)])
                up, group = columns[site, UP], columns[site, GROUP]
                below = max(below, columns[site, WRITER])
                # In a large group the first level is the greatest.
                stop = up if up - group <= PLAIN else group + 1
                for reader in range(group, stop):
                    below = max(below, slots[at(reader)])
            level = below + 1
            up = actions[number, UP]
            pieces[at(up)] = level
            pieces[at(up + 1)] = move
            actions[number, UP] = up + PIECE
            actions[number, LAST] = level
            for index in range(begins, reads):
                site = at(sites[at(index)])
                up = columns[site, UP]
                slots[at(up)] = columns[site, WRITER]
                slots[at(up + 1)] = up - columns[site, GROUP]
                slots[at(up + 2)] = columns[site, GONE]
                columns[site, UP] = up + FRAME
                columns[site, GROUP] = up + FRAME
                columns[site, GONE] = 0
                columns[site, WRITER] = level
            for index in range(reads, stops):
                site = at(sites[at(index)])
                up = columns[site, UP]
                if up - columns[site, GROUP] >= PLAIN:
                    _read(columns, slots, int(site), level)
                    continue
                slots[at(up)] = level
                columns[site, UP] = up + 1
            sizes[at(below)] += 1
            cubes = max(cubes, level)
            reduced += 1
            if labelled:
                levels[at(move - first)] = level
                partners[at(move - first)] = -1
        move += 1
        place += 1
    totals[MOVES] = move
    totals[CUBES] = cubes
    totals[REDUCED] = reduced
    return place


@compiled
def _read(columns: Numbers, slots: Numbers, site: int, level: int) -> None:
    """Add a reader to a group that is large, or becomes large."""
    up, group = columns[site, UP], columns[site, GROUP]
    size = up - group
    if size == PLAIN:
        for place in range((size >> 1) - 1, -1, -1):
            _sink(slots, group, 1, place, size, int(slots[group + place]))
    _rise(slots, group, 1, size, level)
    columns[site, UP] = up + 1


@compiled
def _unread(columns: Numbers, slots: Numbers, site: int, level: int) -> None:
    """Remove a reader of this level from a large group."""
    group, out = columns[site, GROUP], columns[site, GONE]
    size = columns[site, UP] - group
    gone = columns[site, DOWN] + out
    if slots[group] == level:
        size -= 1
        _sink(slots, group, 1, 0, size, int(slots[group + size]))
    else:
        _rise(slots, gone, -1, out, level)
        out += 1
    while out > 0 and slots[gone] == slots[group]:
        size -= 1
        _sink(slots, group, 1, 0, size, int(slots[group + size]))
        out -= 1
        _sink(slots, gone, -1, 0, out, int(slots[gone - out]))
    if 2 * out > size or size <= PLAIN:
        size = _settle(slots, group, size, gone, out)
        out = 0
    columns[site, UP] = group + size
    columns[site, DOWN] = gone - out
    columns[site, GONE] = out


@compiled
def _rise(slots: Numbers, root: int, step: int, place: int, level: int) -> None:
    """Put a level at a free place of a binary heap, or above; place i is ``root + step * i``."""
    while place > 0:
        parent = (place - 1) >> 1
        above = slots[root + step * parent]
        if above >= level:
            break
        slots[root + step * place] = above
        place = parent
    slots[root + step * place] = level


@compiled
def _sink(  # noqa: PLR0917 - compiled functions take arguments by position
    slots: Numbers, root: int, step: int, place: int, size: int, level: int
) -> None:
    """Put a level at a free place of a binary heap of this size, or below it."""
    if place >= size:
        return
    child = 2 * place + 1
    while child < size:
        if child + 1 < size and slots[root + step * (child + 1)] > slots[root + step * child]:
            child += 1
        if slots[root + step * child] <= level:
            break
        slots[root + step * place] = slots[root + step * child]
        place = child
        child = 2 * place + 1
    slots[root + step * place] = level


@compiled
def _sort(slots: Numbers, root: int, step: int, size: int) -> None:
    """Sort a binary heap, the least level first."""
    for left in range(size - 1, 0, -1):
        greatest, last = slots[root], slots[root + step * left]
        slots[root + step * left] = greatest
        _sink(slots, root, step, 0, left, last)


@compiled
def _settle(slots: Numbers, group: int, size: int, gone: int, out: int) -> int:
    """Remove the gone levels from a group and return its size; the removals pay for it."""
    _sort(slots, group, 1, size)
    _sort(slots, gone, -1, out)
    left = skipped = 0
    for place in range(size):
        level = slots[group + place]
        if skipped < out and slots[gone - skipped] == level:
            skipped += 1
        else:
            slots[group + left] = level
            left += 1
    # Put the greatest first, since a descending sequence is a heap.
    for place in range(left // 2):
        other = left - 1 - place
        low, high = slots[group + place], slots[group + other]
        slots[group + place], slots[group + other] = high, low
    return left


@compiled
def _room(heap: Arrays, number: int) -> bool:
    """Make room for a move of this action by doubling blocks; return whether the pools had it."""
    columns, actions, sites, totals = heap.columns, heap.actions, heap.sites, heap.totals
    for index in range(actions[number, FIRST], actions[number, STOP]):
        site = sites[index]
        need = FRAME if index < actions[number, READS] else 1
        if columns[site, DOWN] - columns[site, UP] + 1 < need:
            length = max(2 * (columns[site, END] - columns[site, BASE]), _LEAST)
            used = totals[SLOTS_USED]
            if used + length > len(heap.slots):
                return False
            group = columns[site, UP] - columns[site, GROUP]
            _move(columns, site, heap.slots, heap.slots, used, length)
            columns[site, GROUP] = columns[site, UP] - group
            totals[SLOTS_USED] = used + length
    if actions[number, DOWN] - actions[number, UP] + 1 < PIECE:
        length = max(2 * (actions[number, END] - actions[number, BASE]), _LEAST)
        used = totals[PIECES_USED]
        if used + length > len(heap.pieces):
            return False
        _move(actions, number, heap.pieces, heap.pieces, used, length)
        totals[PIECES_USED] = used + length
    return True


@compiled
def _move(  # noqa: PLR0917 - compiled functions take arguments by position
    blocks: Numbers, row: int, source: Numbers, target: Numbers, base: int, size: int
) -> int:
    """Move a block to another place or pool, with this size; return the place after it."""
    old, end = blocks[row, BASE], base + size
    under = blocks[row, UP] - old
    for place in range(under):
        target[base + place] = source[old + place]
    over = blocks[row, END] - 1 - blocks[row, DOWN]
    last = blocks[row, END] - 1
    for place in range(over):
        target[end - 1 - place] = source[last - place]
    blocks[row, BASE] = base
    blocks[row, END] = end
    blocks[row, UP] = base + under
    blocks[row, DOWN] = end - 1 - over
    return end


@compiled
def pack(
    blocks: Numbers,
    sizes: Totals,
    source: Numbers,
    target: Numbers,
    columns: bool,  # noqa: FBT001 - compiled functions take arguments by position
) -> None:
    """Move the first ``len(sizes)`` blocks side by side into another pool, with these sizes.

    `columns` says whether they are the blocks of sites or those of actions.
    """
    base = 0
    for row in range(len(sizes)):
        group = blocks[row, UP] - blocks[row, GROUP]
        base = _move(blocks, row, source, target, base, sizes[row])
        if columns:
            blocks[row, GROUP] = blocks[row, UP] - group


@compiled
def demand(heap: Arrays, counts: Totals, slots: Totals) -> None:
    """Add to `slots` the room that `counts` moves of every action may take in every column.

    `counts` has shape (actions,), `slots` has shape (sites,).
    """
    actions, sites = heap.actions, heap.sites
    for number in range(len(counts)):
        reads = actions[number, READS]
        for index in range(actions[number, FIRST], reads):
            slots[sites[index]] += FRAME * counts[number]
        for index in range(reads, actions[number, STOP]):
            slots[sites[index]] += counts[number]
