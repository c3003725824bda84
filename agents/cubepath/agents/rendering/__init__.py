"""Scenes drawn as text, pixels and on axes.

Room: agents. It imports the core of the protocol, and no other room of the agents. Environments
render with it, and the coordinator draws runs and complexes.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.agents.rendering.backdrop import Drawn, Still, colour_text, still
    from cubepath.agents.rendering.legend import legend_of
    from cubepath.agents.rendering.pen import Box, Colour, arcs, palette
    from cubepath.agents.rendering.pictures import colours, draw_on, draw_pixels, extent, solid_of
    from cubepath.agents.rendering.solids import Solid
    from cubepath.agents.rendering.text import draw_text
    from cubepath.agents.rendering.themes import DARK, GOAL, INK, LIGHT, PAPER, WALL, Theme
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "backdrop": "Drawn Still colour_text still",
            "solids": "Solid",
            "legend": "legend_of",
            "pen": "Box Colour arcs palette",
            "pictures": "solid_of colours draw_on draw_pixels extent",
            "text": "draw_text",
            "themes": "DARK GOAL INK LIGHT PAPER Theme WALL",
        },
    )

__all__ = [
    "DARK",
    "GOAL",
    "INK",
    "LIGHT",
    "PAPER",
    "WALL",
    "Box",
    "Colour",
    "Drawn",
    "Solid",
    "Still",
    "Theme",
    "arcs",
    "colour_text",
    "colours",
    "draw_on",
    "draw_pixels",
    "draw_text",
    "extent",
    "legend_of",
    "palette",
    "solid_of",
    "still",
]
