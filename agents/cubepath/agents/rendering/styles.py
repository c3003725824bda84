"""The styles of pictures by name: the values that a system's `drawing` may have.

Pure functions.
"""

from __future__ import annotations

from collections.abc import Mapping

from cubepath.agents.rendering import cells, chords, edges, letters, vertices
from cubepath.agents.rendering.style import Style
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene

STYLES: Mapping[str, Style] = {
    "hexagons": cells.HEXAGONS,
    "squares": cells.SQUARES,
    "map": cells.MAP,
    "edges": edges.EDGES,
    "graph": vertices.GRAPH,
    "chords": chords.CHORDS,
    "letters": letters.LETTERS,
}


def style_of(scene: Scene) -> Style:
    """Return the style in which a scene is drawn; InputError if its system names none."""
    found = STYLES.get(scene.system.drawing)
    if found is None:
        raise InputError(
            f"{scene.spec}: drawing {scene.system.drawing!r}, expected one of {', '.join(STYLES)}"
        )
    return found
