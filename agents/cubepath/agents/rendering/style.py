"""What a style of pictures is: how a scene of it is written as text, framed and drawn.

Room: agents; static, asks nobody.
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
    """A style: `text` and `draw` are given the sites of the modules by number.

    `frame` says what a picture shows at least, of the scene and of some further sites; `extent`
    what pictures of a run show in which modules came to these sites. `draw` is
    told of modules that have just moved from which site, and whether to write words: None where
    that is for the room to decide. `marks` says which marks occur in pictures of some states, drawn
    in a frame, and what they mean. `colours` has the colour of each module at its site: by its
    number, where nothing else is said.
    """

    text: Text
    frame: Frame
    extent: Frame
    draw: Draw
    marks: Marks
    colours: Colours = lambda _, sites: palette(len(sites))


def readable(pen: Pen, words: bool | None) -> bool:  # noqa: FBT001 - as `Style.draw` has it
    """Tell whether to write words: as asked for, or else where there is room to read them."""
    return pen.scale >= _ROOM if words is None else words
