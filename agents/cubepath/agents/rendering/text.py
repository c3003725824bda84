"""Where the modules are, as text: the "ansi" render mode.

Room: agents; draws what it is given and asks nobody.
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
    with ``*`` behind it at its own goal. Hexagons stand in rows offset by half a cell; segments of
    an arm are ``---`` and ``|`` between vertices, ``===`` and ``H`` where the goal wants them, and
    ``...`` and ``:`` where the goal is not there yet; a marked vertex is ``*``. A general graph has
    a line for each vertex, with its neighbours. The frame holds start, goal and finite workspaces,
    so that pictures of one run line up as long as modules stay in it. Chords and letters are
    written as `cubepath.agents.rendering.chords` and `letters` say.
    """
    return style_of(scene).text(scene, sites)
