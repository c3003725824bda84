"""Monkey moves: their supports against hexagons that turn in the plane, and what they reach."""

from collections.abc import Iterator
from itertools import product

import numpy as np
import pytest

from cubepath.agents import play
from cubepath.protocol.core.actions import admissible, apply
from cubepath.protocol.core.catalogue import HEX_DIRECTIONS, Catalogue
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.scenes.built_in_pages import page_catalogue
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem
from oracles.cells import Cell, cells_of

Turn = tuple[Cell, frozenset[Cell], frozenset[Cell]]
"""Where a module at (0, 0) comes to, the cells that hold it, and the other cells that it meets."""
Shape = frozenset[Site]
RING: Shape = frozenset(HEX_DIRECTIONS)
SIXTH = complex(0.5, 3**0.5 / 2)
CORNERS = [1j * SIXTH**k for k in range(6)]
"""The corners of the hexagon with its centre at 0."""
NEAR: list[Cell] = [(q, r) for q, r in product(range(-4, 5), repeat=2) if abs(q + r) <= 4]
CENTRES = np.array([complex(3**0.5 * (q + r / 2), 1.5 * r) for q, r in NEAR])
INSIDE = np.array(
    [
        size * (one * (1 - t / 12) + one * SIXTH * t / 12)
        for one in CORNERS
        for t in range(12)
        for size in (0, 0.4, 0.8, 0.98)
    ]
)
"""Points of a hexagon, not quite to its border."""


def cell_at(point: complex) -> Cell:
    """The cell with this centre."""
    return NEAR[int(np.argmin(abs(CENTRES - point)))]


def met(centre: complex, corner: complex, sense: int) -> frozenset[Cell]:
    """The cells that a hexagon meets while it turns by 60 degrees about one of its corners."""
    turning = np.exp(1j * sense * np.linspace(0, np.pi / 3, 16))
    points = corner + np.outer(centre + INSIDE - corner, turning).reshape(-1, 1)
    return frozenset(NEAR[k] for k in np.unique(np.argmin(abs(points - CENTRES), axis=1)))


def sharing(corner: complex) -> list[Cell]:
    """The cells with this corner."""
    return [NEAR[k] for k in np.flatnonzero(abs(abs(CENTRES - corner) - 1) < 1e-6)]


def double_turns() -> Iterator[Turn]:
    """All that a module can do in two turns of 60 degrees, about corners that others hold."""
    for first, sense in product(CORNERS, (1, -1)):
        middle = first - first * SIXTH**sense
        for second, other in product([middle + corner for corner in CORNERS], (1, -1)):
            end = cell_at(second + (middle - second) * SIXTH**other)
            off = met(0, first, sense) | met(middle, second, other)
            for pair in product(sharing(first), sharing(second)):
                if end != (0, 0) and off.isdisjoint(pair):
                    yield end, frozenset(pair), off - {(0, 0)}


def turns_of(catalogue: Catalogue) -> list[Turn]:
    """What the moves of a module at (0, 0) want on and off."""
    found: list[Turn] = []
    for move in catalogue.proposals((0, 0)):
        on = cells_of(move.action.ends[0] & move.action.ends[1])
        (target, *_), support = cells_of([move.target]), cells_of(move.action.support)
        found.append((target, frozenset(on), frozenset(support) - {(0, 0), *on}))
    return found


@pytest.mark.slow
def test_the_moves_are_all_double_turns() -> None:
    """Hexagons moved in the plane come to the same cells, and meet the cells that must be off."""
    moves = turns_of(page_catalogue("hexagons-3"))
    assert len(moves) == len(set(moves)) == 24
    assert set(moves) == set(double_turns())


def connected_after(system: LatticeSystem, shape: Shape) -> Iterator[Shape]:
    """The connected shapes to which one move leads, moved so that their least coordinates are 0."""
    for site in shape:
        for move in system.moves(site):
            if move is not None and admissible(move.action, shape):
                after = apply(move.action, shape)
                if system.legal(after):
                    yield from_zero(after)


def from_zero(shape: Shape) -> Shape:
    q, r = (min(cell[axis] for cell in cells_of(shape)) for axis in (0, 1))
    return frozenset((cell[0] - q, cell[1] - r) for cell in cells_of(shape))


def reached(catalogue: Catalogue, shape: Shape) -> set[Shape]:
    """All shapes to which moves lead that keep the aggregate connected, up to translation."""
    system = LatticeSystem(catalogue, connected=True)
    found, todo = {from_zero(shape)}, [from_zero(shape)]
    while todo:
        new = set(connected_after(system, todo.pop())) - found
        found |= new
        todo += new
    return found


SHAPES = {2: 3, 3: 11, 4: 44, 5: 186, 6: 814, 7: 3652}
"""How many connected shapes of n hexagons there are up to translation (OEIS A001207)."""


@pytest.mark.parametrize(
    "size",
    [
        2,
        3,
        4,
        5,
        pytest.param(6, marks=pytest.mark.slow),
        pytest.param(7, marks=pytest.mark.thorough),
    ],
)
def test_all_shapes_reach_one_another(size: int) -> None:
    """From the chain moves that keep the aggregate connected lead to every connected shape."""
    chain: Shape = frozenset((place, 0) for place in range(size))
    assert len(reached(page_catalogue("hexagons-3"), chain)) == SHAPES[size]


@pytest.mark.slow
def test_the_ring_opens() -> None:
    """No pivot of catalogue 1 leads from the ring of six; with catalogue 3 it becomes a chain."""
    assert reached(page_catalogue("hexagons-1"), RING) == {from_zero(RING)}
    assert frozenset((place, 0) for place in range(6)) in reached(
        page_catalogue("hexagons-3"), RING
    )


@pytest.mark.parametrize("rule", ["random", "metropolis"])
def test_a_scene_with_monkey_moves_is_played(rule: str) -> None:
    """Modules start and move in a box, and some of their moves are monkey moves."""
    scene = scene_from_spec("hex-shapes:n=9,catalogue=3,walk=60")
    assert scene.system.bounded
    played = play(scene, rule, seed=1, max_rounds=60)
    assert any(action.label.startswith("monkey") for action in played.path)


def test_chain_is_not_for_them() -> None:
    """The rule `chain` knows the first two catalogues."""
    with pytest.raises(InputError, match="chain"):
        play("hex-shapes:n=3,catalogue=3", "chain")
