"""Styles of pictures: how a scene is written as text, framed and drawn.

Room: agents. Pure functions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from cubepath.agents.rendering.marks import Mark, Shot
from cubepath.agents.rendering.pen import Box, Colour, Pen, palette
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System

Text: TypeAlias = Callable[[Scene, Sequence[Site]], str]
Frame: TypeAlias = Callable[[Scene, Iterable[Site]], Box]
Draw: TypeAlias = Callable[[Pen, Scene, Sequence[Site], Mapping[int, Site], "bool | None"], None]
Colours: TypeAlias = Callable[[System, Sequence[Site]], Sequence[Colour]]
Marks: TypeAlias = Callable[[Scene, Sequence[Shot], Box], Iterable[Mark]]

_ROOM = 10.5
"""Points per cell from which a number on a module can be read."""


@dataclass(frozen=True, slots=True)
class Style:
    """A style of pictures; `text` and `draw` take the sites of the modules by number.

    `frame` returns the least frame of a picture, for the scene and some further sites; `extent` the
    frame for pictures of a run in which modules visited these sites. `draw` also takes the previous
    sites of the modules that have just moved, and whether to write words: None means if there is
    room. `marks` returns the marks that occur in pictures of some states, drawn in a frame, with
    their meanings. `colours` returns the colour of each module at its site, by default from its
    number.
    """

    text: Text
    frame: Frame
    extent: Frame
    draw: Draw
    marks: Marks
    colours: Colours = lambda _, sites: palette(len(sites))


def readable(pen: Pen, words: bool | None) -> bool:  # noqa: FBT001 - as `Style.draw` has it
    """Return whether to write words: as requested, or by default if there is room to read them."""
    return pen.scale >= _ROOM if words is None else words
