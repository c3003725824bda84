"""What an environment tells of where its modules are: their share at the goal, arrays, pictures.

The same for both clocks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.rendering.pictures import draw_pixels
from cubepath.agents.rendering.text import draw_text
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene


def share_at_goal(scene: Scene, sites: Sequence[Site]) -> float:
    """Return the fraction of the modules at these sites that are on sites of the goal."""
    if scene.goal is None:
        return 0.0
    return sum(site in scene.goal for site in sites) / len(sites)


def state_of(scene: Scene, sites: Sequence[Site]) -> NDArray[np.int32]:
    """Return the places of modules at these sites, int32, shape (modules, site_size)."""
    return np.array([scene.system.encode_site(site) for site in sites], np.int32)


def rendered(
    scene: Scene, sites: Sequence[Site], render_mode: str | None
) -> str | NDArray[np.uint8] | None:
    """Draw modules at these sites as `CubepathEnv.render` describes."""
    if render_mode == "rgb_array":
        return draw_pixels(scene, sites)
    if render_mode is None:
        return None
    text = draw_text(scene, sites)
    if render_mode == "ansi":
        return text
    print(text)
    return None
