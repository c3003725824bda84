"""A plan for hexagons with monkey moves, from any connected shape to any other.

Source: Akitaya and others (SoCG 2021; the title is in ``hexagons-3.toml``) go by way of a straight
chain, and so does this plan. How modules come free is found by search here.

1. The start becomes a chain that rises from its highest cell. One after another, a module without
   which the rest is connected walks along the others to the end of the chain.
2. The goal becomes a chain that falls from its lowest cell; this part is reversed.
3. From chain to chain the last module walks to the front, until all have passed.

*Walks.* A module with three free cells in a row beside it can turn about the module before these:
in a pivot, or in a monkey move if another module is in the way. At its new place it has such a gap
again, and each move can be undone, so it walks in a circle along the others. A module at a corner
of the convex hull has a gap, and its circle leads around the aggregate, to the end of the chain.

*When the rest falls apart without any corner.* Then modules walk to other places, in a search in
breadth over shapes, until one that can reach the end of the chain comes free. The authors prove
that O(n^2) moves suffice for each module, so O(n^3) in all. The search here is exhaustive up to
`_SHAPES` shapes and then gives up, so it has no such bound. It was never needed for shapes of up to
7 modules, nor for random ones of up to 30: they take O(n) moves for each module, O(n^2) in all.
"""

from collections import deque
from collections.abc import Mapping, Sequence

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import HEXAGONS, Catalogue, Cell, GeneratorPlacement, Move
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.path_files.moves import PathMove
from cubepath.protocol.scenes.built_in_pages import page_catalogue

_SHAPES = 1_000
"""The search for a module that comes free looks at this many shapes."""
Shape = frozenset[Cell]


def hexagon_plan(scene: Scene) -> list[PathMove]:
    """Return moves in order from the start of a scene with monkey moves to its goal.

    The aggregate is connected after each move. InputError if the scene has another catalogue or
    obstacles, if its start or goal is not connected, or if its box has no room for the chains;
    CheckError if the search gives up.

    >>> scene = scene_from_spec("hex-shapes:n=6,catalogue=3,box=9")
    >>> plan = hexagon_plan(scene)
    >>> write_moves("plan.jsonl", plan)
    """
    system, (start, goal) = scene.system, _task(scene)
    # A chain that rises from the start is above one that falls from the goal, or else mirrored.
    way = 1 if max(r for _, r in start) >= min(r for _, r in goal) else -1
    there, rising = _gathered(system, start, way)
    back, falling = _gathered(system, goal, -way)
    line = [*rising[:0:-1], *_between(rising[0], falling[0], way), *falling[1:]]
    across = _passed(system, line, len(start))
    return [
        *(_path_move(move, move.source) for move in (*there, *across)),
        *(_path_move(move, move.target) for move in reversed(back)),
    ]


def _task(scene: Scene) -> tuple[Shape, Shape]:
    """Return the start and the goal; InputError as above."""
    found = scene.system.catalogue
    if (
        found is None
        or found.lattice != HEXAGONS
        or _actions(found) != _actions(page_catalogue("hexagons-3"))
    ):
        raise InputError(f"{scene.spec}: expected hexagons with monkey moves (catalogue=3)")
    if scene.system.filled or scene.system.empty or not scene.goal:
        raise InputError(f"{scene.spec}: expected a goal, and no obstacles")
    start, goal = (frozenset(map(HEXAGONS.check, sites)) for sites in (scene.start, scene.goal))
    for name, shape in (("start", start), ("goal", goal)):
        if HEXAGONS.pieces(shape) != 1:
            raise InputError(f"{scene.spec}: the {name} is not connected")
    return start, goal


def _actions(catalogue: Catalogue) -> set[Action]:
    return {move.action for move in catalogue.proposals((0, 0))}


def _gathered(system: System, shape: Shape, way: int) -> tuple[list[Move], list[Cell]]:
    """Return moves that make the shape a chain, and the chain, which rises if `way` is 1."""
    order = sorted(shape, key=lambda cell: (way * cell[1], way * cell[0]))
    chain, moves = order[-1:], list[Move]()
    while len(chain) < len(shape):
        end = (chain[0][0], chain[0][1] + way * len(chain))
        steps = _freed(system, shape, chain, end)
        for move in steps:
            shape = shape - {HEXAGONS.check(move.source)} | {HEXAGONS.check(move.target)}
        moves += steps
        chain.append(end)
    return moves, chain


def _freed(system: System, shape: Shape, chain: Sequence[Cell], end: Cell) -> list[Move]:
    """Return moves of modules outside the chain, the last of which brings one to the end cell."""
    _check_room(system, end)
    todo, seen = deque[tuple[Shape, list[Move]]]([(shape, [])]), {shape}
    while todo and len(seen) < _SHAPES:
        now, made = todo.popleft()
        # The module that is farthest from the chain comes first: it is at a corner.
        for cell in sorted(now.difference(chain), key=lambda cell: (abs(cell[1] - end[1]), cell))[
            ::-1
        ]:
            others = now - {cell}
            if HEXAGONS.pieces(others) != 1:
                continue
            found = _walks(system, others, cell)
            if end in found:
                return made + _walk(found, end)
            for there in found:
                after = others | {there}
                if after not in seen:
                    seen.add(after)
                    todo.append((after, made + _walk(found, there)))
    raise CheckError(f"no module came free for {end} in {len(seen)} shapes, expected one")


def _check_room(system: System, cell: Cell) -> None:
    """Raise InputError if modules cannot walk around a cell: they need two cells on each side."""
    if not all(system.has_place((cell[0] + q, cell[1] + r)) for q in (-2, 2) for r in (-2, 2)):
        raise InputError(f"no room for a chain at {cell}, expected a wider box")


def _walks(system: System, others: Shape, start: Cell) -> dict[Cell, Move | None]:
    """Return the cells to which a module can go along the others, and the last move to each."""
    found: dict[Cell, Move | None] = {start: None}
    todo = deque([start])
    while todo:
        here = todo.popleft()
        state = others | {here}
        for move in system.moves(here):
            if move is not None and move.possible(state):
                there = HEXAGONS.check(move.target)
                if there not in found:
                    found[there] = move
                    todo.append(there)
    return found


def _walk(walks: Mapping[Cell, Move | None], end: Cell) -> list[Move]:
    """Return the moves to a cell, in order."""
    found: list[Move] = []
    while (move := walks[end]) is not None:
        found.append(move)
        end = HEXAGONS.check(move.source)
    return found[::-1]


def _between(first: Cell, last: Cell, way: int) -> list[Cell]:
    """Return a line of cells from the end of one chain to that of the other, both included."""
    found = [first]
    while (here := found[-1]) != last:
        across = last[0] - here[0]
        if here[1] == last[1]:
            step = (1 if across > 0 else -1, 0)
        else:
            step = (way, -way) if way * across > 0 else (0, -way)
        found.append((here[0] + step[0], here[1] + step[1]))
    return found


def _passed(system: System, line: Sequence[Cell], count: int) -> list[Move]:
    """Return moves by which a chain of modules passes along a line from one end to the other."""
    moves: list[Move] = []
    for place, end in enumerate(line[count:]):
        _check_room(system, end)
        last, *others = line[place : place + count]
        walks = _walks(system, frozenset(others), last)
        if end not in walks:
            raise InputError(f"no room to walk from {last} to {end}, expected a wider box")
        moves += _walk(walks, end)
    return moves


def _path_move(move: Move, source: Site) -> PathMove:
    """Return a move made from where the mover is at `source`."""
    (before,) = (end for end in move.action.ends if source in end)
    return PathMove(move.action, GeneratorPlacement(move.generator, move.at), before)
