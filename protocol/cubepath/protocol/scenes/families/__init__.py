"""The families of scenes that come with the project, one subject a module.

What imports a family is the entry point ``cubepath`` of the group ``cubepath.systems``.
"""

from __future__ import annotations

from cubepath.protocol.scenes.families import (
    arm,
    arms,
    assembly,
    connected_hexagons,
    free_arm,
    hexagons,
    sliding,
    triangulations,
    tunnel,
    vehicles,
    words,
)

FAMILIES = (
    *hexagons.FAMILIES,
    *connected_hexagons.FAMILIES,
    *tunnel.FAMILIES,
    *sliding.FAMILIES,
    *vehicles.FAMILIES,
    *arm.FAMILIES,
    *free_arm.FAMILIES,
    *arms.FAMILIES,
    *triangulations.FAMILIES,
    *words.FAMILIES,
    *assembly.FAMILIES,
)
