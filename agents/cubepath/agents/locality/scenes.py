"""The scenes in which a rule is checked: of each family a small one, and one beyond its reach.

In a small one all modules may sense one another; only in a larger one is there anything that a
module does not see.
"""

from __future__ import annotations

from collections.abc import Mapping

from cubepath.protocol.scenes.registry import all_families

SCENES: Mapping[str, tuple[str, ...]] = {
    "hex": ("hex:n=4", "hex:n=12"),
    "hex-open": ("hex-open:n=4", "hex-open:n=12"),
    "hex-tunnel": ("hex-tunnel",),
    "sliding": ("sliding:p=2,q=1,n=3", "sliding:p=6,q=2,n=8"),
    "agv": ("agv:graph=K5,n=3", "agv:graph=grid6x6,n=9"),
    "agv-labelled": ("agv-labelled:graph=K5,n=3", "agv-labelled:graph=grid6x6,n=8"),
    "arm": ("arm:n=3", "arm:n=12"),
    "arm-free": ("arm-free:n=3", "arm-free:n=8"),
    "arms": ("arms",),
    "polygon": ("polygon:n=6", "polygon:n=14"),
    "triangulation": ("triangulation:n=6", "triangulation:n=16"),
    "words": ("words", "words:word=abcabcabcabc,relations=ab~ba+bc~cb+ac~ca"),
    "assembly": ("assembly:n=2", "assembly:n=4"),
}
"""By family; of another one it is the default scene."""


def all_scenes() -> list[str]:
    """Return the scenes of all families."""
    return [spec for family in all_families() for spec in SCENES.get(family, (family,))]
