"""Shapes that compress: hexagons that step as in a Markov chain, which keeps them whole.

Source: Cannon, Daymude, Randall and Richa, A Markov chain algorithm for compression in
self-organizing particle systems (PODC 2016, arXiv 1603.07991), the chain's moves. The rule
`compression` draws them with the chain's probabilities.
"""

from collections.abc import Set as AbstractSet
from itertools import combinations, takewhile

from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, HEXAGONS, Catalogue, Cell, Generator
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.random_scenes import SEED_MAX, SIX, Stream, uniform_shape
from cubepath.protocol.scenes.registry import Family, Values, whole
from cubepath.protocol.systems.lattice import LatticeSystem

_RING = 8
_SHARED = frozenset((0, 4))
"""Which cells of the ring lie beside both ends of the edge."""
_NEAR = frozenset((1, 2, 3))
"""Which of them lie beside its first end alone; the rest lie beside the other end alone."""
_UNIFORM_MAX = 32


def beside(cell: Cell, turn: int) -> Cell:
    """Return the cell beside a cell in direction `turn`, counted modulo 6."""
    along, up = HEX_DIRECTIONS[turn % 6]
    return cell[0] + along, cell[1] + up


def keeps_shape(on: AbstractSet[int]) -> bool:
    """Return whether a module may move along an edge when these cells of the ring round it are on.

    The cells are numbered round the ring: 0 and 4 are beside both ends of the edge, 1 to 3 beside
    one, 5 to 7 beside the other. Allowed is (paper, properties 1 and 2) that 0 or 4 is on and each
    run of cells that are on holds exactly one of these two; or that neither is, and there is
    exactly one run on each side. This is so for 104 of the 256 sets.

    A connected shape without holes stays so. No module leaves five neighbours behind, which the
    paper forbids separately: with 0 to 4 on, one run holds both 0 and 4.

    >>> keeps_shape({0, 1}), keeps_shape({0, 2}), keeps_shape({2, 5, 6}), keeps_shape({2})
    (True, False, True, False)
    """
    begins = [cell for cell in range(_RING) if cell in on and (cell - 1) % _RING not in on]
    runs = [
        frozenset(takewhile(on.__contains__, ((cell + far) % _RING for far in range(_RING))))
        for cell in begins
    ]
    if on & _SHARED:
        return bool(runs) and all(len(run & _SHARED) == 1 for run in runs)
    return sorted(run <= _NEAR for run in runs) == [False, True]


def compression_catalogue() -> Catalogue:
    """Return the moves along an edge in three directions, one for each of the 104 patterns.

    The support is the two ends of the edge and the ring of eight cells round it, the trace its
    ends. A generator is ``step-AXIS-CELLS``, with those cells of the ring that are on, from 0.
    """
    patterns = [
        on
        for size in range(_RING + 1)
        for on in combinations(range(_RING), size)
        if keeps_shape(frozenset(on))
    ]
    return Catalogue(
        HEXAGONS, tuple(_step(axis, on) for axis in range(len(SIX) // 2) for on in patterns)
    )


def _step(axis: int, on: tuple[int, ...]) -> Generator:
    here, there = (0, 0), beside((0, 0), axis)
    ring = [beside(here, axis + turn) for turn in range(1, 6)]
    ring += [beside(there, axis + turn) for turn in (-1, 0, 1)]
    shown = tuple(ring[cell] for cell in on)
    return Generator(
        name=f"step-{axis}-{''.join(map(str, on))}",
        support=(here, there, *ring),
        trace=(here, there),
        before=(here, *shown),
        after=(there, *shown),
        motion=((here, there),),
    )


def has_holes(cells: AbstractSet[Cell]) -> bool:
    """Return whether a connected shape surrounds cells that are off.

    Its cells, pairs of neighbours and triples of mutual neighbours are counted: cells minus pairs
    plus triples is one minus the number of holes (Euler).
    """

    def on(cell: Cell, *turns: int) -> bool:
        return all(beside(cell, turn) in cells for turn in turns)

    pairs = sum(on(cell, turn) for cell in cells for turn in (0, 1, 2))
    triples = sum(on(cell, turn, turn + 1) for cell in cells for turn in (0, 1))
    return len(cells) - pairs + triples != 1


def _compression(name: str, values: Values) -> Scene:
    """Build a line of modules, or a random shape without holes; there is no goal."""
    count = whole(values, "n", least=2)
    seed = whole(values, "seed", least=0, most=SEED_MAX)
    start: tuple[Cell, ...] = tuple((position, 0) for position in range(count))
    if values["start"] == "random":
        if count > _UNIFORM_MAX:
            raise InputError(f"n={count},start=random: expected at most {_UNIFORM_MAX} cells")
        stream = Stream("start shape", seed)
        start = uniform_shape(count, SIX, stream)
        while has_holes(frozenset(start)):
            start = uniform_shape(count, SIX, stream)
    elif values["start"] != "line":
        raise InputError(f"start={values['start']}: expected line or random")
    system = LatticeSystem(compression_catalogue())
    return Scene(spec=name, family=name, system=system, start=start)


FAMILIES = (
    Family(
        "compression",
        "hexagons that step to a cell beside them and keep the shape whole; no goal",
        {
            "n": ("12", "number of modules"),
            "start": ("line", f"line, or random: any shape without holes, to n={_UNIFORM_MAX}"),
            "seed": ("1", "of the random shape"),
        },
        _compression,
        LatticeSystem,
        "compression",
    ),
)
