"""Solids: where modules are, and what they look like, for viewers in three dimensions.

Pure functions. Pictures lie in the plane; a solid is what stands there, with a height, and its
style says which: the same middles and ends as in a picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, hypot

from cubepath.agents.rendering.pen import Spot


@dataclass(frozen=True, slots=True)
class Solid:
    """A solid: a box, or a disc, which is a box with a round outline; lengths are in cells.

    `angle` is in radians about the upward axis, from the first axis to the second; `size` are the
    lengths before that turn. `word` is written on it, if it is not its number.
    """

    middle: tuple[float, float, float]
    size: tuple[float, float, float]
    angle: float = 0.0
    is_round: bool = False
    word: str | None = None


_HEIGHT, _THIN = 0.5, 0.2
_SQUARE = 0.88


def disc_at(spot: Spot, size: float) -> Solid:
    """Return a disc of this diameter around a point of the plane."""
    return Solid((*_floats(spot), 0.0), (size, size, _HEIGHT), is_round=True)


def box_at(spot: Spot, word: str | None = None) -> Solid:
    """Return a square box around a point of the plane."""
    return Solid((*_floats(spot), 0.0), (_SQUARE, _SQUARE, _HEIGHT), word=word)


def bar(one: Spot, other: Spot) -> Solid:
    """Return a bar from one point of the plane to another, a little short of both."""
    (left, low), (right, top) = _floats(one), _floats(other)
    long = hypot(right - left, top - low)
    return Solid(
        ((left + right) / 2, (low + top) / 2, 0.0),
        (max(long - _THIN, _THIN), _THIN, _THIN),
        atan2(top - low, right - left),
    )


def _floats(spot: Spot) -> Spot:
    return float(spot[0]), float(spot[1])
