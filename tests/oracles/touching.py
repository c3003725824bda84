"""Which cells touch, from where they lie: a second way to the contacts of a lattice."""

from collections.abc import Iterable
from itertools import product

from cubepath.protocol.core.catalogue import Cell, Lattice
from cubepath.protocol.core.sites import Site

NEAREST = {"hexagons": 2, "squares": 1, "cubes": 1, "dodecahedra": 2}
"""The squared distance of the centres of two cells that touch; hexagons lie across a cube."""


def ends(edge: Cell) -> set[Cell]:
    *first, along = edge
    return {tuple(first), tuple(x + (axis == along) for axis, x in enumerate(first))}


def touch(lattice: Lattice, one: Cell, other: Cell) -> bool:
    """Return whether two cells are as near as cells get; for edges, whether they share one end."""
    if lattice.name not in NEAREST:
        return len(ends(one) & ends(other)) == 1
    steps = [there - here for here, there in zip(one, other, strict=True)]
    if lattice.name == "hexagons":
        steps.append(-sum(steps))
    return sum(step * step for step in steps) == NEAREST[lattice.name]


def touching(lattice: Lattice, cell: Cell) -> set[Cell]:
    """Return the cells that touch a cell."""
    size = lattice.dimension
    tails = product(range(size), repeat=lattice.arity - size)
    near = product(*(range(x - 1, x + 2) for x in cell[:size]))
    found = {(*by, *tail) for by, tail in product(near, tails)}
    return {other for other in found if touch(lattice, cell, other)}


def pieces(lattice: Lattice, cells: Iterable[Site]) -> int:
    """Return into how many pieces cells fall: each takes the least number among its neighbours."""
    labels = {lattice.check(cell): number for number, cell in enumerate(cells)}
    for _ in labels:
        for cell in labels:
            near = labels.keys() & touching(lattice, cell)
            labels[cell] = min(labels[each] for each in (cell, *near))
    return len({*labels.values()})
