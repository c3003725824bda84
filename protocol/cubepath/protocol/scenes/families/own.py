"""The families of scenes that come with the project, in the order in which they are listed.

The entry point ``cubepath`` of the group ``cubepath.systems`` names them.
"""

from __future__ import annotations

from cubepath.protocol.scenes.families import (
    arm,
    arms,
    assembly,
    connected_hexagons,
    free_arm,
    hexagons,
    shapes,
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
    *shapes.FAMILIES,
    *vehicles.FAMILIES,
    *arm.FAMILIES,
    *free_arm.FAMILIES,
    *arms.FAMILIES,
    *triangulations.FAMILIES,
    *words.FAMILIES,
    *assembly.FAMILIES,
)
