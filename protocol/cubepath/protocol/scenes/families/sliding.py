"""Sliding squares: rows and columns of square cells that slide past each other and an obstacle.

Source: Abrams and Ghrist, example 2-d square lattice; the scene is their example of its state
complex (two free squares and a p-by-q rectangle of obstacles).
"""

from __future__ import annotations

from itertools import pairwise

from cubepath.protocol.core.catalogue import SQUARES, Catalogue, Cell, Generator
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.family import Family, Values, whole
from cubepath.protocol.systems.lattice import LatticeSystem

_MOST_CELLS = 10_000
_LONGEST_RUN = 1_000


def sliding_catalogue(longest: int) -> Catalogue:
    """Return the generators that slide a run of k + 1 cells by one, for each k up to `longest`.

    There are two generators for each k, `row-k` and `column-k`; the second is the first with x and
    y exchanged. The middle row of `row-k` is the cells x = -1 ... k + 2 of y = 0. Both end cells
    are off and not in the trace; the trace is the k + 2 inner cells, of which the first k + 1 are
    on before and the last k + 1 after. In the row above and the row below, a cell over the first
    inner cell may be on only if the next one in its row is, and a cell over the last only if the
    one before it is: the run leaves no cell behind that was attached only to it (the paper's dot
    with its arrow). Other cells of these rows are not in the support.

    All k + 1 modules of the run move by one cell. The mover, which proposes, is the one with the
    least coordinate: the last of the run on the way there, the first on the way back.
    """
    found: list[Generator] = []
    for k in range(longest + 1):
        for name, axis in (("row", 0), ("column", 1)):
            found.append(_slide(f"{name}-{k}", k, axis))
    return Catalogue(SQUARES, tuple(found))


def _slide(name: str, k: int, axis: int) -> Generator:
    def cell(along: int, across: int = 0) -> Cell:
        return (along, across) if axis == 0 else (across, along)

    inner = [cell(along) for along in range(k + 2)]
    pairs = ((0, 1), (k + 1, k))  # a cell beside the run, and the cell its arrow points to
    guards = tuple(
        (cell(dot, side), cell(neighbour, side)) for side in (1, -1) for dot, neighbour in pairs
    )
    beside = tuple(dict.fromkeys(site for pair in guards for site in pair))
    return Generator(
        name=name,
        support=(cell(-1), *inner, cell(k + 2), *beside),
        trace=tuple(inner),
        before=tuple(inner[:-1]),
        after=tuple(inner[1:]),
        motion=tuple(pairwise(inner)),
        free=beside,
        guards=guards,
    )


def _sliding(name: str, values: Values) -> Scene:
    """Build n free squares in a row on top of a p-by-q obstacle, with the goal below it.

    The goal is the start after half a turn about the middle of the obstacle.
    """
    wide, tall = whole(values, "p", least=1), whole(values, "q", least=1)
    if wide * tall > _MOST_CELLS:
        raise InputError(f"p={wide},q={tall}: expected at most {_MOST_CELLS} cells of obstacle")
    count = whole(values, "n", least=2)  # a single square turns no corner
    # An obstacle is in no trace, so no run is longer than the number of free squares.
    reach = values["k"] or str(min(count - 1, _LONGEST_RUN))
    longest = whole({"k": reach}, "k", least=0, most=_LONGEST_RUN)
    start: tuple[Cell, ...] = tuple((x, tall) for x in range(count))
    goal: tuple[Cell, ...] = tuple((wide - 1 - x, -1) for x in range(count))
    return Scene(
        spec=name,
        family=name,
        system=LatticeSystem(
            sliding_catalogue(longest), filled=[(x, y) for x in range(wide) for y in range(tall)]
        ),
        start=start,
        goal=frozenset(goal),
        goals=(goal,) * count,
    )


FAMILIES = (
    Family(
        "sliding",
        "squares that slide in rows and columns, round a rectangle of obstacles",
        {
            "p": ("3", "width of the obstacle"),
            "q": ("2", "height of the obstacle"),
            "n": ("2", "number of free squares"),
            "k": ("", "longest run that slides is k + 1 cells; n - 1 when left out, all there is"),
        },
        _sliding,
        LatticeSystem,
    ),
)
