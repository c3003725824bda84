"""The hexagonal tunnel: a line of hexagons that files along a channel, climbing one after another.

Source: Abrams and Ghrist, example ex_SCHex with figure fig_ShHexEx: a channel of four rows, filled
obstacles below and empty ones above, in which a line of modules climbs across one by one; its
state complex is contractible for any length, and of higher dimension for longer tunnels.

The text does not contain the drawing, so this is our reading:

- Rows are rows of the hexagonal lattice, upright: row r begins half a cell further right than
  row r - 1 if r is odd, and half a cell further left if r is even. The channel is the whole
  workspace, so every support lies in it.
- The line lies on the filled row, one column from the left end of the channel.
- A pivot along the rows has its support as in the first catalogue of example 2-d hex with pivots, a
  pivot from one free row to the other as in the second, that is, without E and E'. Those two
  would be cells of the two rows of obstacles: one always off, the other always on. So with the
  first catalogue throughout, no module of the line could move.

So a module at an end of the line climbs onto it, walks along it to the other end, and steps down in
front of it; the next can follow before it arrives. The line holds together, because E keeps the
modules at its ends from walking off along the filled row. For every line and every length that was
tried (to n = 18) the complex collapses to a point; its dimension is floor(n / 4) + 1, except for n
= 3, where it is 2. With the second catalogue throughout, modules do walk off, and the complex is
not contractible: its Euler characteristic is -1 for two modules in six columns, -9 for three in
eight.
"""

from __future__ import annotations

from cubepath.protocol.core.catalogue import HEXAGONS, Catalogue, Cell
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.families.hexagons import hex_catalogue
from cubepath.protocol.scenes.family import Family, Values, whole
from cubepath.protocol.systems.lattice import LatticeSystem

_FLOOR, _LINE, _CEILING = 0, 1, 3
_MARGIN = 1
"""Columns of the channel to the left of the start and to the right of the goal."""


def tunnel_catalogue() -> Catalogue:
    """Return the six pivots: along the rows from the first catalogue, across from the second."""
    along = hex_catalogue(keeps_topology=True).generators
    across = hex_catalogue(keeps_topology=False).generators
    return Catalogue(
        HEXAGONS,
        tuple(
            one if one.name.startswith("pivot-0-") else other
            for one, other in zip(along, across, strict=True)
        ),
    )


def _row(number: int, columns: range) -> tuple[Cell, ...]:
    """Return the cells of an upright row in these columns."""
    return tuple((column - number // 2, number) for column in columns)


def _tunnel(name: str, values: Values) -> Scene:
    """Build the channel with the line at its left end; the goal is the line at its right end."""
    count = whole(values, "n", least=1)
    long = 2 * (count + _MARGIN)
    if values["length"] != "auto":
        long = whole(values, "length", least=count + 2 * _MARGIN + 1)
    catalogues = {
        "mixed": tunnel_catalogue(),
        "1": hex_catalogue(keeps_topology=True),
        "2": hex_catalogue(keeps_topology=False),
    }
    if values["catalogue"] not in catalogues:
        raise InputError(f"catalogue={values['catalogue']}: expected one of mixed, 1, 2")
    rows = [_row(number, range(long)) for number in range(_CEILING + 1)]
    line = rows[_LINE]
    goal = line[long - _MARGIN - count : long - _MARGIN]
    return Scene(
        spec=name,
        family=name,
        system=LatticeSystem(
            catalogues[values["catalogue"]],
            workspace=[cell for row in rows for cell in row],
            filled=rows[_FLOOR],
            empty=rows[_CEILING],
        ),
        start=line[_MARGIN : _MARGIN + count],
        goal=frozenset(goal),
        goals=(goal,) * count,
    )


FAMILIES = (
    Family(
        "hex-tunnel",
        "hexagons in a channel of four rows, whose line climbs across one by one",
        {
            "n": ("6", "number of modules of the line"),
            "length": (
                "auto",
                "columns of the channel, at least n+3; auto is 2n+2: the whole line crosses",
            ),
            "catalogue": (
                "mixed",
                "supports of the pivots: mixed (along the rows 1, across 2), or 1 or 2 throughout",
            ),
        },
        _tunnel,
        LatticeSystem,
    ),
)
