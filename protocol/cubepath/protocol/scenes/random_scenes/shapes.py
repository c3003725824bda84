"""Random connected shapes of cells: uniform among all of a size, or grown.

A shape is a connected set of cells of a lattice; two that differ by a translation are the same one
in another place (a *fixed* polyhex or polyomino).
"""

from __future__ import annotations

from collections.abc import Sequence

from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, Cell
from cubepath.protocol.scenes.random_scenes.stream import Stream

SIX: tuple[Cell, ...] = HEX_DIRECTIONS
"""The neighbours of a hexagon, in a circle."""
FOUR: tuple[Cell, ...] = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""The neighbours of a square."""


def uniform_shape(count: int, beside: Sequence[Cell], stream: Stream) -> tuple[Cell, ...]:
    """Return a shape of `count` cells that holds (0, 0), each equally likely, and its cells so too.

    `beside` is `SIX` or `FOUR`. The cells are listed in ascending order.

    Method. A cluster grows from (0, 0): each cell beside it is looked at once, in an order that
    depends only on what was seen before, and joins with probability 1/3 (Leath 1976). If it
    stops growing with `count` cells and has t cells beside it, it is taken with probability
    (2/3)^(most - t), where `most` is the greatest t of that size; else all begins again.

    Proof. A shape that holds (0, 0) is found with probability (1/3)^(count - 1) (2/3)^t, whatever
    the order, and so taken with (1/3)^(count - 1) (2/3)^most, the same for all. Every shape has as
    many translates that hold (0, 0) as cells, one for each. As for `most`: the first cell has 6
    (4) cells beside it. A shape can be listed so that each cell is beside an earlier one. It was
    then itself beside the shape, and of its 6 (4) neighbours one is in the shape, and for hexagons
    two more are beside that one and so known already: it adds at most 3 and takes itself
    away. So t is at most 2 * count + 4 (2 * count + 2), and a straight line has as many.

    Cost. 1/3 makes the loss of each further cell least, (1/3)(2/3)^2 = 4/27 against the growth
    of the number of shapes, some 5.18 (4.06): to begin again is needed about 1.3^count (1.7^count)
    times, mostly after a few cells.
    """
    most = 2 * count + (4 if len(beside) == 6 else 2)
    while True:
        found = grown_once(count, beside, most, stream)
        if found is not None:
            return found


def grown_once(
    count: int, beside: Sequence[Cell], most: int, stream: Stream
) -> tuple[Cell, ...] | None:
    """Return the cluster of one try of `uniform_shape`; None if it has another size or is refused.

    With `most` as there, each shape that holds (0, 0) has the probability
    (1/3)^(count - 1) (2/3)^most.
    """
    below = stream.below
    cells: list[Cell] = [(0, 0)]
    seen: set[Cell] = {(0, 0)}
    closed = 0
    for q, r in cells:  # it grows meanwhile
        for along, up in beside:
            near = (q + along, r + up)
            if near not in seen:
                seen.add(near)
                if below(3):
                    closed += 1
                else:
                    cells.append(near)
        if len(cells) > count:
            return None
    if len(cells) == count and all(below(3) for _ in range(most - closed)):
        return tuple(sorted(cells))
    return None


def grown_shape(count: int, beside: Sequence[Cell], stream: Stream) -> tuple[Cell, ...]:
    """Return a shape of `count` cells that holds (0, 0), grown from there.

    Cells are listed in ascending order. Each new cell is one of those beside the shape, each
    equally likely (Eden 1961). Compact shapes are more likely than others.
    """
    cells: set[Cell] = {(0, 0)}
    border = list(beside)
    known: set[Cell] = {(0, 0), *border}
    while len(cells) < count:
        place = stream.below(len(border))
        border[place], border[-1] = border[-1], border[place]
        cell = border.pop()
        cells.add(cell)
        for along, up in beside:
            near = (cell[0] + along, cell[1] + up)
            if near not in known:
                known.add(near)
                border.append(near)
    return tuple(sorted(cells))
