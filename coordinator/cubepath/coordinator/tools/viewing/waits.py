"""Which move each move of a path waited for: the heap of pieces of the path as it stands.

Nothing is cancelled here. Each move falls onto the moves before it until one that it does not
commute with; so its *depth* is one more than the greatest depth of those, and the one that it
*waits for* is the last of the greatest depth among them. From the last move of the greatest depth
these lead down to depth 1, which is the longest chain of moves that had to follow each other. In a
normal cube path the depth of a move is the number of its cube.

Source: heaps of pieces (Viennot).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.sites import Site


class Waits(NamedTuple):
    """The heap of a path, in the order of its moves.

    `depths` counts from 1, int32, shape (moves,). `below` has the place, from 0, of the move that
    each waits for, or -1, int32, shape (moves,). `chain` has the places of the moves of the longest
    chain in their order, int32, shape (greatest depth,).
    """

    depths: NDArray[np.int32]
    below: NDArray[np.int32]
    chain: NDArray[np.int32]


def waits_of(path: Iterable[Action]) -> Waits:
    """Return the heap of a path; each move at the cost of its support.

    >>> left, right = Action([1, 2], [1, 2], [1], [2]), Action([2, 3], [2, 3], [2], [3])
    >>> far = Action([8, 9], [8, 9], [8], [9])
    >>> found = waits_of([left, far, right])
    >>> found.depths.tolist(), found.below.tolist(), found.chain.tolist()
    ([1, 1, 2], [-1, -1, 0], [0, 2])
    """
    nobody = (0, -1)
    # For each site the greatest depth, and the last move of it, among those that write the site,
    # and among those that touch it at all: a move that only reads it waits for the former alone.
    written: dict[Site, tuple[int, int]] = {}
    touched: dict[Site, tuple[int, int]] = {}
    depths: list[int] = []
    below: list[int] = []
    deepest = nobody
    for place, action in enumerate(path):
        under = nobody
        for site in action.trace:
            under = max(under, touched.get(site, nobody))
        for site in action.reads:
            under = max(under, written.get(site, nobody))
        own = under[0] + 1, place
        depths.append(own[0])
        below.append(under[1])
        deepest = max(deepest, own)
        for site in action.trace:
            written[site] = touched[site] = own
        for site in action.reads:
            touched[site] = max(own, touched.get(site, nobody))
    chain: list[int] = []
    place = deepest[1]
    while place >= 0:
        chain.append(place)
        place = below[place]
    return Waits(
        np.array(depths, np.int32), np.array(below, np.int32), np.array(chain[::-1], np.int32)
    )
