"""Pictures of the modules as text: the "ansi" render mode.

It only draws what it is given.
"""

from __future__ import annotations

from collections.abc import Sequence

from cubepath.agents.rendering.styles import style_of
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene


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
