"""The normal form of a long path for `cubepath verify`, by two passes without a heap.

The first pass finds the moves that cancel, the second the level of each that remains. Both keep a
column for each site, as the checks of a proof do, and cost the supports of the moves. The code that
shortens is not used.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.sites import Site


def cubes_of(path: Sequence[Action]) -> list[list[Action]]:
    """Return the normal cube path of an edge path; a cube has its moves in the order of the path.

    Normal is what cannot be moved further down: the level of a move is one more than the greatest
    level of those before it that remain and do not commute with it.

    >>> out, other = Action([1, 2], [1, 2], [1], [2]), Action([5, 6], [5, 6], [5], [6])
    >>> cubes_of([out, other]) == [[out, other]], cubes_of([out, other, out]) == [[other]]
    (True, True)
    """
    written: dict[Site, int] = {}
    touched: dict[Site, int] = {}
    cubes: list[list[Action]] = []
    for place in remaining(path):
        action = path[place]
        below = 0
        for site in action.trace:
            below = max(below, touched.get(site, 0))
        for site in action.reads:
            below = max(below, written.get(site, 0))
        for site in action.trace:
            written[site] = touched[site] = below + 1
        for site in action.reads:
            touched[site] = max(below + 1, touched.get(site, 0))
        if below == len(cubes):
            cubes.append([])
        cubes[below].append(action)
    return cubes


def remaining(path: Sequence[Action]) -> array[int]:
    """Return the places of the moves that remain when all that cancels is taken out.

    A move cancels with the last that remains and equals it, unless one between the two remains that
    does not commute with them.
    """
    # For each site: the remaining moves that write it, each with the number of readers since. The
    # places of moves and the numbers of readers are two arrays, since there may be millions.
    writers: dict[Site, array[int]] = {}
    readers: dict[Site, array[int]] = {}
    equal: dict[Action, array[int]] = {}
    left = bytearray(len(path))
    for place, action in enumerate(path):
        for site in action.support:
            if site not in writers:
                writers[site], readers[site] = array("q", [-1]), array("q", [0])
        before = equal.setdefault(action, array("q"))
        last = before[-1] if before else -1
        if (
            before
            and all(writers[site][-1] == last and not readers[site][-1] for site in action.trace)
            and all(writers[site][-1] < last for site in action.reads)
        ):
            before.pop()
            left[last] = 0
            for site in action.trace:
                writers[site].pop()
                readers[site].pop()
            for site in action.reads:
                readers[site][-1] -= 1
            continue
        before.append(place)
        left[place] = 1
        for site in action.trace:
            writers[site].append(place)
            readers[site].append(0)
        for site in action.reads:
            readers[site][-1] += 1
    return array("q", [place for place, remains in enumerate(left) if remains])
