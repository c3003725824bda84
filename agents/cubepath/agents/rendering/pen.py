"""Drawing tools: colours, and a pen for shapes, lines and words on axes.

Room: agents. matplotlib is imported only when something is drawn, and only through its objects: no
pyplot, so no window and no global state.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import cos, pi, sin
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.path import Path

Points: TypeAlias = NDArray[np.float64]
Spot: TypeAlias = tuple[float, float]
Colour: TypeAlias = tuple[float, float, float]
Box: TypeAlias = tuple[float, float, float, float]
"""Left, right, low, high."""

INK, GOAL, WALL = "#22252a", "#d6246e", "#5a5e65"
PALE_GOAL, LINE, TILE = "#f7c9dc", "#cdd0d4", "#f0f1f3"
GHOST = "#d3d3d4"
"""The trace in a legend, which belongs to no particular module."""
_HUES = (
    *("#332288", "#ee7733", "#44aa99", "#ddcc77", "#0077bb"),
    *("#117733", "#88ccee", "#999933", "#aa4499"),
)
"""Distinguishable for the colour-blind, and distinct from goals and obstacles (Tol, "muted" and
"vibrant")."""


def palette(count: int) -> list[Colour]:
    """Return a colour for each module by number, independent of how many there are.

    The nine hues are followed by lighter and then darker ones; they repeat after 27.
    """
    return [_colour(number % len(_HUES), number // len(_HUES) % 3) for number in range(count)]


@lru_cache
def _colour(hue: int, shade: int) -> Colour:
    """Return a hue, unmixed, mixed with white or mixed with black."""
    red, green, blue = (part / 255 for part in bytes.fromhex(_HUES[hue][1:]))
    kept, added = ((1.0, 0.0), (0.6, 0.4), (0.62, 0.0))[shade]
    return kept * red + added, kept * green + added, kept * blue + added


@dataclass(frozen=True, slots=True)
class Pen:
    """Draws on axes; `scale` is the width of a cell in points.

    Everything has the same zorder, so later drawings lie above earlier ones.
    """

    axes: Axes
    box: Box
    scale: float

    def line(self, part: float) -> float:
        """Return a line width in points that is this part of a cell, within limits."""
        return min(max(part * self.scale, 0.4), 2.4)

    def shapes(self, shapes: Sequence[Points], **style: Any) -> None:
        """Draw polygons."""
        from matplotlib.collections import PolyCollection  # noqa: PLC0415

        if len(shapes):
            self.axes.add_collection(PolyCollection(shapes, zorder=1, **style), autolim=False)

    def strokes(self, lines: Sequence[Points], **style: Any) -> None:
        """Draw lines between points."""
        from matplotlib.collections import LineCollection  # noqa: PLC0415

        if len(lines):
            self.axes.add_collection(LineCollection(lines, zorder=1, **style), autolim=False)

    def discs(self, points: Iterable[Spot], radius: float, **style: Any) -> None:
        """Draw discs with a dark outline around these points, such as the joints of an arm."""
        rings = [arcs([(0, 0)], radius) + point for point in dict.fromkeys(points)]
        self.shapes(rings, edgecolors=INK, linewidths=0.05 * self.scale, **style)

    def write(self, at: Spot, word: str, on: Colour, *, size: float = 1) -> None:
        """Write a word on a cell of this colour, as a shape that scales with the cell."""
        from matplotlib.patches import PathPatch  # noqa: PLC0415
        from matplotlib.transforms import Affine2D  # noqa: PLC0415

        path = Affine2D().scale(size).translate(*at).transform_path(_glyphs(word))
        light = 0.3 * on[0] + 0.59 * on[1] + 0.11 * on[2] > 0.5
        self.axes.add_artist(
            PathPatch(path, facecolor=INK if light else "white", linewidth=0, zorder=1)
        )


@lru_cache(maxsize=4096)
def _glyphs(word: str) -> Path:
    """Return a word as a path centred at the origin that fits in a cell."""
    from matplotlib.textpath import TextPath  # noqa: PLC0415
    from matplotlib.transforms import Affine2D  # noqa: PLC0415

    path, tall = TextPath((0, 0), word, size=1), TextPath((0, 0), "0", size=1).get_extents().height
    box = path.get_extents()
    scale = min(0.36 / tall, 0.54 / box.width)
    centred = Affine2D().translate(-(box.x0 + box.x1) / 2, -tall / 2)
    return centred.scale(scale).transform_path(path)


def arcs(
    middles: Sequence[tuple[float, float]], radius: float, *, corners: int = 36, first: float = 0
) -> Points:
    """Return a convex outline of equal arcs around these points, from the angle `first` on."""
    count = len(middles)
    steps = corners // count
    return np.array(
        [
            (x + radius * cos(turn), y + radius * sin(turn))
            for number, (x, y) in enumerate(middles)
            for step in range(steps + (count > 1))
            for turn in (first + 2 * pi * (number * steps + step) / corners,)
        ]
    )
