"""Collapses: removing free faces, which proves a complex contractible if one point is left.

A cube is a *free face* of a greater cube if it is a face of that cube exactly once and of no other,
and the greater cube is not itself a face. Removing both is an elementary collapse. It is a
deformation retraction even if the greater cube is glued to itself elsewhere: it is pushed in from
the free face. Sources: Whitehead, *Simplicial spaces, nuclei and m-groups* (1939); Cohen, *A course
in simple-homotopy theory*; Benedetti and Lutz, *Random discrete Morse theory and a new library of
triangulations* (2014) for trying several orders.

A contractible complex need not collapse (Bing's house with two rooms), so a failure proves nothing.
"""

from dataclasses import dataclass

import numpy as np

from cubepath.coordinator.theory.complexes.cubical_complex import (
    CellRows,
    Cells,
    CubicalComplex,
    Numbers,
    cofaces,
    incidence,
)
from cubepath.coordinator.theory.complexes.homology_groups import Homology
from cubepath.protocol.compiled import compiled

ORDERS = 24
"""The number of orders that are tried before a collapse is given up."""


@dataclass(frozen=True, slots=True, eq=False)
class CollapseResult:
    """The result of a sequence of elementary collapses.

    left: the number of cubes of each dimension that are left; as long as the f-vector of the
    complex.
    steps: shape (collapses, 3), one row for each, in order: a dimension k, the number of the
    removed k-cube, and the number of the (k-1)-cube that was its free face.
    """

    left: tuple[int, ...]
    steps: Cells

    @property
    def contractible(self) -> bool:
        """Return whether one point is left; only then does the collapse prove anything."""
        return self.left[:1] == (1,) and not any(self.left[1:])


def collapse(complex_: CubicalComplex) -> CollapseResult:
    """Collapse the complex as long as there are free faces; return the rest.

    Greedy. If more than a point is left of a complex with Euler characteristic 1, other orders are
    tried, `ORDERS` in all and always the same; the one that leaves the fewest cubes counts.
    Linear in the number of faces for each order.

    >>> ring = state_complex(explore(scene_from_spec("agv:graph=C4,n=1"))).complex
    >>> found = collapse(ring)
    >>> found.left, found.contractible
    ((4, 4), False)
    """
    cells = incidence(complex_)
    above = cofaces(cells.faces)
    count = len(above.start) - 1
    best: CollapseResult | None = None
    for attempt in range(ORDERS if complex_.euler == 1 else 1):
        collapsed = _collapsed.for_work(8 * (count + len(cells.faces.cell)))
        steps = collapsed(cells.faces, above, _order(count, attempt), attempt % 2)
        found = _in_numbers(complex_, cells.offset, steps)
        if best is None or sum(found.left) < sum(best.left):
            best = found
        if best.contractible:
            break
    assert best is not None  # noqa: S101 - at least one order is tried
    return best


def contractibility(complex_: CubicalComplex, homology: Homology) -> str:
    """Return what is known about a complex with this homology, and no more than was proved.

    "not contractible" if the homology is not that of a point, else "collapses to a point" if a
    collapse to one was found, else "acyclic, not shown contractible".

    >>> line = state_complex(explore(scene_from_spec("agv:graph=P4,n=1"))).complex
    >>> contractibility(line, homology(line))
    'collapses to a point'
    """
    if not homology.acyclic:
        return "not contractible"
    if collapse(complex_).contractible:
        return "collapses to a point"
    return "acyclic, not shown contractible"


def _order(count: int, attempt: int) -> Cells:
    """Return all cells in the order in which they are first looked at: ascending, or shuffled.

    Shuffled means sorted by a hash of the number, the finaliser of splitmix64, which is the same on
    every machine.
    """
    if attempt < 2:
        return np.arange(count, dtype=np.int32)
    key = np.arange(count, dtype=np.uint64) + np.uint64(attempt * 0x9E3779B97F4A7C15 % 2**64)
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.argsort(key ^ (key >> np.uint64(31)), kind="stable").astype(np.int32)


def _in_numbers(complex_: CubicalComplex, offset: Numbers, steps: Cells) -> CollapseResult:
    """Return the collapse with cubes numbered within their dimensions."""
    dimension = np.searchsorted(offset[1:], steps[:, 0], side="right")
    gone = np.bincount(dimension, minlength=len(offset))
    left = tuple(
        count - int(gone[k]) - int(gone[k + 1]) for k, count in enumerate(complex_.f_vector)
    )
    numbers = steps - np.stack([offset[dimension], offset[dimension - 1]], axis=1)
    return CollapseResult(left, np.column_stack([dimension, numbers]).astype(np.int32))


@compiled
def _collapsed(faces: CellRows, cofaces_: CellRows, order: Cells, last_first: int) -> Cells:
    """Return the removed cells, shape (collapses, 2): each cube and its free face.

    A cell is looked at when it becomes the face of only one cube, and again when that cube stops
    being a face itself. It becomes free at the later of the two, so none is missed.
    """
    cells = len(faces.start) - 1
    above = cofaces_.start[1:] - cofaces_.start[:-1]
    gone = np.zeros(cells, np.bool_)
    steps, found = np.empty((cells // 2, 2), np.int32), 0
    waiting = np.empty(2 * cells + len(faces.cell), np.int32)
    waiting[:cells] = order
    head, tail = 0, cells
    while head < tail:
        if last_first:
            tail -= 1
            free = waiting[tail]
        else:
            free = waiting[head]
            head += 1
        if gone[free] or above[free] != 1:
            continue
        i = cofaces_.start[free]
        while gone[cofaces_.cell[i]]:
            i += 1
        cube = cofaces_.cell[i]
        if above[cube] == 0:
            steps[found, 0], steps[found, 1] = cube, free
            found += 1
            gone[cube], gone[free] = True, True
            tail = _take_away(int(cube), faces, above, waiting, tail)
            tail = _take_away(int(free), faces, above, waiting, tail)
    return steps[:found]


@compiled
def _take_away(cell: int, faces: CellRows, above: Numbers, waiting: Cells, tail: int) -> int:
    """Stop counting the cell as a coface; return the new end of the queue of cells to look at."""
    for i in range(faces.start[cell], faces.start[cell + 1]):
        below = faces.cell[i]
        above[below] -= 1
        if above[below] == 1:
            waiting[tail] = below
            tail += 1
        elif above[below] == 0:
            for j in range(faces.start[below], faces.start[below + 1]):
                if above[faces.cell[j]] == 1:
                    waiting[tail] = faces.cell[j]
                    tail += 1
    return tail
