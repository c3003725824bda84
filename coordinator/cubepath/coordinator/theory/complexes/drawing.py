"""Pictures of small complexes: vertices, edges, squares and cubes, in the plane or in space.

In space what is near lies over what is far, which is paler. matplotlib is imported when something
is drawn.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.rendering.pen import DARK, INK, LIGHT, PAPER, WALL, Theme, arcs
from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex
from cubepath.coordinator.theory.complexes.vertex_layout import (
    ProjectedView,
    best_view,
    corners_of_squares,
    laid_out,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.output_files import written_whole

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

VERTICES_MAX = 1500
"""Complexes with more vertices are not drawn, since nothing could be recognised."""
SUFFIXES = (".png", ".svg", ".pdf")
_WIDE, _LEAST, _TITLE, _LEGEND = 7.0, 2.4, 0.5, 0.35
"""In inches: the width of a picture, the least height of the complex, of the title and legend."""
_RADIUS, _MARGIN = 0.05, 0.25
"""The radius of a vertex in inches, and the margin in edges of cubes."""
_ALPHA, _PALE = 0.55, 0.55
"""How opaque squares are, and how much paler the farthest are than the nearest."""
_SQUARES = ("#3b7dd8", "#1f9e89", "#d6246e", "#e08a1e", "#6a4fb3")
"""The colour of a square by the dimension, 2, 3, ..., of the largest cube that it is in."""


def largest_cubes(complex_: CubicalComplex) -> NDArray[np.int64]:
    """Return for each square the dimension of the largest cube that it is a face of."""
    above = np.full(complex_.f_vector[-1], complex_.dimension, dtype=np.int64)
    for k in range(complex_.dimension, 2, -1):
        below = np.full(complex_.f_vector[k - 1], k - 1, dtype=np.int64)
        np.maximum.at(below, complex_.faces[k].reshape(len(above), -1), above[:, None])
        above = below
    return above if complex_.dimension >= 2 else np.empty(0, dtype=np.int64)


def draw_complex(
    complex_: CubicalComplex, path: Path | str, title: str = "", *, dark: bool = False
) -> None:
    """Draw the complex to a file: in the plane up to dimension 1, else in space.

    Squares are coloured by the dimension of the largest cube that they are in; `dark` is for dark
    ground. InputError for more than `VERTICES_MAX` vertices, an unknown suffix, or a file that
    cannot be written.

    >>> found = state_complex(explore(scene_from_spec("agv:graph=K5,n=2"))).complex
    >>> draw_complex(found, "agv.png", title="two vehicles on K5")
    >>> from PIL import Image
    >>> with Image.open("agv.png") as picture:
    ...     picture.format
    'PNG'
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: expected a picture's suffix, one of {', '.join(SUFFIXES)}")
    if not 0 < complex_.f_vector[0] <= VERTICES_MAX:
        raise InputError(
            f"{complex_.f_vector[0]} vertices to draw, expected at most {VERTICES_MAX}"
        )
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    theme = DARK if dark else LIGHT
    edges = complex_.faces[1][:, 0] if complex_.dimension > 0 else np.empty((0, 2), np.int32)
    if complex_.dimension < 2:
        places = laid_out(complex_, 2)
        view = ProjectedView(places, np.ones(len(places)))
    else:
        view = best_view(laid_out(complex_, 3), edges)
    wide, tall = np.ptp(view.places, axis=0) + 2 * _MARGIN
    inner = min(max(_WIDE * float(tall / wide), _LEAST), _WIDE)
    high = inner + _TITLE + _LEGEND
    figure = Figure(figsize=(_WIDE, high), dpi=150, facecolor=theme.of(PAPER))
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, _LEGEND / high, 1, inner / high))
    _draw(axes, complex_, view, edges, theme)
    axes.set_axis_off()
    axes.set_aspect("equal")
    if complex_.dimension >= 2:
        figure.legend(
            handles=_swatches(largest_cubes(complex_)),
            loc="lower center",
            ncols=5,
            frameon=False,
            fontsize=9,
            labelcolor=theme.of(INK),
        )
    counts = ", ".join(
        f"{count} {name if count > 1 else name.replace('vertices', 'vertex').removesuffix('s')}"
        for count, name in zip(complex_.f_vector, _names(complex_.dimension), strict=True)
    )
    told = f"{title}\n{counts}" if title else counts
    figure.suptitle(told, y=1 - 0.12 / high, va="top", fontsize=10, color=theme.of(INK))
    kind = path.suffix.lower()[1:]
    with written_whole(path) as stream:
        figure.savefig(stream, format=kind, metadata={"Software": None} if kind == "png" else None)


def _names(dimension: int) -> list[str]:
    return ["vertices", "edges", "squares", *(f"{k}-cubes" for k in range(3, dimension + 1))][
        : dimension + 1
    ]


def _colour_in(dimension: int) -> str:
    """Return the colour of a square whose largest cube has this dimension."""
    return _SQUARES[min(dimension - 2, len(_SQUARES) - 1)]


def _swatches(largest: NDArray[np.int64]) -> list[Artist]:
    """Return the entries of the legend: the colours of squares that occur."""
    from matplotlib.patches import Patch  # noqa: PLC0415

    said: dict[str, list[int]] = {}
    for k in np.unique(largest).tolist():
        said.setdefault(_colour_in(k), []).append(k)
    return [
        Patch(
            facecolor=colour,
            alpha=0.6,
            label="square in no 3-cube" if found == [2] else f"in a {_cubes(found)}",
        )
        for colour, found in said.items()
    ]


def _cubes(dimensions: list[int]) -> str:
    first, last = dimensions[0], dimensions[-1]
    return f"{first}-cube" if first == last else f"{first}-cube to {last}-cube"


def _draw(
    axes: Axes,
    complex_: CubicalComplex,
    view: ProjectedView,
    edges: NDArray[np.int32],
    theme: Theme,
) -> None:
    """Draw squares, edges and vertices, the far ones first and paler."""
    from matplotlib.collections import PolyCollection  # noqa: PLC0415
    from matplotlib.colors import to_rgb  # noqa: PLC0415

    places, near = view.places, view.nearness
    paper = np.array(to_rgb(theme.of(PAPER)))
    line, dot = np.array(to_rgb(theme.of(WALL))), np.array(to_rgb(theme.of(INK)))
    corners = corners_of_squares(complex_)
    hues = np.array([to_rgb(_colour_in(k)) for k in largest_cubes(complex_).tolist()])
    (left, low), (right, high) = places.min(axis=0) - _MARGIN, places.max(axis=0) + _MARGIN
    radius = _RADIUS * float(max(right - left, high - low)) / _WIDE
    ring = arcs([(0, 0)], radius / max(1, len(places) / 60) ** 0.25, corners=18)
    shapes = [*places[corners], *places[edges], *(ring + place for place in places)]
    far = 1 - np.concatenate(
        [near[corners].mean(axis=1), near[edges].mean(axis=1), near] if len(edges) else [near]
    )
    own = np.concatenate(
        [hues.reshape(-1, 3), np.tile(line, (len(edges), 1)), np.tile(dot, (len(places), 1))]
    )
    colours = own + (_PALE * far)[:, None] * (paper - own)
    opaque = np.repeat([_ALPHA, 1.0, 1.0], [len(corners), len(edges), len(places)])
    widths = np.repeat([0.0, 0.9, 0.0], [len(corners), len(edges), len(places)])
    # What is equally far is drawn in the order of the dimension, so vertices lie above edges.
    order = np.lexsort((np.arange(len(shapes)), -far.round(9)))
    drawn = np.column_stack([colours, opaque])[order]
    axes.add_collection(
        PolyCollection(
            [shapes[index] for index in order.tolist()],
            facecolors=drawn,
            edgecolors=drawn,
            linewidths=widths[order],
        )
    )
    axes.set(xlim=(left, right), ylim=(low, high))
