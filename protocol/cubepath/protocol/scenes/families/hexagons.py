"""Hexagonal pivots: three catalogues, and scenes that take one straight chain to another.

Source: Abrams and Ghrist, example 2-d hex with pivots.
"""

from collections.abc import Sequence

from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, HEXAGONS, Catalogue, Cell, Generator
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.registry import MODULES_MAX, Family, Values, whole
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


_CONNECTED = (
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


def hex_catalogue(*, keeps_topology: bool) -> Catalogue:
    """Return the six hexagonal pivots, with the larger support if they keep the topology.

    A module at A pivots to A' about B, one of the two cells beside both; C is the other. With
    A', B, D, E, F, C round A and A, B, D', E', F', C round A', the first catalogue has the support
    {A, A', B, C, E, E', F, F'}, the second {A, A', B, C, F, F'}; B is on, all others are off,
    and the trace is {A, A'} (paper, example 2-d hex with pivots).
    """
    found = []
    for k in range(3):
        for sense, side in ((1, "left"), (-1, "right")):
            here = (0, 0)
            there = HEX_DIRECTIONS[k]
            pivot = HEX_DIRECTIONS[(k + sense) % 6]
            opposite = HEX_DIRECTIONS[(k - sense) % 6]
            behind = HEX_DIRECTIONS[(k + 3) % 6]  # E
            beside = HEX_DIRECTIONS[(k - 2 * sense) % 6]  # F
            ahead = _plus(there, HEX_DIRECTIONS[k])  # E'
            beyond = _plus(there, HEX_DIRECTIONS[(k - sense) % 6])  # F'
            support = [here, there, pivot, opposite, beside, beyond]
            if keeps_topology:
                support += [behind, ahead]
            found.append(
                Generator(
                    name=f"pivot-{k}-{side}",
                    support=tuple(support),
                    trace=(here, there),
                    before=(here, pivot),
                    after=(there, pivot),
                    motion=((here, there),),
                )
            )
    return Catalogue(HEXAGONS, tuple(found))


def monkey_catalogue() -> Catalogue:
    """Return the pivots of the second catalogue, and the six monkey moves.

    Source: H. Akitaya, E. Demaine, A. Gonczi, D. Hendrickson, A. Hesterberg, M. Korman, O. Korten,
    J. Lynch, I. Parada and V. Sacristan, Characterizing Universal Reconfigurability of Modular
    Pivoting Robots (SoCG 2021), whose restricted moves are the pivots of the second catalogue. With
    both, any two connected shapes of n hexagons reach one another in O(n^3) moves that keep the
    aggregate connected. ::

          C            A, A'  where the module is before and after: the trace
        A   A'         P, Q   the modules that it turns about: on
      P   B   Q        B, C   the cells beside both A and A': off

    The module turns about the corner of A, B and P by 60 degrees, which takes it half into the gap
    B. There it touches Q at the corner of A', B and Q, lets go of P, and turns about that corner by
    60 degrees more. A pivot to B, which would turn about the first corner by 120 degrees, is what
    Q prevents. The two halves sweep A, A', B and C alone, so the support is {A, A', B, C, P, Q}.
    """
    found = list(hex_catalogue(keeps_topology=False).generators)
    for k in range(3):
        for sense, side in ((1, "left"), (-1, "right")):
            here, there = (0, 0), HEX_DIRECTIONS[k]
            gap = HEX_DIRECTIONS[(k + sense) % 6]
            opposite = HEX_DIRECTIONS[(k - sense) % 6]
            held = (HEX_DIRECTIONS[(k + 2 * sense) % 6], _plus(gap, there))
            found.append(
                Generator(
                    name=f"monkey-{k}-{side}",
                    support=(here, there, gap, opposite, *held),
                    trace=(here, there),
                    before=(here, *held),
                    after=(there, *held),
                    motion=((here, there),),
                )
            )
    return Catalogue(HEXAGONS, tuple(found))


def _plus(one: tuple[int, int], other: tuple[int, int]) -> tuple[int, int]:
    return one[0] + other[0], one[1] + other[1]


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
    system = LatticeSystem(
        hex_catalogue(keeps_topology=name == "hex"), workspace=workspace, filled=filled
    )
    return Scene(
        spec=name,
        family=name,
        system=system,
        start=start,
        goal=frozenset(goals),
        goals=(goals,) * count,
    )


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
    *_CONNECTED,
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
