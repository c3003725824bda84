"""The legend of a picture: what the marks that occur in it mean.

Room: agents; draws what it is given and asks nobody. matplotlib is imported when something is
drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING

from cubepath.agents.rendering.marks import Mark, Shot
from cubepath.agents.rendering.pen import INK, Box
from cubepath.agents.rendering.styles import style_of
from cubepath.protocol.core.system import Scene

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

_SIZE, _ROW = 8.5, 0.19
"""The size of the words in points, and the height of a row in inches."""
_LETTER, _SWATCH = 0.067, 0.42
"""In inches: about how wide a letter is, and a swatch with the room about it."""


@dataclass(frozen=True, slots=True)
class Legend:
    """The marks of some pictures in rows of so many; `height` is theirs in inches."""

    marks: tuple[Mark, ...]
    columns: int

    @property
    def height(self) -> float:
        """Return how much room the legend takes, in inches; 0 where there is nothing to say."""
        return _ROW * ceil(len(self.marks) / self.columns)

    def put(self, figure: Figure, left: float, top: float) -> None:
        """Put the legend on a figure; `left` and `top` count in inches from its upper left."""
        if not self.marks:
            return
        wide, high = figure.get_size_inches()
        figure.legend(
            handles=[_swatch(mark) for mark in self.marks],
            loc="upper left",
            bbox_to_anchor=(left / wide, 1 - top / high),
            ncols=self.columns,
            frameon=False,
            fontsize=_SIZE,
            labelcolor=INK,
            handlelength=1.5,
            borderpad=0,
            borderaxespad=0,
            labelspacing=0.35,
        )


def legend_of(scene: Scene, shots: Sequence[Shot], box: Box, wide: float) -> Legend:
    """Return the legend of pictures of these states in this frame, `wide` inches to lie in.

    It says of the outlines, traces, rings, bands and dark places that occur what they mean.
    """
    marks = tuple(style_of(scene).marks(scene, shots, box))
    longest = max((len(mark.meaning) for mark in marks), default=0)
    columns = max(1, int(wide / (_SWATCH + _LETTER * longest)))
    return Legend(marks, min(columns, len(marks) or 1))


def _swatch(mark: Mark) -> Artist:
    from matplotlib.lines import Line2D  # noqa: PLC0415
    from matplotlib.patches import Patch  # noqa: PLC0415

    if not mark.is_round:
        return Patch(facecolor=mark.face, edgecolor=mark.edge, label=mark.meaning)
    return Line2D(
        (),
        (),
        linestyle="none",
        marker="o",
        markersize=7,
        markerfacecolor=mark.face,
        markeredgecolor=mark.edge,
        label=mark.meaning,
    )
