"""Random shapes: connected, of their size, and uniform by an exact account and by counting."""

from collections import Counter
from collections.abc import Callable
from fractions import Fraction
from itertools import count as numbers, product
from operator import sub

import pytest

from chances import as_chance_has_it
from cubepath.protocol.core.actions import apply
from cubepath.protocol.core.catalogue import CUBES, DODECAHEDRA, HEXAGONS, SQUARES, Cell, Lattice
from cubepath.protocol.scenes.random_scenes import Stream, grown_once, grown_shape, uniform_shape
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles.complexes import actions_at
from oracles.touching import pieces, touching

COUNTS = {
    HEXAGONS: (1, 3, 11, 44, 186, 814),
    SQUARES: (1, 2, 6, 19, 63, 216),
    CUBES: (1, 3, 15, 86, 534),
    DODECAHEDRA: (1, 6, 50, 475),
}
"""Fixed polyhexes, polyominoes and polycubes by their number of cells (OEIS A001207, A001168,
A001931); those of the face-centred cubic lattice, by a search like `all_shapes`."""
Shape = tuple[Cell, ...]


def moved(cells: Shape) -> Shape:
    """Return the shape with its first cell at the origin."""
    return tuple(sorted(tuple(map(sub, cell, min(cells))) for cell in cells))


def around(lattice: Lattice, shape: Shape) -> set[Cell]:
    """Return the cells that touch a shape."""
    return set().union(*(touching(lattice, cell) for cell in shape)) - {*shape}


def all_shapes(size: int, lattice: Lattice) -> set[Shape]:
    """Return all shapes of a size, the obvious way: one cell more, wherever it can be."""
    found: set[Shape] = {((0,) * lattice.arity,)}
    for _ in range(size - 1):
        found = {moved((*shape, cell)) for shape in found for cell in around(lattice, shape)}
    return found


class Told(Stream):
    """A stream that says what it is told: 0 or 1 for each question, until it has no more."""

    def __init__(self, answers: tuple[int, ...]) -> None:
        super().__init__("told", 0)
        self.answers = list(answers)

    def below(self, limit: int) -> int:
        assert limit == 3
        if not self.answers:
            raise EOFError
        return self.answers.pop(0)


def account(size: int, lattice: Lattice, most: int) -> dict[Shape, Fraction]:
    """Return the exact probability of each outcome of one try, over all answers of the stream."""
    found: dict[Shape, Fraction] = Counter()  # type: ignore[assignment]
    waiting: list[tuple[tuple[int, ...], Fraction]] = [((), Fraction(1))]
    while waiting:
        answers, share = waiting.pop()
        try:
            shape = grown_once(size, lattice, most, Told(answers))
        except EOFError:
            waiting += [((*answers, 0), share / 3), ((*answers, 1), share * 2 / 3)]
        else:
            if shape is not None:
                found[shape] += share
    return found


@pytest.mark.parametrize(
    ("size", "lattice"),
    [(1, HEXAGONS), (2, HEXAGONS), (3, HEXAGONS), (3, SQUARES), (4, SQUARES), (2, CUBES)],
)
def test_each_shape_at_each_of_its_cells_is_exactly_as_likely(size: int, lattice: Lattice) -> None:
    """Over all answers of the stream, with their probabilities as fractions: no estimate."""
    most = len(around(lattice, straight(size, lattice)))
    found = account(size, lattice, most)
    assert set(found.values()) == {Fraction(1, 3) ** (size - 1) * Fraction(2, 3) ** most}
    assert {moved(shape) for shape in found} == all_shapes(size, lattice)
    assert len(found) == size * COUNTS[lattice][size - 1]


def straight(size: int, lattice: Lattice) -> Shape:
    """Return a line along the first contact."""
    return tuple(tuple(step * x for x in lattice.contacts[0][1]) for step in range(size))


@pytest.mark.slow
@pytest.mark.parametrize("lattice", COUNTS)
def test_no_shape_has_more_cells_beside_it_than_a_line(lattice: Lattice) -> None:
    """The bound that the uniform way rests on, over all shapes of some cells, which are known."""
    for size, count in enumerate(COUNTS[lattice][:5], 1):
        found = [len(around(lattice, shape)) for shape in all_shapes(size, lattice)]
        assert len(found) == count
        assert max(found) == len(around(lattice, straight(size, lattice)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lattice", "size"),
    [
        (HEXAGONS, 4),
        pytest.param(HEXAGONS, 5, marks=pytest.mark.nightly),
        pytest.param(SQUARES, 5, marks=pytest.mark.nightly),
    ],
)
def test_shapes_come_about_as_often_as_one_another(lattice: Lattice, size: int) -> None:
    """Twenty of each, from one seed after another: each is as frequent as chance has it."""
    shapes = all_shapes(size, lattice)
    found = Counter(
        moved(uniform_shape(size, lattice, Stream("start shape", seed)))
        for seed in range(20 * len(shapes))
    )
    assert found.keys() <= shapes
    assert as_chance_has_it([found[shape] for shape in shapes], 20)


@pytest.mark.parametrize(
    ("lattice", "size"),
    [*product((HEXAGONS, SQUARES), (1, 2, 7, 12)), *product((CUBES, DODECAHEDRA), (1, 2, 4))],
)
def test_shapes_are_connected_and_hold_the_origin(lattice: Lattice, size: int) -> None:
    """Either way of drawing, for several seeds."""
    for seed, draw in zip(numbers(), (uniform_shape, grown_shape) * 3, strict=False):
        shape = draw(size, lattice, Stream("shape", seed))
        assert len(set(shape)) == size
        assert shape == tuple(sorted(shape))
        assert (0,) * lattice.arity in shape
        assert pieces(lattice, {*shape}) == 1


def test_growth_prefers_compact_shapes() -> None:
    """Of the 8 cells beside two hexagons 2 make a triangle; of the 11 shapes of three 2 are one."""
    triangles = {moved(((0, 0), (1, 0), (0, 1))), moved(((1, 0), (0, 1), (1, 1)))}

    def share(draw: Callable[[int, Lattice, Stream], Shape]) -> int:
        return sum(
            moved(draw(3, HEXAGONS, Stream("shape", seed))) in triangles for seed in range(1100)
        )

    # Four standard deviations about 1100 / 4 and 1100 * 2 / 11.
    assert 217 < share(grown_shape) < 333
    assert 148 < share(uniform_shape) < 252


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "parts"),
    [
        (3, [11]),
        (5, [186]),
        pytest.param(6, [813, 1], marks=pytest.mark.nightly),
        pytest.param(7, [3585, 27, 27, 12, 1], marks=pytest.mark.nightly),
    ],
)
def test_which_shapes_of_hexagons_reach_one_another(size: int, parts: list[int]) -> None:
    """With catalogue 1, up to translation: all to five, and from six on not quite all."""
    scene = scene_from_spec(f"hex:n={size}")
    left = all_shapes(size, HEXAGONS)
    found = []
    while left:
        part = [left.pop()]
        for shape in part:
            for action in actions_at(scene, frozenset(shape)):
                there = moved(tuple(map(HEXAGONS.check, apply(action, frozenset(shape)))))
                if there in left:
                    left.remove(there)
                    part.append(there)
        found.append(len(part))
    assert sorted(found, reverse=True) == parts
