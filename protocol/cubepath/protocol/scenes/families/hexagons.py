"""Hexagonal pivots: three catalogues, and scenes that take one straight chain to another.

Source: Abrams and Ghrist, example 2-d hex with pivots.
"""

from collections.abc import Sequence

from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, Cell
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.built_in_pages import page_catalogue
from cubepath.protocol.scenes.registry import MODULES_MAX, Family, Values, scene_of, whole
from cubepath.protocol.systems.lattice import LatticeSystem

_FLOOR, _LINE, _CEILING = 0, 1, 3
_MARGIN = 1
"""Columns of the channel to the left of the start and to the right of the goal."""


def _row(number: int, columns: range) -> tuple[Cell, ...]:
    """Return the cells of an upright row in these columns."""
    return tuple((column - number // 2, number) for column in columns)


def _tunnel(name: str, values: Values) -> Scene:
    """Build the channel with the line at its left end; the goal is the line at its right end."""
    count = whole(values, "n", least=1)
    long = 2 * (count + _MARGIN)
    if values["length"] != "auto":
        long = whole(values, "length", least=count + 2 * _MARGIN + 1)
    if values["catalogue"] not in ("mixed", "1", "2"):
        raise InputError(f"catalogue={values['catalogue']}: expected one of mixed, 1, 2")
    rows = [_row(number, range(long)) for number in range(_CEILING + 1)]
    line = rows[_LINE]
    goal = line[long - _MARGIN - count : long - _MARGIN]
    system = LatticeSystem(
        page_catalogue("hexagons-" + values["catalogue"].replace("mixed", "tunnel")),
        workspace=[cell for row in rows for cell in row],
        filled=rows[_FLOOR],
        empty=rows[_CEILING],
    )
    return scene_of(name, system, line[_MARGIN : _MARGIN + count], goal)


_TUNNEL = (
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
        "tunnel",
    ),
)


def walled(cells: Sequence[Cell], margin: int = 3) -> list[Cell]:
    """Return the cells of a box around the given cells, wider by a margin on each side.

    Under the second catalogue pieces may break off and move away, so it needs walls.
    """
    return [
        (q, r)
        for q in range(min(c[0] for c in cells) - margin, max(c[0] for c in cells) + margin + 1)
        for r in range(min(c[1] for c in cells) - margin, max(c[1] for c in cells) + margin + 1)
    ]


def _hex(name: str, values: Values) -> Scene:
    """Build a chain of hexagons whose goal is another chain.

    The start runs along direction 0 from cell (0, 0). The goal begins at its end; `bend` is the
    angle between the two chains, 60 or 120 degrees on either side, or 0 for a slide along the
    same line, `shift` cells ahead. Then the goal is moved by `along` cells in direction 0 and
    `aside` cells in direction 1: to be parallel, or to cross the start, or to lie elsewhere.

    With `base` 1 the cell (-1, 0), next to module 0, is an obstacle that is on, the paper's base
    cell. The first catalogue holds the aggregate to it, so the goal begins next to it, too, and
    `bend` is the angle between the two chains there.
    """
    count = whole(values, "n", least=1)
    bend = values["bend"]
    turns = {"0": 0, "120": 1, "60": 2, "-60": 4, "-120": 5}
    if bend not in turns:
        raise InputError(f"bend={bend}: expected one of {', '.join(turns)}")
    start: tuple[Cell, ...] = tuple((position, 0) for position in range(count))
    ahead = HEX_DIRECTIONS[turns[bend]]
    if turns[bend] == 0:
        first = whole(values, "shift", least=0)
        if first > count:
            raise InputError(f"shift={first}: expected at most n={count}")
    else:
        first = count - 1
    head: Cell = (first, 0)
    filled: tuple[Cell, ...] = ()
    if whole(values, "base", least=0, most=1):
        if turns[bend] == 0:
            raise InputError(
                "bend=0: with base=1 the goal begins next to the base, expected a bend"
            )
        filled = ((-1, 0),)
        ahead = HEX_DIRECTIONS[3 - turns[bend]]
        head = (ahead[0] - 1, ahead[1])
    moved = [whole(values, key, least=-MODULES_MAX) for key in ("along", "aside")]
    head = (head[0] + moved[0], head[1] + moved[1])
    goals: tuple[Cell, ...] = tuple(
        (head[0] + step * ahead[0], head[1] + step * ahead[1]) for step in range(count)
    )
    workspace = None
    if name == "hex-open":
        # A chain that goes to a parallel one stands across both in between.
        workspace = walled([*start, *goals], 3 + count * any(moved))
    catalogue = page_catalogue("hexagons-1" if name == "hex" else "hexagons-2")
    system = LatticeSystem(catalogue, workspace=workspace, filled=filled)
    return scene_of(name, system, start, goals)


_KEYS = {
    "n": ("7", "number of modules"),
    "bend": ("120", "angle between the two chains: 60, 120, -60, -120, or 0 for a slide"),
    "shift": ("1", "for bend=0: how far ahead the goal lies, 0 to n"),
    "along": ("0", "by how many cells the goal is moved along the start, for the rule chains"),
    "aside": ("0", "by how many cells it is moved to the side, in direction 1"),
    "base": ("0", "1 for a fixed base cell, an obstacle next to module 0, from which both go out"),
}
FAMILIES = (
    *_TUNNEL,
    Family(
        "hex",
        "hexagonal pivots that keep the topology (catalogue 1)",
        {**_KEYS, "n": ("12", "number of modules")},
        _hex,
        LatticeSystem,
        "chain",
    ),
    Family(
        "hex-open",
        "hexagonal pivots that may split the aggregate (catalogue 2), in a bounded workspace",
        _KEYS,
        _hex,
        LatticeSystem,
        "chain",
    ),
)
