"""Pictures of small complexes: vertices, edges, squares and cubes, in the plane or in space.

Vertices are laid out by classical scaling of their distances in the transition graph (Torgerson,
1952), so that a cube looks like one wherever the complex allows it. matplotlib is imported when
something is drawn.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.rendering.pictures import INK
from cubepath.coordinator.complexes.cubical_complex import CubicalComplex
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.output_files import written_whole

if TYPE_CHECKING:
    from matplotlib.artist import Artist

Points = NDArray[np.float64]

_TILT = 0.3
VERTICES_MAX = 1500
"""Complexes with more vertices are not drawn, since nothing could be recognised."""
SUFFIXES = (".png", ".svg", ".pdf")
_EDGE, _VERTEX = "#6d727a", INK
_SQUARES = ("#3b7dd8", "#1f9e89", "#d6246e", "#e08a1e", "#6a4fb3")
"""The colour of a square by the dimension, 2, 3, ..., of the largest cube that it is in."""


def distances(complex_: CubicalComplex) -> NDArray[np.int32]:
    """Return the distance in edges between any two vertices, -1 if they are not connected.

    The result has shape (vertices, vertices).
    """
    count = complex_.f_vector[0]
    near: list[list[int]] = [[] for _ in range(count)]
    if complex_.dimension > 0:
        for low, high in complex_.faces[1][:, 0].tolist():
            near[low].append(high)
            near[high].append(low)
    found = np.full((count, count), -1, dtype=np.int32)
    for source in range(count):
        row = found[source]
        row[source] = 0
        layer = [source]
        while layer:
            layer = [
                other
                for vertex in layer
                for other in near[vertex]
                if row[other] < 0 and not row.__setitem__(other, row[vertex] + 1)
            ]
    return found


def layout(complex_: CubicalComplex, axes: int) -> Points:
    """Return the positions of the vertices, shape (vertices, axes), by classical scaling."""
    apart = distances(complex_).astype(np.float64)
    apart[apart < 0] = apart.max() + 2  # components side by side
    count = len(apart)
    centre = np.eye(count) - 1 / count
    # A compromise: power 1 gives the squared distances of the corners of a cube, 2 of a flat sheet.
    values, vectors = np.linalg.eigh(-centre @ apart**1.5 @ centre / 2)
    order = np.argsort(values)[::-1][: 2 * axes]
    found = vectors[:, order] * np.sqrt(np.maximum(values[order], 0))
    # The sign of an eigenvector is arbitrary: make its largest entry positive.
    for axis in range(found.shape[1]):
        if found[np.argmax(np.abs(found[:, axis]).round(9)), axis] < 0:
            found[:, axis] *= -1
    found = np.pad(found, ((0, 0), (0, 2 * axes - found.shape[1])))
    # Vertices that differ only in further directions would coincide: tilt these in a little.
    return found[:, :axes] + _TILT * found[:, axes:]


def corners_of_squares(complex_: CubicalComplex) -> NDArray[np.int32]:
    """Return the four vertices of every square in cyclic order, shape (squares, 4)."""
    if complex_.dimension < 2:
        return np.empty((0, 4), dtype=np.int32)
    edges, squares = complex_.faces[1][:, 0], complex_.faces[2]
    low, high = edges[squares[:, 0, 0]], edges[squares[:, 0, 1]]
    return np.concatenate([low, high[:, ::-1]], axis=1)


def largest_cubes(complex_: CubicalComplex) -> NDArray[np.int64]:
    """Return for each square the dimension of the largest cube that it is a face of."""
    above = np.full(complex_.f_vector[-1], complex_.dimension, dtype=np.int64)
    for k in range(complex_.dimension, 2, -1):
        below = np.full(complex_.f_vector[k - 1], k - 1, dtype=np.int64)
        np.maximum.at(below, complex_.faces[k].reshape(len(above), -1), above[:, None])
        above = below
    return above if complex_.dimension >= 2 else np.empty(0, dtype=np.int64)


def draw_complex(complex_: CubicalComplex, path: Path | str, title: str = "") -> None:
    """Draw the complex to a file: in the plane up to dimension 1, else in space.

    Squares are coloured by the dimension of the largest cube that they are in. InputError for more
    than `VERTICES_MAX` vertices, an unknown suffix, or a file that cannot be written.

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

    flat = complex_.dimension < 2
    figure = Figure(figsize=(7, 6), dpi=150, facecolor="white")
    FigureCanvasAgg(figure)
    axes: Any = figure.add_subplot(projection=None if flat else "3d")
    points = layout(complex_, 2 if flat else 3)
    edges = complex_.faces[1][:, 0] if complex_.dimension > 0 else np.empty((0, 2), np.int32)
    size = 30 / max(1, len(points) / 40) ** 0.5
    if flat:
        _draw_flat(axes, points, edges, size)
    else:
        _draw_solid(axes, complex_, points, edges, size)
    axes.set_axis_off()
    axes.set_aspect("equal")
    if not flat:
        axes.set_box_aspect(None, zoom=1.25)
        figure.legend(
            handles=_swatches(largest_cubes(complex_)),
            loc="lower center",
            ncols=5,
            frameon=False,
            fontsize=9,
            labelcolor=INK,
        )
    counts = ", ".join(
        f"{count} {name}"
        for count, name in zip(complex_.f_vector, _names(complex_.dimension), strict=True)
    )
    figure.subplots_adjust(0, 0, 1, 0.92)
    figure.suptitle(f"{title}\n{counts}" if title else counts, fontsize=10, color=INK)
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


def _draw_flat(axes: Any, points: Points, edges: NDArray[np.int32], size: float) -> None:
    from matplotlib.collections import LineCollection  # noqa: PLC0415

    axes.add_collection(LineCollection(list(points[edges]), colors=_EDGE, linewidths=0.9, zorder=1))
    axes.scatter(*points.T, s=size, color=_VERTEX, zorder=2)
    axes.margins(0.05)


def _draw_solid(
    axes: Any, complex_: CubicalComplex, points: Points, edges: NDArray[np.int32], size: float
) -> None:
    from mpl_toolkits.mplot3d.art3d import (  # noqa: PLC0415
        Line3DCollection,
        Poly3DCollection,
    )

    colours = [_colour_in(k) for k in largest_cubes(complex_).tolist()]
    squares = points[corners_of_squares(complex_)]
    axes.add_collection3d(Poly3DCollection(squares, facecolors=colours, alpha=0.35, linewidths=0))
    axes.add_collection3d(Line3DCollection(points[edges], colors=_EDGE, linewidths=0.8))
    axes.scatter(*points.T, s=size, color=_VERTEX, depthshade=False)
    axes.view_init(elev=55, azim=-80)
