"""Styles of pictures: how a scene is written as text, framed and drawn.

Pure functions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

from cubepath.agents.rendering.marks import Mark, Shot
from cubepath.agents.rendering.pen import Box, Colour, Pen, Points, Spot, palette
from cubepath.agents.rendering.solids import Solid
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System

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
class Moving:
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
    moving: Moving
    solid: Solids
    colours: Colours = lambda _, sites: palette(len(sites))


def readable(pen: Pen, words: bool | None) -> bool:  # noqa: FBT001 - as `Style.draw` has it
    """Return whether to write words: as requested, or by default if there is room to read them."""
    return pen.scale >= _ROOM if words is None else words
