"""Scenes drawn as text, pixels and on axes.

Room: agents; of the protocol it imports the core, of the agents nothing. Environments render with
it, and the coordinator draws runs and complexes.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.agents.rendering.legend import legend_of
    from cubepath.agents.rendering.pen import Colour
    from cubepath.agents.rendering.pictures import INK, colours, draw_on, draw_pixels, frame
    from cubepath.agents.rendering.text import draw_text
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "legend": "legend_of",
            "pen": "Colour",
            "pictures": "INK colours draw_on draw_pixels frame",
            "text": "draw_text",
        },
    )

__all__ = [
    "INK",
    "Colour",
    "colours",
    "draw_on",
    "draw_pixels",
    "draw_text",
    "frame",
    "legend_of",
]
