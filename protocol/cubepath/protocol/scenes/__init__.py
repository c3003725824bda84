"""Scenes by name or from TOML files, and the families of scenes.

Room: protocol. `scene_from_spec` is the one way from a text to a scene. Families are found by entry
points, including those defined here; `randomly` has what some of them draw from a seed. It imports
`systems` and `core`. All code that gets a scene from a user, a file or a recording asks here.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.protocol.scenes.families.hexagons import hex_catalogue
    from cubepath.protocol.scenes.family import Family
    from cubepath.protocol.scenes.registry import (
        all_families,
        families_of,
        family_named,
        sound_family,
    )
    from cubepath.protocol.scenes.specs import (
        is_scene_file,
        names_file,
        scene_from_spec,
        spec_within,
    )
    from cubepath.protocol.scenes.toml import read_scene, scene_from_toml, scene_to_toml
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "families.hexagons": "hex_catalogue",
            "family": "Family",
            "registry": "all_families families_of family_named sound_family",
            "specs": "is_scene_file names_file scene_from_spec spec_within",
            "toml": "read_scene scene_from_toml scene_to_toml",
        },
    )

__all__ = [
    "Family",
    "all_families",
    "families_of",
    "family_named",
    "hex_catalogue",
    "is_scene_file",
    "names_file",
    "read_scene",
    "scene_from_spec",
    "scene_from_toml",
    "scene_to_toml",
    "sound_family",
    "spec_within",
]
