"""Styles of pictures: how a scene becomes text, a frame and a drawing, and with which tools.

Pictures lie in the plane; a solid has a height too, for viewers in three dimensions. A pen draws on
a canvas: matplotlib's axes, or a list of what was drawn (`pictures`). Colours are those for white
paper; a theme replaces them on a dark ground.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import atan2, cos, hypot, pi, sin
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np

from cubepath.agents.rendering import projection
from cubepath.agents.rendering.ways import Way, along
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System

INK, GOAL, WALL = "#22252a", "#d6246e", "#5a5e65"
PALE_GOAL, LINE, TILE = "#f7c9dc", "#cdd0d4", "#f0f1f3"
GHOST = "#d3d3d4"
"""The trace in a legend, which belongs to no particular module."""
PAPER = "white"
"""The ground of a picture, and what is as pale as it."""


@dataclass(frozen=True, slots=True)
class Theme:
    """How a picture looks on its ground: other colours in place of those for white paper."""

    name: str
    instead: Mapping[str, str]
    rim: str
    """The thin outline of every module."""
    modules: str | None = None
    """``#rrggbb`` for all modules, which have no numbers then; None if each has its own."""

    def of(self, colour: str) -> str:
        """Return the colour that stands for one of those for white paper; others stay."""
        return self.instead.get(colour, colour)

    def style(self, style: Mapping[str, Any]) -> dict[str, Any]:
        """Return the keywords of a drawing with colours of this theme in place of names."""
        return {
            key: self.of(value) if isinstance(value, str) else value for key, value in style.items()
        }


LIGHT = Theme("light", {}, PAPER)
DARK = Theme(
    "dark",
    {
        PAPER: "#1c1f24",
        INK: "#e8eaed",
        GOAL: "#ff6fa8",
        WALL: "#8d939c",
        PALE_GOAL: "#6b2a4c",
        LINE: "#4a4f57",
        TILE: "#292d33",
        GHOST: "#555a62",
    },
    "#b4b9c0",
)


Shot: TypeAlias = tuple[Sequence[Site], Mapping[int, Site]]
"""A state in a picture: the site of each module, and the previous site of each that just moved."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A mark and its meaning: a box, or a disc where `is_round`, of these colours."""

    meaning: str
    face: str = "none"
    edge: str = "none"
    is_round: bool = False


def moves_marks(shots: Iterable[Shot], *, is_round: bool = False) -> Iterator[Mark]:
    """Yield the marks of modules that have just moved: a dark outline, and a pale trace."""
    if any(moved for _, moved in shots):
        yield Mark("has just moved", edge=INK, is_round=is_round)
        yield Mark("where it was before", face=GHOST, is_round=is_round)


Points: TypeAlias = projection.Points
Spot: TypeAlias = tuple[float, float]
Colour: TypeAlias = tuple[float, float, float]
Box: TypeAlias = tuple[float, float, float, float]
"""Left, right, low, high."""

_HUES = (
    *("#332288", "#ee7733", "#44aa99", "#ddcc77", "#0077bb"),
    *("#117733", "#88ccee", "#999933", "#aa4499"),
)
"""Distinguishable for the colour-blind, and distinct from goals and obstacles (Tol, "muted" and
"vibrant")."""


_ON_PALE, _ON_DARK = f"{INK}ff", "#ffffffff"
"""Of words on a colour. They are no roles of a theme: the colour is the same on dark ground."""


def palette(count: int) -> list[Colour]:
    """Return a colour for each module by number, independent of how many there are.

    The nine hues are followed by lighter and then darker ones; they repeat after 27.
    """
    return [_colour(number % len(_HUES), number // len(_HUES) % 3) for number in range(count)]


@lru_cache
def _colour(hue: int, shade: int) -> Colour:
    """Return a hue, unmixed, mixed with white or mixed with black."""
    red, green, blue = parts_of(_HUES[hue])
    kept, added = ((1.0, 0.0), (0.6, 0.4), (0.62, 0.0))[shade]
    return kept * red + added, kept * green + added, kept * blue + added


def parts_of(colour: str) -> Colour:
    """Return a colour ``#rrggbb`` in parts from 0 to 1."""
    red, green, blue = (part / 255 for part in bytes.fromhex(colour[1:]))
    return red, green, blue


class Canvas(Protocol):
    """What a pen draws on. Later drawings lie above earlier ones."""

    limits_lines: bool
    """Whether lines keep within a range of widths that can be seen, however small a cell is."""

    def shapes(self, shapes: Sequence[Points], **style: Any) -> None:
        """Draw polygons, in the style of a PolyCollection."""

    def strokes(self, lines: Sequence[Points], **style: Any) -> None:
        """Draw lines, in the style of a LineCollection."""

    def write(self, at: Spot, word: str, colour: str, size: float) -> None:
        """Write a word that fits in a cell of this size."""


@dataclass(frozen=True, slots=True)
class Pen:
    """Draws on a canvas; `scale` is the width of a cell in the unit of its line widths.

    `poses` takes points of a module on its way, shape (n, 3), from where it was to where it is.
    """

    canvas: Canvas
    box: Box
    scale: float
    theme: Theme
    poses: Mapping[int, Callable[[Points], Points]] = field(default_factory=dict, kw_only=True)

    def line(self, part: float, least: float = 0.4, most: float = 2.4) -> float:
        """Return a line width that is this part of a cell, within limits where there are any."""
        width = part * self.scale
        return min(max(width, least), most) if self.canvas.limits_lines else width

    def shapes(self, shapes: Sequence[Points], **style: Any) -> None:
        """Draw polygons."""
        if len(shapes):
            self.canvas.shapes(shapes, **self.theme.style(style))

    def strokes(self, lines: Sequence[Points], **style: Any) -> None:
        """Draw lines between points."""
        if len(lines):
            self.canvas.strokes(lines, **self.theme.style(style))

    def palette(self, count: int) -> list[Colour]:
        """Return a colour for each module by number."""
        one = self.theme.modules
        return palette(count) if one is None else [parts_of(one)] * count

    def discs(self, points: Iterable[Spot], radius: float, **style: Any) -> None:
        """Draw discs with a dark outline around these points, such as the joints of an arm."""
        rings = [arcs([(0, 0)], radius) + point for point in dict.fromkeys(points)]
        self.shapes(rings, edgecolors=INK, linewidths=0.05 * self.scale, **style)

    def write(self, at: Spot, word: str, on: Colour | None, *, size: float = 1) -> None:
        """Write a word on a cell of this colour, as a shape that scales with the cell.

        With None it is written on the ground of the picture.
        """
        if on is None:
            colour = self.theme.of(INK)
        else:
            colour = _ON_PALE if 0.3 * on[0] + 0.59 * on[1] + 0.11 * on[2] > 0.5 else _ON_DARK
        self.canvas.write(at, word, colour, size)


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


@dataclass(frozen=True, slots=True)
class Solid:
    """A solid: a box, or a disc, which is a box with a round outline; lengths are in cells.

    `angle` is in radians about `axis`, which points upwards unless a module rolls in space; `size`
    are the lengths before that turn. `word` is written on it, if it is not its number.
    """

    middle: tuple[float, float, float]
    size: tuple[float, float, float]
    angle: float = 0.0
    is_round: bool = False
    word: str | None = None
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """Return its turn as x, y, z and w."""
        x, y, z = (part * sin(self.angle / 2) for part in self.axis)
        return x, y, z, cos(self.angle / 2)

    def on_its_way(self, way: Way, part: float) -> Solid:
        """Return the solid after a part of its way, 0 to 1."""
        x, y, z = along(way, part, np.array(self.middle)).tolist()
        angle = self.angle + part * sum(leg.turn for leg in way)
        axis = next((leg.axis for leg in way if leg.turn), self.axis)
        return replace(self, middle=(x, y, z), angle=angle, axis=axis)


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


MODULE_MARK, ARRIVED_MARK, GOAL_MARK = "o", "@", "+"
"""The text of an unlabelled module, off and on a goal cell, and of a goal cell without one."""


def cell_of(place: Site) -> tuple[int, int]:
    """Return a place as a cell of a lattice in the plane; InputError if it is something else."""
    match place:
        case (int(x), int(y)):
            return x, y
        case _:
            raise InputError(f"{place!r} cannot be drawn as a cell, expected two whole numbers")


def spot_of(system: System, place: Site) -> Spot | None:
    """Return where the system says that a place lies in a picture; None if it does not say.

    Raises InputError if that is no point of the plane or of space.
    """
    position = system.positions.get(place)
    if position is not None and len(position) not in (2, 3):
        raise InputError(f"position {position} of {place!r}: expected two or three numbers")
    return None if position is None else flat(position)


def flat(point: Sequence[float]) -> Spot:
    """Return a point of the plane as it is, and one of space as pictures project it."""
    x, y = point if len(point) == 2 else projection.project(np.array(point))[:2].tolist()
    return x, y


def known_places(scene: Scene) -> list[Site]:
    """Return the places that a frame holds wherever the modules are."""
    system = scene.system
    places = [system.place_of(site) for site in (*scene.start, *(scene.goal or ()))]
    return [*places, *system.places]


def tips_of(edge: Site) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the two vertices of a lattice edge; for a vertex as a place, that vertex twice.

    Raises InputError if it is no edge in the plane.
    """
    match edge:
        case (int(x), int(y)):
            return (x, y), (x, y)
        case (int(x), int(y), (0 | 1) as axis):
            return (x, y), (x + (axis == 0), y + (axis == 1))
        case _:
            raise InputError(
                f"{edge!r} cannot be drawn as an edge, expected two whole numbers and 0 or 1"
            )


def marks_of(scene: Scene, sites: Sequence[Site]) -> dict[Site, str]:
    """Return the text mark of each place that has a module or belongs to the goal."""
    system, goal = scene.system, scene.goal or frozenset()
    marks = {system.place_of(site): GOAL_MARK for site in goal}
    for site in sites:
        label, arrived = system.label_of(site), site in goal
        if label is None:
            mark = ARRIVED_MARK if arrived else MODULE_MARK
        else:
            mark = f"{label}*" if arrived else str(label)
        marks[system.place_of(site)] = mark
    return marks


Text: TypeAlias = Callable[[Scene, Sequence[Site]], str]
Frame: TypeAlias = Callable[[Scene, Iterable[Site]], Box]
Draw: TypeAlias = Callable[[Pen, Scene, Sequence[Site], Mapping[int, Site], "bool | None"], None]
Colours: TypeAlias = Callable[[System, Sequence[Site]], Sequence[Colour]]
Solids: TypeAlias = Callable[[System, Site], "Solid | None"]
Marks: TypeAlias = Callable[[Scene, Sequence[Shot], Box], Iterable[Mark]]

Layer: TypeAlias = Callable[[Pen, Scene], None]

_ROOM = 10.5
"""Points per cell from which a number on a module can be read."""


@dataclass(frozen=True, slots=True)
class Body:
    """How one module looks at a site, for pictures that move.

    A "cell" has the outline of its style around `at`, a "bar" goes from `at` to `to`, a "box" holds
    the word, a "dot" marks a point, and "none" is not seen. `colour` and `word` are None where the
    number of the module, or its label, says them.
    """

    shape: Literal["cell", "bar", "box", "dot", "none"]
    at: Spot
    to: Spot
    colour: Colour | None = None
    word: str | None = None


@dataclass(frozen=True, slots=True)
class MovingPart:
    """The parts of a style from which pictures that move are drawn.

    `behind` draws what lies below the modules and never changes, `before` what lies above them.
    `body` says how a module looks at a site. `outline` is that of every cell, shape (corners, 2);
    bars are `thick`, in cells, with or without `joints` at their ends. `way` returns how a module
    moves that an action takes from one place to another, () for straight; without it no picture
    shows a module between two places.
    """

    body: Callable[[Scene, Site], Body]
    behind: Layer = lambda *_: None
    before: Layer = lambda *_: None
    outline: Points | None = None
    thick: float = 0.0
    joints: bool = False
    way: Callable[[Action, Site, Site], Way] | None = None


@dataclass(frozen=True, slots=True)
class Style:
    """A style of pictures; `text` and `draw` take the sites of the modules by number.

    `frame` returns the least frame of a picture, for the scene and some further sites; `extent` the
    frame for pictures of a run in which modules visited these sites. `draw` also takes the previous
    sites of the modules that have just moved, and whether to write words: None means if there is
    room. `marks` returns the marks that occur in pictures of some states, drawn in a frame, with
    their meanings. `colours` returns the colour of each module at its site, by default from its
    number. `moving` is for pictures that move. `solid` returns what stands at the site of a module
    in three dimensions, None where nothing does.
    """

    text: Text
    frame: Frame
    extent: Frame
    draw: Draw
    marks: Marks
    moving: MovingPart
    solid: Solids
    colours: Colours = lambda _, sites: palette(len(sites))


def readable(pen: Pen, words: bool | None) -> bool:  # noqa: FBT001 - as `Style.draw` has it
    """Return whether to write words: as requested, or by default if there is room to read them."""
    return pen.scale >= _ROOM if words is None else words


def frame_around(spots: Iterable[Spot], margin: float) -> Box:
    """Return left, right, low and high of points, with a margin."""
    known = np.array(list(spots))
    (left, low), (right, high) = known.min(axis=0) - margin, known.max(axis=0) + margin
    return float(left), float(right), float(low), float(high)
