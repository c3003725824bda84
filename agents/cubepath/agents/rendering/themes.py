"""The colours of pictures but for those of modules, and what stands for them on dark ground.

Pure data.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

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
