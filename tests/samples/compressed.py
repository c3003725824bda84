"""Shapes as the compression chain sees them: their exact shares, and what a sample shows."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from statistics import fmean, stdev
from typing import NamedTuple

from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, HEXAGONS, Cell
from cubepath.protocol.core.sites import Site

Shape = tuple[Cell, ...]
_PARTS = 20
_T = 2.09
"""Student's t, two-sided, 95%, for 19 degrees of freedom; for more it is less."""


def neighbours(cell: Cell) -> list[Cell]:
    """Return the six cells beside a cell."""
    return [(cell[0] + q, cell[1] + r) for q, r in HEX_DIRECTIONS]


def at_origin(sites: Iterable[Site]) -> Shape:
    """Return a shape as it is wherever it lies."""
    cells = [HEXAGONS.check(site) for site in sites]
    q, r = min(cell[0] for cell in cells), min(cell[1] for cell in cells)
    return tuple(sorted((cell[0] - q, cell[1] - r) for cell in cells))


def up_to_symmetry(sites: Iterable[Site]) -> Shape:
    """Return a shape as it is however it is turned or reflected."""
    cells = [HEXAGONS.check(site) for site in sites]
    found = []
    for _ in range(6):
        cells = [(-cell[1], cell[0] + cell[1]) for cell in cells]
        found += [at_origin(cells), at_origin((cell[1], cell[0]) for cell in cells)]
    return min(found)


def pairs_in(shape: Iterable[Cell]) -> int:
    """Return the number of pairs of neighbours."""
    cells = set(shape)
    return sum(near in cells for cell in cells for near in neighbours(cell)) // 2


def all_shapes(count: int) -> list[Shape]:
    """Return all connected shapes; up to five cells none has a hole."""
    found: set[Shape] = {((0, 0),)}
    for _ in range(count - 1):
        found = {
            at_origin((*shape, near))
            for shape in found
            for cell in shape
            for near in neighbours(cell)
            if near not in shape
        }
    return sorted(found)


def shares(shapes: Sequence[Shape], bias: float) -> list[float]:
    """Return the probability of each shape: proportional to bias ** pairs."""
    weights = [bias ** pairs_in(shape) for shape in shapes]
    return [weight / sum(weights) for weight in weights]


class Distance(NamedTuple):
    """A total variation, and half the width of its 95% interval."""

    found: float
    error: float

    @property
    def most(self) -> float:
        """Return the upper end of the interval."""
        return self.found + self.error

    def __str__(self) -> str:
        return f"{self.found:.4f} +- {self.error:.4f}"


def shares_up_to_symmetry(count: int, bias: float) -> dict[Shape, float]:
    """Return the probability of each shape up to symmetry, to five cells."""
    shapes, found = all_shapes(count), dict[Shape, float]()
    for shape, share in zip(shapes, shares(shapes, bias), strict=True):
        kind = up_to_symmetry(shape)
        found[kind] = found.get(kind, 0.0) + share
    return found


def total_variation(one: Mapping[Shape, float], other: Mapping[Shape, float]) -> float:
    """Return half the sum of the differences of two distributions."""
    return sum(abs(one.get(kind, 0) - other.get(kind, 0)) for kind in {*one, *other}) / 2


def distance(runs: Sequence[Sequence[Shape]], due: Mapping[Shape, float]) -> Distance:
    """Return how far the shapes in several runs are from what is due, up to symmetry.

    One run alone is cut into 20, each much longer than shapes last. The total variation is half the
    sum of the signed differences. With the signs that were found it is the mean of a function of
    the shape, so its error follows from the means of the runs.
    """
    if len(runs) == 1:
        size = len(runs[0]) // _PARTS
        runs = [runs[0][part * size : (part + 1) * size] for part in range(_PARTS)]
    kinds = {shape: up_to_symmetry(shape) for shape in {*chain(*runs)}}
    found = [Counter(kinds[shape] for shape in run) for run in runs]
    total = sum(found, Counter[Shape]())
    size = total.total()
    signs = {kind: 1 if total[kind] / size > share else -1 for kind, share in due.items()}
    means = [
        sum(signs[kind] * (each[kind] / each.total() - share) for kind, share in due.items()) / 2
        for each in found
    ]
    return Distance(fmean(means), _T * stdev(means) / len(means) ** 0.5)
