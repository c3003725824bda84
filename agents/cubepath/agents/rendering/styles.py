"""The styles of pictures by name, the values that a system's `drawing` may have; and legends.

matplotlib is imported when a legend is drawn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING

from cubepath.agents.rendering import cells, chords, edges, letters, places
from cubepath.agents.rendering.style import INK, LIGHT, Box, Mark, Shot, Style, Theme
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

STYLES: Mapping[str, Style] = {
    "hexagons": cells.HEXAGONS,
    "squares": cells.SQUARES,
    "map": cells.MAP,
    "edges": edges.EDGES,
    "graph": places.GRAPH,
    "chords": chords.CHORDS,
    "letters": letters.LETTERS,
}


def style_of(scene: Scene) -> Style:
    """Return the style in which a scene is drawn; InputError if its system names none."""
    found = STYLES.get(scene.system.drawing)
    if found is None:
        raise InputError(
            f"{scene.spec}: drawing {scene.system.drawing!r}, expected one of {', '.join(STYLES)}"
        )
    return found


def draw_text(scene: Scene, sites: Sequence[Site]) -> str:
    """Return a picture in plain text of modules at `sites`, by number.

    A module is ``o``, or ``@`` on a cell of the goal; a free cell of the goal is ``+``, any other
    ``.``, and an occupied obstacle or a hole in a map ``#``. A labelled module shows its label,
    followed by ``*`` at its own goal. Hexagons stand in rows offset by half a cell. Segments of an
    arm are ``---`` and ``|`` between vertices, ``===`` and ``H`` on edges of the goal; edges of the
    goal without a segment are ``...`` and ``:``; a marked vertex is ``*``. A general graph has a
    line for each vertex, with its neighbours. The frame holds start, goal and finite workspaces, so
    pictures of one run line up while modules stay in it. For chords and letters see
    `cubepath.agents.rendering.chords` and `letters`.

    >>> scene = scene_from_spec("agv:graph=grid3x2,n=2")
    >>> print(draw_text(scene, scene.start))
    o . +
    o . +
    """
    return style_of(scene).text(scene, sites)


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
