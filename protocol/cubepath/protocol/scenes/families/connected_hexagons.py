"""Hexagons that may open gaps as long as the aggregate stays connected: a non-local system.

Source: Abrams and Ghrist, the example of non-local positive curvature (figure fig_Nonlocal): the
second catalogue of hexagonal pivots, and a rule for the whole aggregate added to it.
"""

from __future__ import annotations

from cubepath.protocol.core.catalogue import Cell
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.families.hexagons import hex_catalogue, walled
from cubepath.protocol.scenes.family import Family, Values, whole
from cubepath.protocol.systems.lattice import LatticeSystem

RING: tuple[Cell, ...] = (
    (0, 0),
    (0, 1),
    (0, 2),
    (0, 3),
    (1, 3),
    (2, 2),
    (3, 1),
    (3, 0),
    (2, 0),
    (2, -1),
    (1, -1),
    (3, -1),
)
"""A ring of eleven modules, and one more that closes it a second time in one place.

::

      3 4           i  the link of the ring between a and b, which can pivot inwards
     o . o          x  the module beside it, which also links a and b and can pivot outwards
    o . . o         1, 2, 3, 4  corners, each of which can pivot and so open the ring
     2 . i b
      1 a x

The ring opens when i and x both move away, and falls apart when a corner also does: any two of the
three moves leave the aggregate connected, all three do not. No aggregate of eleven modules or fewer
has three such moves, and this is the only one of twelve up to rotation and reflection (found by
listing all aggregates, 8,182,213 with twelve modules up to translation).
"""
HUB: tuple[Cell, ...] = (
    (0, 0),
    (0, 1),
    (-1, 0),
    (1, -1),
    (-2, 1),
    (-2, 2),
    (-2, 3),
    (-2, 4),
    (-1, 4),
    (0, 3),
    (1, 2),
    (1, 1),
    (2, 0),
    (2, -1),
)
"""A hub of one module, joined by three single-module bridges to an arc of ten, as in the figure.

::

      o o           h  the hub
     o . o          1, 2, 3  the bridges, each of which can pivot off the hub and stay at the arc
    o . . o
     o . 1 o
      2 h . o
       . 3 o
"""


def _connected(name: str, values: Values) -> Scene:
    """Build a chain whose goal is another at 120 degrees, or an aggregate where links fail.

    All of them stand in a box three cells wider on each side.
    """
    shape = values["scene"]
    if shape not in ("chain", "ring", "hub"):
        raise InputError(f"scene={shape}: expected one of chain, ring, hub")
    goals: tuple[Cell, ...] = ()
    if shape == "chain":
        count = whole(values, "n", least=1)
        start: tuple[Cell, ...] = tuple((position, 0) for position in range(count))
        goals = tuple((count - 1, step) for step in range(count))
    else:
        start = RING if shape == "ring" else HUB
    system = LatticeSystem(
        hex_catalogue(keeps_topology=False), workspace=walled([*start, *goals]), connected=True
    )
    return Scene(
        spec=name,
        family=name,
        system=system,
        start=start,
        goal=frozenset(goals) if goals else None,
        goals=(goals,) * len(start) if goals else (),
    )


FAMILIES = (
    Family(
        "hex-connected",
        "non-local: hexagonal pivots of catalogue 2, the whole aggregate to stay connected;"
        " complex only, no runs and no shortening",
        {
            "n": ("4", "number of modules of the chain"),
            "scene": (
                "chain",
                "chain, or with positive curvature: ring (12 modules, the fewest), hub (14)",
            ),
        },
        _connected,
        LatticeSystem,
        rule="",
    ),
)
