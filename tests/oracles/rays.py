"""Which cell a ray meets first, worked out from the planes around each cell."""

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]


def planes(drawing: str) -> Points:
    """Return the vectors n such that a cell around 0 has all p with n . p <= 1."""
    steps, length = (1, 2.0) if drawing == "cubes" else (2, 1.0)
    ends = [end for end in product((-1, 0, 1), repeat=3) if sum(map(abs, end)) == steps]
    return length * np.array(ends, np.float64)


def first_met(
    cells: Sequence[tuple[Points, Points]], spots: Points, axes: Points, size: float
) -> list[int]:
    """Return the number of the cell that each spot of a picture shows; -1 where there is none.

    A cell is its middle, shape (3,), and its planes, shape (n, 3); it is taken `size` times as
    large. The axes are those to the right, upwards and towards the viewer, from where rays come.
    """
    nearest, found = np.full(len(spots), -np.inf), np.full(len(spots), -1)
    for number, (middle, normals) in enumerate(cells):
        speed = normals @ axes[2]
        room = size - (spots @ axes[:2] - middle) @ normals.T
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = room / speed
        enters = np.where(speed > 1e-9, crossing, np.inf).min(axis=1)
        leaves = np.where(speed < -1e-9, crossing, -np.inf).max(axis=1)
        beside = (np.abs(speed) <= 1e-9) & (room < 0)
        met = (enters > leaves) & ~beside.any(axis=1) & (enters > nearest)
        nearest[met], found[met] = enters[met], number
    return found.tolist()
