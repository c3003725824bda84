"""The styles of pictures by name: the values that a system's `drawing` may have.

Pictures of the modules as text: the "ansi" render mode.

It only draws what it is given.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cubepath.agents.rendering import cells, chords, edges, letters, vertices
from cubepath.agents.rendering.style import Style
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
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


def draw_text(scene: Scene, sites: Sequence[Site]) -> str:
    """Return a picture in plain text of modules at `sites`, by number.

    A module is ``o``, or ``@`` on a cell of the goal; a free cell of the goal is ``+``, any other
    ``.``, and an occupied obstacle or a hole in a map ``#``. A labelled module shows its label,
    followed by ``*`` at its own goal. Hexagons stand in rows offset by half a cell. Segments of an
    arm are ``---`` and ``|`` between vertices, ``===`` and ``H`` on edges of the goal; edges of the
    goal without a segment are ``...`` and ``:``; a marked vertex is ``*``. A general graph has a
    line for each vertex, with its neighbours. The frame holds start, goal and finite workspaces, so
    pictures of one run line up while modules stay in it. For chords and letters see
    `cubepath.agents.rendering.chords` and `letters`.

    >>> scene = scene_from_spec("agv:graph=grid3x2,n=2")
    >>> print(draw_text(scene, scene.start))
    o . +
    o . +
    """
    return style_of(scene).text(scene, sites)
