"""Heights of segments, of which the rule `word` speaks.

The docstring of `word` has what a height is.
"""

from __future__ import annotations

from collections.abc import Sequence

from cubepath.protocol.core.catalogue import EDGES
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site


def height(edge: Site) -> int:
    """Return the x-coordinate of the vertex after a segment on this edge."""
    x, _, axis = EDGES.check(edge)
    return x + (1 if axis == 0 else 0)


def wanted_height(goals: Sequence[Site]) -> int:
    """Return the height of a segment in the goal word, whose edge there is its only goal."""
    if not goals:
        raise InputError("rule 'word' needs a goal word")
    return height(goals[0])
