"""Connected components, and two-sidedness: a union-find with parity, compiled.

Sources: Tarjan, *Efficiency of a good but not linear set union algorithm* (1975), with path
compression; the parity of each element against its root is the usual extension.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex
from cubepath.coordinator.theory.complexes.incidence import Cells
from cubepath.protocol.compiled import compiled


def components(complex_: CubicalComplex) -> Cells:
    """Return the component of every vertex, shape (vertices,).

    Components are numbered 0, 1, ... in the order of their least vertices.
    """
    vertices = complex_.f_vector[0] if complex_.faces else 0
    if complex_.dimension < 1:
        return np.arange(vertices, dtype=np.int32)
    ends = complex_.faces[1][:, 0]
    return classes(vertices, ends, np.zeros(len(ends), np.bool_))[0]


def classes(count: int, pairs: Cells, differ: NDArray[np.bool_]) -> tuple[Cells, NDArray[np.bool_]]:
    """Return the class of each of `count` elements, and for each class whether it has two sides.

    pairs: shape (n, 2), elements of the same class. A class has two sides if its elements can be
    put on two sides such that the elements of pairs with differ[i], shape (n,), lie on different
    sides and those of all other pairs on the same side. Classes are numbered in the order of their
    least elements.
    """
    steps = 4 * (count + len(pairs))
    return _classes.for_work(steps)(count, np.ascontiguousarray(pairs), differ)


@compiled
def _classes(
    count: int, pairs: Cells, differ: NDArray[np.bool_]
) -> tuple[Cells, NDArray[np.bool_]]:
    # A root is the least element of its class, so a class is first met at its root.
    parent, odd = np.arange(count).astype(np.int32), np.zeros(count, np.bool_)
    two_sided = np.ones(count, np.bool_)
    for i in range(len(pairs)):
        one, other = pairs[i, 0], pairs[i, 1]
        root, of_other = _root(parent, odd, one), _root(parent, odd, other)
        # Now both are direct children of their roots, unless they are roots themselves.
        apart = odd[one] ^ odd[other] ^ differ[i]
        if root == of_other:
            two_sided[root] &= not apart
            continue
        low, high = min(root, of_other), max(root, of_other)
        parent[high], odd[high] = low, apart
        two_sided[low] &= two_sided[high]
    number, found = np.empty(count, np.int32), 0
    sides = np.empty(count, np.bool_)
    for element in range(count):
        root = _root(parent, odd, element)
        if root == element:
            number[element], sides[found] = found, two_sided[element]
            found += 1
        else:
            number[element] = number[root]
    return number, sides[:found]


@compiled
def _root(parent: Cells, odd: NDArray[np.bool_], element: int) -> int:
    """Return the root of the element, and make all elements on the way its direct children."""
    root, side = element, False
    while parent[root] != root:
        side ^= odd[root]
        root = parent[root]
    while parent[element] != root and element != root:
        above, rest = parent[element], side ^ odd[element]
        parent[element], odd[element] = root, side
        element, side = above, rest
    return root
