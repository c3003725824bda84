"""Shapes that compress: hexagons that step as in a Markov chain, which keeps them whole.

Source: Cannon, Daymude, Randall and Richa, A Markov chain algorithm for compression in
self-organizing particle systems (PODC 2016, arXiv 1603.07991), the chain's moves. The rule
`compression` draws them with the chain's probabilities.
"""

from collections.abc import Set as AbstractSet

from cubepath.protocol.core.catalogue import HEXAGONS, Catalogue, Cell, Generator
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.drawn_generators import generators_of
from cubepath.protocol.scenes.random_scenes import SEED_MAX, Stream, uniform_shape
from cubepath.protocol.scenes.registry import Family, Values, whole
from cubepath.protocol.systems.lattice import LatticeSystem

_STEP = {"name": "step-{turn}", "before": "a .", "after": ". a", "connected": "near"}
_UNIFORM_MAX = 32


def compression_catalogue() -> Catalogue:
    """Return the moves along an edge in three directions, one for each of the 104 patterns.

    A connected shape without holes stays so. The eight cells round the edge decide: what hangs on
    the mover must hang together without it (paper, properties 1 and 2), and no five neighbours may
    be left behind, which would surround the place that is left.
    """
    every = generators_of(HEXAGONS, {**_STEP, "symmetry": "rotations"}, {})
    return Catalogue(HEXAGONS, tuple(each for each in every if not _surrounds(each)))


def _surrounds(generator: Generator) -> bool:
    """Return whether five modules stay around an end of the move."""
    on = set(generator.before) - set(generator.trace)
    return any(len(on.intersection(HEXAGONS.beside(cell))) == 5 for cell in generator.trace)


def has_holes(cells: AbstractSet[Cell]) -> bool:
    """Return whether a connected shape surrounds cells that are off.

    Its cells, pairs of neighbours and triples of mutual neighbours are counted: cells minus pairs
    plus triples is one minus the number of holes (Euler).
    """

    def on(cell: Cell, *turns: int) -> bool:
        near = HEXAGONS.beside(cell)
        return all(near[turn] in cells for turn in turns)

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
        start = uniform_shape(count, HEXAGONS, stream)
        while has_holes(frozenset(start)):
            start = uniform_shape(count, HEXAGONS, stream)
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
