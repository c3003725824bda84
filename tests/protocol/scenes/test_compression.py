"""The moves of the compression chain, against the paper's definition and known numbers."""

from collections import deque
from collections.abc import Iterable, Iterator
from itertools import combinations

import pytest

from cubepath.protocol.core.actions import apply
from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, HEXAGONS, Cell
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.families.compression import has_holes
from cubepath.protocol.scenes.specs import scene_from_spec

Shape = frozenset[Cell]
WHOLE = {2: 3, 3: 11, 4: 44, 5: 186, 6: 813}
"""Fixed hexagonal shapes without holes: of the 814 with six cells the ring is missing."""
SYSTEM = scene_from_spec("compression:n=2").system


def around(cell: Cell) -> set[Cell]:
    return {(cell[0] + q, cell[1] + r) for q, r in HEX_DIRECTIONS}


def component(cells: Iterable[Cell], start: Cell) -> Shape:
    """Return the cells that a path through `cells` leads to."""
    rest, found = set(cells), {start}
    queue = deque([start])
    while queue:
        for cell in around(queue.popleft()) & rest - found:
            found.add(cell)
            queue.append(cell)
    return frozenset(found)


def is_connected(cells: Shape) -> bool:
    return not cells or component(cells, next(iter(cells))) == cells


def surrounds_something(cells: Shape) -> bool:
    """Tell whether a flood from outside leaves free cells dry."""
    low, high = min(map(min, cells)) - 1, max(map(max, cells)) + 1
    box = frozenset((q, r) for q in range(low, high + 1) for r in range(low, high + 1))
    return component(box - cells, (low, low)) != box - cells


def moved(cells: Shape, here: Cell, there: Cell) -> Shape:
    return cells - {here} | {there}


def at_origin(cells: Iterable[Cell]) -> Shape:
    cells = list(cells)
    q, r = min(cell[0] for cell in cells), min(cell[1] for cell in cells)
    return frozenset((cell[0] - q, cell[1] - r) for cell in cells)


def by_the_paper(cells: Shape, here: Cell, there: Cell) -> bool:
    """Return whether the chain allows a move, as the paper puts it: five neighbours, 1 or 2."""
    own, other = around(here) & cells, around(there) & cells - {here}
    shared, near = own & other, own | other
    if len(own) == 5:
        return False
    if shared:
        return all(len(component(near, cell) & shared) == 1 for cell in near)
    return all(found and is_connected(frozenset(found)) for found in (own, other))


def steps(cells: Shape) -> Iterator[tuple[Cell, Cell]]:
    """Yield the moves of the system at a state."""
    for cell in sorted(cells):
        for move in SYSTEM.moves(cell):
            if move is not None and move.possible(cells):
                there = HEXAGONS.check(move.target)
                assert apply(move.action, cells) == moved(cells, cell, there)
                yield cell, there


def reachable(count: int) -> set[Shape]:
    start = at_origin((position, 0) for position in range(count))
    found, queue = {start}, deque([start])
    while queue:
        shape = queue.popleft()
        for here, there in steps(shape):
            other = at_origin(moved(shape, here, there))
            if other not in found:
                found.add(other)
                queue.append(other)
    return found


def test_there_are_104_patterns_in_each_of_three_directions() -> None:
    """The catalogue has 312 generators, and none lets a module leave five neighbours behind."""
    generators = SYSTEM.catalogue.generators if SYSTEM.catalogue is not None else ()
    assert len(generators) == 3 * 104
    for each in generators:
        assert len(each.support) == 10
        for state, end in ((each.before, each.trace[0]), (each.after, each.trace[1])):
            assert len(around(end) & set(state)) < 5


def test_the_moves_are_those_of_the_paper() -> None:
    """At a module with any ring around an edge, exactly what properties 1 and 2 allow is legal."""
    here = (0, 0)
    for there in HEX_DIRECTIONS[:3]:
        ring = sorted((around(here) | around(there)) - {here, there})
        for size in range(len(ring) + 1):
            for on in combinations(ring, size):
                cells = frozenset((here, *on))
                legal = any(
                    move is not None and move.target == there and move.possible(cells)
                    for move in SYSTEM.moves(here)
                )
                assert legal == by_the_paper(cells, here, there)


@pytest.mark.parametrize(
    "count",
    [
        2,
        3,
        pytest.param(4, marks=pytest.mark.slow),
        pytest.param(5, marks=pytest.mark.slow),
        pytest.param(6, marks=pytest.mark.thorough),
    ],
)
def test_all_whole_shapes_and_no_others_are_reached(count: int) -> None:
    """From the line every connected shape without holes is reached, and nothing else."""
    found = reachable(count)
    assert len(found) == WHOLE[count]
    assert all(is_connected(shape) and not surrounds_something(shape) for shape in found)


@pytest.mark.parametrize("seed", range(1, 4))
def test_random_starts_have_no_holes(seed: int) -> None:
    """A start that is drawn is connected and without holes, and another seed draws another."""
    starts = [
        frozenset(scene_from_spec(f"compression:n=14,start=random,seed={each}").start_state)
        for each in (seed, seed + 1)
    ]
    start = frozenset(HEXAGONS.check(cell) for cell in starts[0])
    assert is_connected(start)
    assert not surrounds_something(start)
    assert starts[0] != starts[1]


def test_holes_are_counted() -> None:
    """The ring of six has a hole; filled, or with a gap, it has none."""
    ring = frozenset(HEX_DIRECTIONS)
    assert has_holes(ring)
    assert not has_holes(ring | {(0, 0)})
    assert not has_holes(ring - {(1, 0)})


@pytest.mark.parametrize(
    ("spec", "says"),
    [
        ("compression:n=33,start=random", "n=33,start=random: expected at most 32 cells"),
        ("compression:start=ring", "start=ring: expected line or random"),
        ("compression:n=1", "n=1: expected a whole number of at least 2, at most 100000"),
    ],
)
def test_what_cannot_be_is_refused(spec: str, says: str) -> None:
    """A bad value is named in one line."""
    with pytest.raises(InputError, match=says):
        scene_from_spec(spec)
