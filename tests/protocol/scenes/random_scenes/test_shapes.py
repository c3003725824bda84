"""Random shapes: connected, of their size, and uniform by an exact account and by counting."""

from collections import Counter
from collections.abc import Callable
from fractions import Fraction
from itertools import count as numbers

import pytest

from chances import as_chance_has_it
from cubepath.protocol.core.actions import apply
from cubepath.protocol.core.catalogue import HEXAGONS, Cell
from cubepath.protocol.scenes.random_scenes import (
    FOUR,
    SIX,
    Stream,
    grown_once,
    grown_shape,
    uniform_shape,
)
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles.complexes import actions_at

COUNTS = {SIX: (1, 3, 11, 44, 186, 814), FOUR: (1, 2, 6, 19, 63, 216)}
"""Fixed polyhexes and polyominoes by their number of cells (OEIS A001207, A001168)."""
Shape = tuple[Cell, ...]


def moved(cells: Shape) -> Shape:
    """Return the shape with its least column and row at 0."""
    q, r = min(cell[0] for cell in cells), min(cell[1] for cell in cells)
    return tuple(sorted((cell[0] - q, cell[1] - r) for cell in cells))


def all_shapes(size: int, beside: tuple[Cell, ...]) -> set[Shape]:
    """Return all shapes of a size, the obvious way: one cell more, wherever it can be."""
    found: set[Shape] = {((0, 0),)}
    for _ in range(size - 1):
        found = {
            moved((*shape, (q + along, r + up)))
            for shape in found
            for q, r in shape
            for along, up in beside
            if (q + along, r + up) not in shape
        }
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


def account(size: int, beside: tuple[Cell, ...], most: int) -> dict[Shape, Fraction]:
    """Return the exact probability of each outcome of one try, over all answers of the stream."""
    found: dict[Shape, Fraction] = Counter()  # type: ignore[assignment]
    waiting: list[tuple[tuple[int, ...], Fraction]] = [((), Fraction(1))]
    while waiting:
        answers, share = waiting.pop()
        try:
            shape = grown_once(size, beside, most, Told(answers))
        except EOFError:
            waiting += [((*answers, 0), share / 3), ((*answers, 1), share * 2 / 3)]
        else:
            if shape is not None:
                found[shape] += share
    return found


@pytest.mark.parametrize(
    ("size", "beside", "extra"), [(1, SIX, 4), (2, SIX, 4), (3, SIX, 4), (3, FOUR, 2), (4, FOUR, 2)]
)
def test_each_shape_at_each_of_its_cells_is_exactly_as_likely(
    size: int, beside: tuple[Cell, ...], extra: int
) -> None:
    """Over all answers of the stream, with their probabilities as fractions: no estimate."""
    most = 2 * size + extra
    found = account(size, beside, most)
    assert set(found.values()) == {Fraction(1, 3) ** (size - 1) * Fraction(2, 3) ** most}
    assert {moved(shape) for shape in found} == all_shapes(size, beside)
    assert len(found) == size * COUNTS[beside][size - 1]


@pytest.mark.parametrize(("beside", "extra"), [(SIX, 4), (FOUR, 2)])
def test_no_shape_has_more_cells_beside_it_than_a_line(
    beside: tuple[Cell, ...], extra: int
) -> None:
    """The bound that the uniform way rests on, over all shapes to six cells."""
    for size in range(1, 7):
        around = [
            len({(q + a, r + b) for q, r in shape for a, b in beside} - set(shape))
            for shape in all_shapes(size, beside)
        ]
        assert len(around) == COUNTS[beside][size - 1]
        assert max(around) == 2 * size + extra


@pytest.mark.slow
@pytest.mark.parametrize(
    ("beside", "size"),
    [
        (SIX, 4),
        pytest.param(SIX, 5, marks=pytest.mark.nightly),
        pytest.param(FOUR, 5, marks=pytest.mark.nightly),
    ],
)
def test_shapes_come_about_as_often_as_one_another(beside: tuple[Cell, ...], size: int) -> None:
    """Twenty of each, from one seed after another: each is as frequent as chance has it."""
    shapes = all_shapes(size, beside)
    found = Counter(
        moved(uniform_shape(size, beside, Stream("start shape", seed)))
        for seed in range(20 * len(shapes))
    )
    assert found.keys() <= shapes
    assert as_chance_has_it([found[shape] for shape in shapes], 20)


@pytest.mark.parametrize("beside", [SIX, FOUR])
@pytest.mark.parametrize("size", [1, 2, 7, 12])
def test_shapes_are_connected_and_hold_the_origin(beside: tuple[Cell, ...], size: int) -> None:
    """Either way of drawing, for several seeds."""
    for seed, draw in zip(numbers(), (uniform_shape, grown_shape) * 3, strict=False):
        shape = draw(size, beside, Stream("shape", seed))
        assert len(set(shape)) == size
        assert shape == tuple(sorted(shape))
        left, waiting = set(shape) - {(0, 0)}, [(0, 0)]
        for q, r in waiting:
            near = {(q + along, r + up) for along, up in beside} & left
            left -= near
            waiting += near
        assert (0, 0) in shape
        assert not left


def test_growth_prefers_compact_shapes() -> None:
    """Of the 8 cells beside two hexagons 2 make a triangle; of the 11 shapes of three 2 are one."""
    triangles = {moved(((0, 0), (1, 0), (0, 1))), moved(((1, 0), (0, 1), (1, 1)))}

    def share(draw: Callable[[int, tuple[Cell, ...], Stream], Shape]) -> int:
        return sum(moved(draw(3, SIX, Stream("shape", seed))) in triangles for seed in range(1100))

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
    left = all_shapes(size, SIX)
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
