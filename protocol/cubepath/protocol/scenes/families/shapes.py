"""From one random shape to another: hexagons that pivot, and squares that slide.

`cubepath.protocol.scenes.random_scenes` draws the shapes. Whether the goal can be reached is
not known, unless it is where a walk leads: with catalogue 1 hexagons cannot pass concave corners
(of the 3652 shapes of 7 hexagons 3585 reach one another), and pieces that slide or part may never
meet again. With monkey moves, catalogue 3, any connected shape becomes any other, if the box is
wide enough: `hexagon_plan` of the coordinator returns the moves.
"""

from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import pairwise

from cubepath.protocol.core.catalogue import HEXAGONS, SQUARES, Catalogue, Cell, Generator, Lattice
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.built_in_pages import page_catalogue
from cubepath.protocol.scenes.families.hexagons import walled
from cubepath.protocol.scenes.random_scenes import (
    SEED_MAX,
    WALK_KEY,
    Stream,
    grown_shape,
    happens,
    share_of,
    uniform_shape,
    walk_length,
    walked,
)
from cubepath.protocol.scenes.registry import Family, Values, scene_of, whole
from cubepath.protocol.systems.lattice import LatticeSystem

_MOST_CELLS = 10_000
_LONGEST_RUN = 1_000
_WIDEST = 1_000


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
    filled = [(x, y) for x in range(wide) for y in range(tall)]
    return scene_of(name, LatticeSystem(sliding_catalogue(longest), filled=filled), start, goal)


_SLIDING = (
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
        "leader",
    ),
)


_UNIFORM_MAX = {HEXAGONS: 32, SQUARES: 18}
"""Up to here a uniform shape takes about half a second or less; each further cell takes 1.3 times
as long with hexagons, 1.7 times with squares."""
_DENSEST = "0.5"

_Build = Callable[[Sequence[Cell], Sequence[Cell]], LatticeSystem]
"""Make the system for the obstacles and for the cells of the box around all that matters."""


def _hexagons(name: str, values: Values) -> Scene:
    """Build hexagons in a random shape whose goal is another, or where a random walk leads."""
    number = values["catalogue"]
    if number not in ("1", "2", "3"):
        raise InputError(f"catalogue={number}: expected 1, 2 or 3")

    def build(filled: Sequence[Cell], box: Sequence[Cell]) -> LatticeSystem:
        workspace = None if number == "1" else box
        catalogue = page_catalogue(f"hexagons-{number}")
        return LatticeSystem(catalogue, workspace=workspace, filled=filled)

    return _shapes(name, values, HEXAGONS, build)


def _squares(name: str, values: Values) -> Scene:
    """Build squares in a random shape whose goal is another, or where a random walk leads."""
    longest = min(whole(values, "n", least=2) - 1, _LONGEST_RUN)
    if values["k"]:
        longest = whole(values, "k", least=0, most=_LONGEST_RUN)

    def build(filled: Sequence[Cell], box: Sequence[Cell]) -> LatticeSystem:
        return LatticeSystem(sliding_catalogue(longest), workspace=box, filled=filled)

    return _shapes(name, values, SQUARES, build)


def _shapes(name: str, values: Values, lattice: Lattice, build: _Build) -> Scene:
    count = whole(values, "n", least=2)
    seed = whole(values, "seed", least=0, most=SEED_MAX)
    density = share_of(values["density"], f"density={values['density']}", most=_DENSEST)
    draw = _way_to_draw(values["how"], count, lattice)
    start = draw(count, lattice, Stream("start shape", seed))
    moves = walk_length(values, count)
    end = start if moves is not None else draw(count, lattice, Stream("goal shape", seed))
    box = walled([*start, *end], whole(values, "box", least=1, most=_WIDEST))
    filled = _obstacles(box, {*start, *end}, density, Stream("obstacles", seed))
    system = build(filled, box)
    goal: tuple[Site, ...] = end
    if moves is not None:
        ends = walked(system, start, moves, Stream("walk", seed))
        goal = in_order(ends)
    return scene_of(name, system, start, goal)


def _way_to_draw(
    how: str, count: int, lattice: Lattice
) -> Callable[[int, Lattice, Stream], tuple[Cell, ...]]:
    if how == "growth":
        return grown_shape
    if how != "uniform":
        raise InputError(f"how={how}: expected uniform or growth")
    if count > _UNIFORM_MAX[lattice]:
        raise InputError(
            f"n={count},how=uniform: expected at most {_UNIFORM_MAX[lattice]} cells; how=growth has"
            " no such bound"
        )
    return uniform_shape


def _obstacles(
    box: Sequence[Cell], taken: set[Cell], density: Fraction, stream: Stream
) -> list[Cell]:
    """Return the obstacles: each free cell of the box with this probability."""
    if not density:
        return []
    return [cell for cell in box if happens(density, stream) and cell not in taken]


_KEYS = {
    "n": ("6", "number of modules"),
    "seed": ("1", "of all that is random"),
    "how": ("uniform", "uniform: each equally likely, to 32 hexagons or 18 squares; or growth"),
    "density": ("0", "share of the other cells that are obstacles, to 0.5"),
    "walk": WALK_KEY,
    "box": ("3", "by how many cells the box is wider than the shapes, on each side"),
}


FAMILIES = (
    *_SLIDING,
    Family(
        "hex-shapes",
        "hexagons from one random shape to another, or wherever a random walk leads",
        {
            **_KEYS,
            "catalogue": (
                "1",
                "1 keeps the topology; in a box: 2 may split, 3 has monkey moves too",
            ),
        },
        _hexagons,
        LatticeSystem,
        "leader",
    ),
    Family(
        "sliding-shapes",
        "squares from one random shape to another, or wherever a random walk leads, in a box",
        {
            **_KEYS,
            "k": ("", "longest run that slides is k + 1 cells; n - 1 when left out, all there is"),
        },
        _squares,
        LatticeSystem,
        "leader",
    ),
)
