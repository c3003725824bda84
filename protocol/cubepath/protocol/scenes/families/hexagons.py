"""Hexagonal pivots: both catalogues, and scenes that take one straight chain to another.

Source: Abrams and Ghrist, example 2-d hex with pivots.
"""

from __future__ import annotations

from collections.abc import Sequence

from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, HEXAGONS, Catalogue, Cell, Generator
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.family import Family, Values, whole
from cubepath.protocol.systems.lattice import LatticeSystem


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


def _plus(one: tuple[int, int], other: tuple[int, int]) -> tuple[int, int]:
    return one[0] + other[0], one[1] + other[1]


def walled(cells: Sequence[Cell]) -> list[Cell]:
    """Return the cells of a box around the given cells, three cells wider on each side.

    Under the second catalogue pieces may break off and move away, so it needs walls.
    """
    margin = 3
    return [
        (q, r)
        for q in range(min(c[0] for c in cells) - margin, max(c[0] for c in cells) + margin + 1)
        for r in range(min(c[1] for c in cells) - margin, max(c[1] for c in cells) + margin + 1)
    ]


def _hex(name: str, values: Values) -> Scene:
    """Build a chain of hexagons whose goal is another chain.

    The start runs along direction 0 from cell (0, 0). The goal begins at its end; `bend` is the
    angle between the two chains, 60 or 120 degrees on either side, or 0 for a slide along the
    same line, `shift` cells ahead.

    With `base` 1 the cell (-1, 0), next to module 0, is an obstacle that is on, the paper's base
    cell. The first catalogue holds the aggregate to it, so the goal begins beside the base too, and
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
    goals: tuple[Cell, ...] = tuple(
        (head[0] + step * ahead[0], head[1] + step * ahead[1]) for step in range(count)
    )
    workspace = None
    if name == "hex-open":
        workspace = walled([*start, *goals])
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
    "base": ("0", "1 for a fixed base cell, an obstacle next to module 0, from which both go out"),
}
FAMILIES = (
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
