"""Pictures of the modules: pixels, and drawings on matplotlib's axes.

It only draws what it is given. matplotlib is imported only when something is drawn, and only
through its objects: no pyplot, so no window and no global state.

A canvas to draw on: matplotlib's axes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.rendering.pen import LIGHT, Box, Colour, Pen, Points, Spot, Theme
from cubepath.agents.rendering.style import Solid
from cubepath.agents.rendering.styles import style_of
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene

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


def draw_pixels(scene: Scene, sites: Sequence[Site], *, height: int = 360) -> NDArray[np.uint8]:
    """Return a picture as pixels, uint8, shape (height, width, 3).

    The width is even and depends only on the scene, so all frames of a film have the same size. If
    modules leave the frame of start and goal, the picture shows more, at a smaller scale.

    >>> scene = scene_from_spec("hex:n=5")
    >>> draw_pixels(scene, scene.start, height=120).shape
    (120, 166, 3)
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    left, right, low, high = frame(scene)
    width = 2 * round(height * min(max((right - left) / (high - low), 0.5), 3.0) / 2)
    figure = Figure(figsize=(width / 100, height / 100), dpi=100, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    draw_on(figure.add_axes((0, 0, 1, 1)), scene, sites)
    canvas.draw()  # type: ignore[no-untyped-call]  # untyped in matplotlib
    pixels = canvas.buffer_rgba()  # type: ignore[no-untyped-call]  # as above
    return np.array(pixels, dtype=np.uint8)[:, :, :3].copy()


def frame(scene: Scene, also: Iterable[Site] = ()) -> Box:
    """Return the least frame of a picture, in cells: the scene, and the sites in `also`.

    On an endless lattice there is room for one more module on every side of the scene, so modules
    that walk along its edge do not change the frame.
    """
    return style_of(scene).frame(scene, also)


def extent(scene: Scene, visited: Iterable[Site]) -> Box:
    """Return the frame for pictures of a run, in cells: start, goal, and all visited sites.

    The rest of a much larger workspace is left out.
    """
    return style_of(scene).extent(scene, visited)


def colours(scene: Scene, sites: Sequence[Site]) -> Sequence[Colour]:
    """Return the colour of each module in a picture when it is at its site."""
    return style_of(scene).colours(scene.system, sites)


def solid_of(scene: Scene, site: Site) -> Solid | None:
    """Return what stands at a site in three dimensions; None where a picture shows nothing.

    Its middle is where pictures draw the module. InputError if the site cannot be drawn.

    >>> solid_of(scene_from_spec("agv:graph=grid3x2,n=2"), (2, 1)).middle
    (2.0, -1.0, 0.0)
    """
    return style_of(scene).solid(scene.system, site)


def draw_on(
    axes: Axes,
    scene: Scene,
    sites: Sequence[Site],
    *,
    moved: Mapping[int, Site] | None = None,
    box: Box | None = None,
    numbers: bool | None = None,
    theme: Theme = LIGHT,
) -> None:
    """Draw modules at `sites`, by number, on matplotlib's `axes`, whose position must be final.

    Modules are coloured by number (`palette`). Cells of the goal have a red outline, or in labelled
    systems the colour of the module that must come there; edges of the goal lie on a pink band.
    Marked vertices are dark discs, with a ring if the mark has just appeared or disappeared.
    `moved` gives the previous sites of the modules that have just moved: they get a dark outline
    and leave a pale trace. The frame is `box`, or holds start, goal and finite workspaces.
    `numbers` decides whether to write each module's label, or its number, on it; None means if
    there is room to read it. `theme` has the colours of the ground and of marks.
    """
    pen = _pen(axes, scene, frame(scene, sites) if box is None else box, theme)
    style_of(scene).draw(pen, scene, sites, moved or {}, numbers)


def _pen(axes: Axes, scene: Scene, box: Box, theme: Theme) -> Pen:
    """Set up the axes to show this frame, which an endless lattice fills entirely."""
    left, right, low, high = box
    seen = axes.get_window_extent()
    if not scene.system.bounded:
        wide = max(right - left, (high - low) * seen.width / seen.height)
        tall = wide * seen.height / seen.width
        left, right = (left + right - wide) / 2, (left + right + wide) / 2
        low, high = (low + high - tall) / 2, (low + high + tall) / 2
    axes.set(xlim=(left, right), ylim=(low, high), aspect="equal")
    axes.set_axis_off()
    pixels = min(seen.width / (right - left), seen.height / (high - low))
    scale = pixels * 72 / axes.figure.dpi
    return Pen(AxesCanvas(axes), (left, right, low, high), scale, theme)
