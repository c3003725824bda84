"""The envelope of time-optimal paths: the cubes in which each move of a path may lie.

Source: Abrams and Ghrist, figure on geodesics and the envelope of time-minimising paths. The normal
cube path makes every move as early as possible. Counted from the other end, each move can be made
as late as possible, in the same number of cubes. The difference is the slack of the move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.sites import Site


@dataclass(frozen=True, slots=True)
class Window:
    """The earliest and the latest cube, from 1, in which a move may lie in a shortest schedule."""

    action: Action
    earliest: int
    latest: int


def envelope(cubes: Sequence[Sequence[Action]]) -> tuple[Window, ...]:
    """Return the windows of all moves of a normal cube path, in its order.

    One pass forwards and one back, each move at the cost of its support.
    """
    moves = [action for cube in cubes for action in cube]
    earliest = _levels(moves)
    latest = _levels(moves[::-1])[::-1]
    length = len(cubes)
    return tuple(
        Window(action, first, length + 1 - last)
        for action, first, last in zip(moves, earliest, latest, strict=True)
    )


def _levels(moves: Sequence[Action]) -> list[int]:
    """Return for each move the length of the longest chain of moves that ends with it."""
    written: dict[Site, int] = {}
    touched: dict[Site, int] = {}
    found = []
    for action in moves:
        level = 1 + max(
            max((touched.get(site, 0) for site in action.trace), default=0),
            max((written.get(site, 0) for site in action.support), default=0),
        )
        for site in action.support:
            touched[site] = max(level, touched.get(site, 0))
        for site in action.trace:
            written[site] = level
        found.append(level)
    return found
