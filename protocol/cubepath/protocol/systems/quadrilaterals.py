"""All quadrilaterals of a small point set in which a diagonal can flip.

Runs and environments need this list, to number all that could ever happen; shortening and search do
not.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.systems.point_sets import (
    PointSet,
    Quadrilateral,
    edge_of,
    quadrilateral,
)

POINTS_MAX = 300
"""The largest point set: random points have about three flips for every pair."""
FLIPS_MAX = 200_000
"""The most flips; n points in convex position have n (n-1) (n-2) (n-3) / 24."""


def all_quadrilaterals(plane: PointSet) -> tuple[Quadrilateral, ...]:
    """Return all quadrilaterals in which a diagonal can flip, once each, by their corners.

    Raises InputError if there are too many to list.
    """
    count = len(plane.points)
    if count > POINTS_MAX:
        raise InputError(
            f"{count} points have too many flips to list them all, expected at most {POINTS_MAX}"
        )
    # Bits of an integer stand for points: those left of a line, those on a segment.
    seen = [_seen_from(plane, corner) for corner in range(count)]
    left, on = [rows for rows, _ in seen], [rows for _, rows in seen]

    def apexes(one: int, other: int) -> Iterator[int]:
        """Yield the points left of an edge that form an empty triangle with it."""
        beside = left[one][other]
        for apex in _numbers(beside):
            within = beside & left[other][apex] & left[apex][one]
            if not (within or on[other][apex] or on[apex][one]):
                yield apex

    found: list[Quadrilateral] = []
    for one in range(count):
        for other in range(one + 1, count):
            if on[one][other]:
                continue
            overs = list(apexes(one, other))
            for under in apexes(other, one):
                found += [
                    quadrilateral(one, under, other, over)
                    for over in overs
                    if (one, other) < edge_of(under, over)
                    and left[under][over] >> one & 1
                    and left[over][under] >> other & 1
                ]
        if len(found) > FLIPS_MAX:
            raise InputError(f"more than {FLIPS_MAX} flips among {count} points: too many")
    return tuple(sorted(found, key=lambda each: each.corners))


def _seen_from(plane: PointSet, corner: int) -> tuple[list[int], list[int]]:
    """Return, for each other point, the points left of the line to it and those in between."""
    points = np.array(plane.points, dtype=object)
    points -= points[corner]
    if np.abs(points).max() < 2**30:  # no product overflows
        points = points.astype(np.int64)
    x, y = points[:, 0], points[:, 1]
    turn = np.outer(x, y) - np.outer(y, x)
    ahead = np.outer(x, x) + np.outer(y, y)
    far = (x * x + y * y)[:, None]
    return _bits(turn > 0), _bits((turn == 0) & (ahead > 0) & (ahead < far))


def _bits(rows: NDArray[np.bool_]) -> list[int]:
    packed = np.packbits(rows.astype(bool), axis=1, bitorder="little")
    return [int.from_bytes(row.tobytes(), "little") for row in packed]


def _numbers(bits: int) -> tuple[int, ...]:
    return tuple(number for number in range(bits.bit_length()) if bits >> number & 1)
