"""Drawing tools: the colours of modules, and a pen for shapes, lines and words on a canvas.

A canvas is what the pen draws on: matplotlib's axes (`pictures`), or a list of what was drawn
(`backdrop`).

The colours of pictures but for those of modules, and what stands for them on dark ground.

The meaning of marks in a picture, for its legend: outlines, traces, rings, bands, obstacles.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import cos, pi, sin
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.sites import Site

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


Points: TypeAlias = NDArray[np.float64]
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
    red, green, blue = _parts_of(_HUES[hue])
    kept, added = ((1.0, 0.0), (0.6, 0.4), (0.62, 0.0))[shade]
    return kept * red + added, kept * green + added, kept * blue + added


def _parts_of(colour: str) -> Colour:
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
    """Draws on a canvas; `scale` is the width of a cell in the unit of its line widths."""

    canvas: Canvas
    box: Box
    scale: float
    theme: Theme

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
        return palette(count) if one is None else [_parts_of(one)] * count

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
