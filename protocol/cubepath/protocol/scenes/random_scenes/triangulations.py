"""Random triangulations of a point set."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.random_scenes.stream import Stream
from cubepath.protocol.systems.flips import FlipSystem
from cubepath.protocol.systems.point_sets import Edge

_POINTS_MAX = 200


def random_triangulation(system: FlipSystem, stream: Stream) -> frozenset[Edge]:
    """Return a triangulation: edges in random order, each taken if it crosses none taken before.

    Every triangulation can come out, with long edges more often than if all were equally likely.
    InputError for more than 200 points.
    """
    plane = system.plane
    count = len(plane.points)
    if count > _POINTS_MAX:
        raise InputError(f"{count} points: a random triangulation has at most {_POINTS_MAX}")
    edges = [edge for edge in combinations(range(count), 2) if not plane.on_the_way(*edge)]
    taken = np.empty((3 * count, 2), dtype=np.intp)
    size = 0
    for edge in stream.drawn(edges):
        if not plane.crossings(edge, taken[:size]).any():
            taken[size] = edge
            size += 1
    return frozenset((int(one), int(other)) for one, other in taken[:size])
