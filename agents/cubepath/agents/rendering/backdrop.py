"""What a picture that moves is made of, as plain data: what stays, and how modules look at sites.

The styles draw on a list instead of on axes, so every system that has a style has this too. Lengths
are in cells, y upwards; line widths as well.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cubepath.agents.rendering.pen import (
    GHOST,
    GOAL,
    INK,
    LIGHT,
    LINE,
    PALE_GOAL,
    PAPER,
    TILE,
    WALL,
    Box,
    Colour,
    Pen,
    Points,
    Spot,
)
from cubepath.agents.rendering.style import Body, Layer, MovingPart, Pivot
from cubepath.agents.rendering.styles import style_of
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene

_ROLES = {
    PAPER: "paper",
    INK: "ink",
    GOAL: "goal",
    WALL: "wall",
    PALE_GOAL: "goal-pale",
    LINE: "line",
    TILE: "tile",
    GHOST: "ghost",
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

    def shapes(self, shapes: Sequence[Points], **style: Any) -> None:
        count = len(shapes)
        faces = _colours(style.get("facecolors", "none"), count)
        edges = _colours(style.get("edgecolors", "none"), count)
        width = round(float(style.get("linewidths", 0)), 4)
        alpha = float(style.get("alpha", 1))
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

    def strokes(self, lines: Sequence[Points], **style: Any) -> None:
        ends = [part for line in lines for part in _rounded(line[[0, -1]])]
        (edge,) = _colours(style["colors"], 1)
        width = round(float(style["linewidths"]), 4)
        end = style.get("capstyle") == "round"
        found = {"op": "lines", "ends": ends, "edge": edge, "width": width, "round": end}
        self.drawn.ops.append(found)

    def write(self, at: Spot, word: str, colour: str, size: float) -> None:
        face = _ROLES.get(colour, colour)
        found = {"op": "word", "at": _rounded(np.array(at)), "word": word, "face": face}
        self.drawn.ops.append(found | {"size": size})

    def _outline(self, shape: Points) -> int:
        points = _rounded(shape)
        key = np.array(points).tobytes()
        found = self._numbers.get(key)
        if found is None:
            found = self._numbers[key] = len(self.drawn.outlines)
            self.drawn.outlines.append(points)
        return found


def _rounded(points: Points) -> list[float]:
    # Adding 0 turns -0.0 into 0.0, so that equal outlines have equal bytes.
    return (np.round(points, 4) + 0.0).ravel().tolist()


def _colours(given: str | Sequence[Colour | str], count: int) -> list[str]:
    if isinstance(given, str):
        return [_ROLES.get(given, given)] * count
    named = [each if isinstance(each, str) else colour_text(each) for each in given]
    named = [_ROLES.get(each, each) for each in named]
    return named * count if len(named) == 1 else named


def colour_text(colour: Colour) -> str:
    """Return a colour as ``#rrggbb``.

    >>> colour_text((1.0, 0.5, 0.0))
    '#ff8000'
    """
    return "#" + "".join(f"{round(255 * part):02x}" for part in colour)


@dataclass(frozen=True, slots=True)
class Backdrop:
    """All of a picture that moves but the modules, and how these look at their sites.

    `behind` and `before` the modules lies what never changes, in the frame `box`.
    """

    box: Box
    behind: DrawnShapes
    before: DrawnShapes
    _scene: Scene
    _moving: MovingPart

    @property
    def outline(self) -> list[float]:
        """Return the outline of a module that is a cell or a box: x, y, x, y, ... around 0, 0."""
        return [] if self._moving.outline is None else _rounded(self._moving.outline)

    @property
    def thick(self) -> float:
        """Return the thickness of a module that is a bar."""
        return self._moving.thick

    @property
    def joints(self) -> bool:
        """Return whether bars have joints at their ends."""
        return self._moving.joints

    def body(self, site: Site) -> Body:
        """Return how a module looks at a site."""
        return self._moving.body(self._scene, site)

    def pivot(self, action: Action, source: Site, target: Site) -> Pivot | None:
        """Return how a module turns in an action, None if it goes straight."""
        place_of = self._scene.system.place_of
        return self._moving.pivot(action, place_of(source), place_of(target))


def still(scene: Scene, visited: Iterable[Site] = ()) -> Backdrop:
    """Return what a picture that moves is made of, in a frame that holds the visited sites.

    InputError as for pictures: where a system has no style, or a place cannot be drawn.

    >>> found = still(scene_from_spec("hex:n=3"))
    >>> found.body((1, 0)).shape, found.body((1, 0)).at, len(found.outline)
    ('cell', (1.0, 0.0), 12)
    """
    style = style_of(scene)
    box = style.extent(scene, visited)
    if not scene.system.bounded:  # an endless lattice goes on beyond what modules visit
        box = _widened(box)
    moving = style.moving
    behind, before = (_drawn(layer, scene, box) for layer in (moving.behind, moving.before))
    return Backdrop(box, behind, before, scene, moving)


def _drawn(layer: Layer, scene: Scene, box: Box) -> DrawnShapes:
    canvas = _ListCanvas()
    layer(Pen(canvas, box, 1.0, LIGHT), scene)
    return canvas.drawn


def _widened(box: Box) -> Box:
    left, right, low, high = box
    wide = max(right - left, _WIDE * (high - low)) / 2
    tall = wide / _WIDE
    x, y = (left + right) / 2, (low + high) / 2
    return x - wide, x + wide, y - tall, y + tall
