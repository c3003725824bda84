"""Styles of pictures: how a scene is written as text, framed and drawn.

Solids: where modules are, and what they look like, for viewers in three dimensions.

Pure functions. Pictures lie in the plane; a solid is what stands there, with a height, and its
style says which: the same middles and ends as in a picture.

Positions in a picture, for both text and drawings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import atan2, hypot
from typing import Literal, NamedTuple, TypeAlias

from cubepath.agents.rendering.pen import Box, Colour, Mark, Pen, Points, Shot, Spot, palette
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System


@dataclass(frozen=True, slots=True)
class Solid:
    """A solid: a box, or a disc, which is a box with a round outline; lengths are in cells.

    `angle` is in radians about the upward axis, from the first axis to the second; `size` are the
    lengths before that turn. `word` is written on it, if it is not its number.
    """

    middle: tuple[float, float, float]
    size: tuple[float, float, float]
    angle: float = 0.0
    is_round: bool = False
    word: str | None = None


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
    """Return where the system says that a place lies; None if it does not say.

    Raises InputError if that is no point of the plane.
    """
    position = system.positions.get(place)
    if position is not None and len(position) != 2:
        raise InputError(f"position {position} of {place!r} cannot be drawn, expected two numbers")
    return position


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


class Pivot(NamedTuple):
    """How a module turns: about a point, by an angle in radians, counter-clockwise."""

    about: Spot
    turn: float


@dataclass(frozen=True, slots=True)
class MovingPart:
    """The parts of a style from which pictures that move are drawn.

    `behind` draws what lies below the modules and never changes, `before` what lies above them.
    `body` says how a module looks at a site. `outline` is that of every cell, shape (corners, 2);
    bars are `thick`, in cells, with or without `joints` at their ends. `pivot` returns how a module
    turns that an action takes from one site to another, None if it goes straight.
    """

    behind: Layer
    before: Layer
    body: Callable[[Scene, Site], Body]
    outline: Points | None = None
    thick: float = 0.0
    joints: bool = False
    pivot: Callable[[Action, Site, Site], Pivot | None] = lambda *_: None


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
