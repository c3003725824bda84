"""Pictures of the modules by style: text, pixels, drawings on matplotlib's axes, data for a page.

matplotlib is imported only when something is drawn, and used only through its objects: no pyplot,
so no window and no global state. For moving pictures the styles draw into a list instead of on
axes. There, lengths and line widths are in cells, with y upwards.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from math import ceil
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.rendering import cells, chords, edges, letters, places, solids, style
from cubepath.agents.rendering.ways import Way, along, straight
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.path import Path

STYLES: Mapping[str, style.Style] = {
    "hexagons": cells.HEXAGONS,
    "squares": cells.SQUARES,
    "map": cells.MAP,
    "edges": edges.EDGES,
    "graph": places.GRAPH,
    "chords": chords.CHORDS,
    "letters": letters.LETTERS,
    **solids.SOLIDS,
}


def style_of(scene: Scene) -> style.Style:
    """Return the style in which a scene is drawn: that of a graph if its own style cannot draw it.

    So it is if there is no style of this name, or a module starts where that style has no place.
    """
    found = STYLES.get(scene.system.drawing, places.UNKNOWN)
    try:
        for site in scene.start[:1]:  # one stands for all, which are alike
            found.solid(scene.system, site)
    except InputError:
        return places.UNKNOWN
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

    marks: tuple[style.Mark, ...]
    columns: int
    theme: style.Theme = style.LIGHT

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
            labelcolor=self.theme.of(style.INK),
            handlelength=1.5,
            borderpad=0,
            borderaxespad=0,
            labelspacing=0.35,
        )


def legend_of(
    scene: Scene,
    shots: Sequence[style.Shot],
    box: style.Box,
    wide: float,
    theme: style.Theme = style.LIGHT,
) -> Legend:
    """Return the legend for pictures of these states in this frame, for a width of `wide` inches.

    It explains the outlines, traces, rings, bands and dark places that occur.
    """
    marks = tuple(style_of(scene).marks(scene, shots, box))
    longest = max((len(mark.meaning) for mark in marks), default=0)
    columns = max(1, int(wide / (_SWATCH + _LETTER * longest)))
    return Legend(marks, min(columns, len(marks) or 1), theme)


def _swatch(mark: style.Mark, theme: style.Theme) -> Artist:
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


_ROLES = {
    style.PAPER: "paper",
    style.INK: "ink",
    style.GOAL: "goal",
    style.WALL: "wall",
    style.PALE_GOAL: "goal-pale",
    style.LINE: "line",
    style.TILE: "tile",
    style.GHOST: "ghost",
}
"""Colours with a meaning, by name, which a page may show otherwise on a dark background."""
_WIDE = 1.5
"""How wide the frame of an endless lattice is to its height."""


@dataclass(slots=True)
class DrawnShapes:
    """What was drawn on a list.

    Each of `ops` is a fill, lines or words, in order:

    - ``{"op": "fill", "outline": number in outlines, "at": [x, y, ...], "face", "edge", "width",
      "alpha"}``: the same outline around many points;
    - ``{"op": "lines", "ends": [x, y, x, y, ...], "edge", "width", "round"}``;
    - ``{"op": "word", "at": [x, y], "word", "face", "size"}``.

    A colour is ``#rrggbb``, the name of a role such as "wall", or "none".
    """

    ops: list[dict[str, Any]] = field(default_factory=list)
    outlines: list[list[float]] = field(default_factory=list)


class _ListCanvas:
    """A canvas that keeps what is drawn on it."""

    limits_lines = False

    def __init__(self) -> None:
        self.drawn = DrawnShapes()
        self._numbers: dict[bytes, int] = {}

    def shapes(self, shapes: Sequence[style.Points], **paint: Any) -> None:
        count = len(shapes)
        faces = _colours(paint.get("facecolors", "none"), count)
        edges = _colours(paint.get("edgecolors", "none"), count)
        width = round(float(np.max(paint.get("linewidths", 0))), 4)
        alpha = float(paint.get("alpha", 1))
        groups: dict[tuple[int, str, str], dict[str, Any]] = {}
        for shape, face, edge in zip(shapes, faces, edges, strict=True):
            middle = (shape.min(axis=0) + shape.max(axis=0)) / 2
            key = self._outline(shape - middle), face, edge
            group = groups.get(key)
            if group is None:
                group = groups[key] = {"op": "fill", "outline": key[0], "at": [], "face": face}
                group |= {"edge": edge, "width": width, "alpha": alpha}
                self.drawn.ops.append(group)
            group["at"] += _rounded(middle)

    def strokes(self, lines: Sequence[style.Points], **paint: Any) -> None:
        ends = [part for line in lines for part in _rounded(line[[0, -1]])]
        (edge,) = _colours(paint["colors"], 1)
        width = round(float(paint["linewidths"]), 4)
        end = paint.get("capstyle") == "round"
        found = {"op": "lines", "ends": ends, "edge": edge, "width": width, "round": end}
        self.drawn.ops.append(found)

    def write(self, at: style.Spot, word: str, colour: str, size: float) -> None:
        face = _ROLES.get(colour, colour)
        found = {"op": "word", "at": _rounded(np.array(at)), "word": word, "face": face}
        self.drawn.ops.append(found | {"size": size})

    def _outline(self, shape: style.Points) -> int:
        points = _rounded(shape)
        key = np.array(points).tobytes()
        found = self._numbers.get(key)
        if found is None:
            found = self._numbers[key] = len(self.drawn.outlines)
            self.drawn.outlines.append(points)
        return found


def _rounded(points: style.Points) -> list[float]:
    # Adding 0 turns -0.0 into 0.0, so that equal outlines have equal bytes.
    return (np.round(points, 4) + 0.0).ravel().tolist()


def _colours(given: str | Sequence[style.Colour | str], count: int) -> list[str]:
    if isinstance(given, str):
        return [_ROLES.get(given, given)] * count
    named = [each if isinstance(each, str) else colour_text(each) for each in given]
    named = [_ROLES.get(each, each) for each in named]
    return named * count if len(named) == 1 else named


def colour_text(colour: style.Colour) -> str:
    """Return a colour as ``#rrggbb``.

    >>> colour_text((1.0, 0.5, 0.0))
    '#ff8000'
    """
    return "#" + "".join(f"{round(255 * part):02x}" for part in colour)


class Backdrop(NamedTuple):
    """All of a picture that moves but the modules, and how these look at their sites.

    `behind` and `before` the modules lies what never changes, in the frame `box`. `outline` is that
    of a module that is a cell or a box: x, y, x, y, ... around 0, 0.
    """

    box: style.Box
    behind: DrawnShapes
    before: DrawnShapes
    outline: list[float]
    moving: style.MovingPart


def still(scene: Scene, visited: Iterable[Site] = ()) -> Backdrop:
    """Return what a picture that moves is made of, in a frame that holds the visited sites.

    InputError as for pictures: where a system has no style, or a place cannot be drawn.

    >>> scene = scene_from_spec("hex:n=3")
    >>> found = still(scene)
    >>> found.moving.body(scene, (1, 0)).at, len(found.outline)
    ((1.0, 0.0), 12)
    """
    drawn = style_of(scene)
    box = drawn.extent(scene, visited)
    if not scene.system.bounded:  # an endless lattice continues beyond what modules visit
        box = _widened(box)
    moving = drawn.moving
    behind, before = (_drawn(layer, scene, box) for layer in (moving.behind, moving.before))
    outline = [] if moving.outline is None else _rounded(moving.outline)
    return Backdrop(box, behind, before, outline, moving)


def _drawn(layer: style.Layer, scene: Scene, box: style.Box) -> DrawnShapes:
    canvas = _ListCanvas()
    layer(style.Pen(canvas, box, 1.0, style.LIGHT), scene)
    return canvas.drawn


def _widened(box: style.Box) -> style.Box:
    left, right, low, high = box
    wide = max(right - left, _WIDE * (high - low)) / 2
    tall = wide / _WIDE
    x, y = (left + right) / 2, (low + high) / 2
    return x - wide, x + wide, y - tall, y + tall


@dataclass(slots=True)
class AxesCanvas:
    """Draws on axes. Everything has the same zorder, so later drawings lie above earlier ones."""

    axes: Axes
    limits_lines: bool = True

    def shapes(self, shapes: Sequence[style.Points], **paint: Any) -> None:
        """Draw polygons."""
        from matplotlib.collections import PolyCollection  # noqa: PLC0415

        self.axes.add_collection(PolyCollection(shapes, zorder=1, **paint), autolim=False)

    def strokes(self, lines: Sequence[style.Points], **paint: Any) -> None:
        """Draw lines between points."""
        from matplotlib.collections import LineCollection  # noqa: PLC0415

        self.axes.add_collection(LineCollection(lines, zorder=1, **paint), autolim=False)

    def write(self, at: style.Spot, word: str, colour: str, size: float) -> None:
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

    left, right, low, high = style_of(scene).frame(scene, ())
    width = 2 * round(height * min(max((right - left) / (high - low), 0.5), 3.0) / 2)
    figure = Figure(figsize=(width / 100, height / 100), dpi=100, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    draw_on(figure.add_axes((0, 0, 1, 1)), scene, sites)
    canvas.draw()  # type: ignore[no-untyped-call]  # untyped in matplotlib
    pixels = canvas.buffer_rgba()  # type: ignore[no-untyped-call]  # as above
    return np.array(pixels, dtype=np.uint8)[:, :, :3].copy()


def extent(scene: Scene, visited: Iterable[Site]) -> style.Box:
    """Return the frame for pictures of a run, in cells: start, goal, and all visited sites.

    The rest of a much larger workspace is left out.
    """
    return style_of(scene).extent(scene, visited)


def colours(scene: Scene, sites: Sequence[Site]) -> Sequence[style.Colour]:
    """Return the colour of each module in a picture when it is at its site."""
    return style_of(scene).colours(scene.system, sites)


def solid_of(scene: Scene, site: Site) -> style.Solid | None:
    """Return what stands at a site in three dimensions; None where a picture shows nothing.

    Its middle is where pictures draw the module. InputError if the site cannot be drawn.

    >>> solid_of(scene_from_spec("agv:graph=grid3x2,n=2"), (2, 1)).middle
    (2.0, -1.0, 0.0)
    """
    return style_of(scene).solid(scene.system, site)


def way_of(scene: Scene, action: Action, source: Site, target: Site) -> Way:
    """Return how a module moves that an action takes from one site to another.

    It is empty if pictures do not show it on its way.

    >>> scene = scene_from_spec("hex:n=3")
    >>> move = next(each for each in scene.system.moves((0, 0)) if each is not None)
    >>> [round(leg.turn, 3) for leg in way_of(scene, move.action, *move.motion[0])]
    [2.094]
    """
    drawn, place_of = style_of(scene), scene.system.place_of
    if drawn.moving.way is None:
        return ()
    bodies = (drawn.solid(scene.system, site) for site in (source, target))
    one, other = (np.array(body.middle) for body in bodies if body is not None)
    bent = drawn.moving.way(action, place_of(source), place_of(target))
    return bent or (straight(other - one),)


def draw_on(
    axes: Axes,
    scene: Scene,
    sites: Sequence[Site],
    *,
    moved: Mapping[int, Site] | None = None,
    box: style.Box | None = None,
    numbers: bool | None = None,
    theme: style.Theme = style.LIGHT,
    by: Mapping[int, Action] | None = None,
    part: float = 1.0,
) -> None:
    """Draw modules at `sites`, by number, on matplotlib's `axes`, whose position must be final.

    Modules are coloured by number (`palette`). Cells of the goal have a red outline, or in labelled
    systems the colour of the module that must come there; edges of the goal lie on a pink band.
    Marked vertices are dark discs, with a ring if the mark has just appeared or disappeared.
    `moved` gives the previous sites of the modules that have just moved: they get a dark outline
    and leave a pale trace. The frame is `box`, or holds start, goal and finite workspaces.
    `numbers` decides whether to write each module's label, or its number, on it; None means if
    there is room to read it. `theme` has the colours of the ground and of marks.

    With the actions `by` which modules moved, those are drawn after a `part` of their ways, 0 to 1.
    """
    drawn = style_of(scene)
    pen = _pen(axes, scene, box or drawn.frame(scene, sites), theme)
    if moved and by and part < 1:
        ways = {n: way_of(scene, by[n], source, sites[n]) for n, source in moved.items()}
        pen = replace(pen, poses={n: partial(along, way, part) for n, way in ways.items() if way})
    drawn.draw(pen, scene, sites, moved or {}, numbers)


def _pen(axes: Axes, scene: Scene, box: style.Box, theme: style.Theme) -> style.Pen:
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
    return style.Pen(AxesCanvas(axes), (left, right, low, high), scale, theme)
