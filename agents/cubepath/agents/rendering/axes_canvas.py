"""A canvas to draw on: matplotlib's axes.

matplotlib is imported only when something is drawn, and only through its objects: no pyplot, so no
window and no global state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from cubepath.agents.rendering.pen import Points, Spot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.path import Path


@dataclass(slots=True)
class AxesCanvas:
    """Draws on axes. Everything has the same zorder, so later drawings lie above earlier ones."""

    axes: Axes
    limits_lines: bool = True

    def shapes(self, shapes: Sequence[Points], **style: Any) -> None:
        """Draw polygons."""
        from matplotlib.collections import PolyCollection  # noqa: PLC0415

        self.axes.add_collection(PolyCollection(shapes, zorder=1, **style), autolim=False)

    def strokes(self, lines: Sequence[Points], **style: Any) -> None:
        """Draw lines between points."""
        from matplotlib.collections import LineCollection  # noqa: PLC0415

        self.axes.add_collection(LineCollection(lines, zorder=1, **style), autolim=False)

    def write(self, at: Spot, word: str, colour: str, size: float) -> None:
        """Write a word as a shape."""
        from matplotlib.patches import PathPatch  # noqa: PLC0415
        from matplotlib.transforms import Affine2D  # noqa: PLC0415

        path = Affine2D().scale(size).translate(*at).transform_path(_glyphs(word))
        self.axes.add_artist(PathPatch(path, facecolor=colour, linewidth=0, zorder=1))


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
