"""Scenes drawn as text, pixels and on axes.

Room: agents. It imports the core of the protocol, and no other room of the agents. Environments
render with it, and the coordinator draws runs and complexes.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.agents.rendering.legend import legend_of
    from cubepath.agents.rendering.pen import Box, Colour, palette
    from cubepath.agents.rendering.pictures import INK, colours, draw_on, draw_pixels, extent
    from cubepath.agents.rendering.text import draw_text
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "legend": "legend_of",
            "pen": "Box Colour palette",
            "pictures": "INK colours draw_on draw_pixels extent",
            "text": "draw_text",
        },
    )

__all__ = [
    "INK",
    "Box",
    "Colour",
    "colours",
    "draw_on",
    "draw_pixels",
    "draw_text",
    "extent",
    "legend_of",
    "palette",
]
