"""The normal form of a long path for `cubepath verify`, without a heap.

`dependencies` finds the moves that cancel; a pass over the others finds their levels, at the cost
of their supports. The code that shortens is not used.
"""

from collections.abc import Sequence

from cubepath.coordinator.verification.dependencies import numbered, remaining
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
    names, (numbers,) = numbered(path)
    for place in remaining(numbers, names):
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
