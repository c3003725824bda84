"""The legend of a picture: the meaning of the marks in it.

It only draws what it is given. matplotlib is imported when something is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING

from cubepath.agents.rendering.pen import INK, LIGHT, Box, Mark, Shot, Theme
from cubepath.agents.rendering.styles import style_of
from cubepath.protocol.core.system import Scene

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

_SIZE, _ROW = 8.5, 0.19
"""The font size in points, and the height of a row in inches."""
_LETTER, _SWATCH = 0.067, 0.42
"""In inches: the approximate width of a letter, and of a swatch with its margins."""


@dataclass(frozen=True, slots=True)
class Legend:
    """The marks of some pictures, in rows of `columns`."""

    marks: tuple[Mark, ...]
    columns: int
    theme: Theme = LIGHT

    @property
    def height(self) -> float:
        """Return the height of the legend, in inches; 0 if it is empty."""
        return _ROW * ceil(len(self.marks) / self.columns)

    def put(self, figure: Figure, left: float, top: float) -> None:
        """Put the legend on a figure; `left` and `top` are in inches from its upper left corner."""
        if not self.marks:
            return
        wide, high = figure.get_size_inches()
        figure.legend(
            handles=[_swatch(mark, self.theme) for mark in self.marks],
            loc="upper left",
            bbox_to_anchor=(left / wide, 1 - top / high),
            ncols=self.columns,
            frameon=False,
            fontsize=_SIZE,
            labelcolor=self.theme.of(INK),
            handlelength=1.5,
            borderpad=0,
            borderaxespad=0,
            labelspacing=0.35,
        )


def legend_of(
    scene: Scene, shots: Sequence[Shot], box: Box, wide: float, theme: Theme = LIGHT
) -> Legend:
    """Return the legend for pictures of these states in this frame, for a width of `wide` inches.

    It explains the outlines, traces, rings, bands and dark places that occur.
    """
    marks = tuple(style_of(scene).marks(scene, shots, box))
    longest = max((len(mark.meaning) for mark in marks), default=0)
    columns = max(1, int(wide / (_SWATCH + _LETTER * longest)))
    return Legend(marks, min(columns, len(marks) or 1), theme)


def _swatch(mark: Mark, theme: Theme) -> Artist:
    from matplotlib.lines import Line2D  # noqa: PLC0415
    from matplotlib.patches import Patch  # noqa: PLC0415

    face, edge = theme.of(mark.face), theme.of(mark.edge)
    if not mark.is_round:
        return Patch(facecolor=face, edgecolor=edge, label=mark.meaning)
    return Line2D(
        (),
        (),
        linestyle="none",
        marker="o",
        markersize=7,
        markerfacecolor=face,
        markeredgecolor=edge,
        label=mark.meaning,
    )
