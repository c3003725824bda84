"""Paths by their definitions, envelopes, and complexes pulled apart: small ones, by hand."""

from collections import Counter
from math import isclose, sqrt

from hypothesis import given, strategies as st

from cubepath.coordinator.normal_form.definitions import end_state, is_normal
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.theory.complexes.cubical_complex import complex_from_faces
from cubepath.coordinator.theory.complexes.surfaces import pulled_apart
from cubepath.coordinator.theory.paper.algorithms import latest_cubes
from cubepath.coordinator.theory.paper.curvature import (
    chains,
    closure,
    corner_of_a_cube,
    dented_disc,
    diagonals,
    geodesics,
    normal_cube_paths,
)
from cubepath.protocol.core.actions import Action, commute
from oracles.spaces import disjoint, glued, grid
from samples.strategies import SCENES, scene, walks

SQUARE = complex_from_faces([4, [[[0, 1]], [[2, 3]], [[0, 2]], [[1, 3]]], [[[2, 3], [0, 1]]]])


def test_a_square_has_one_normal_path_across() -> None:
    """Its diagonal; along two edges the second would be in the star of the first."""
    assert normal_cube_paths(SQUARE, 0, 3, most=3) == [((2, 0),)]
    assert normal_cube_paths(SQUARE, 0, 0, most=3) == [()]


def test_a_square_is_closed_with_its_edges_and_corners() -> None:
    """Nine cells, and four corners each across from another."""
    assert len(closure(SQUARE, (2, 0))) == 9
    across = {
        here: there
        for here, found in diagonals(SQUARE).items()
        for there, (k, _) in found
        if k == 2
    }
    assert across == {0: 3, 3: 0, 1: 2, 2: 1}


def test_geodesics_cut_across() -> None:
    """The diagonal of a square, and two ways round the corner of a cube."""
    length, count = geodesics(SQUARE, 0, 3)
    assert isclose(length, sqrt(2))
    assert count == 1
    length, count = geodesics(corner_of_a_cube(), 4, 3)
    assert isclose(length, sqrt(5))
    assert count == 2


def test_a_dented_disc_has_a_path_shorter_than_any_near_it() -> None:
    """Two edges, and no other way of at most two cubes in the star between; far off one of one."""
    disc = dented_disc()
    disc.check()
    assert disc.euler == 1
    edges = chains(disc, 0, 2, most=2, through=1)
    assert [[k for k, _ in path] for path in edges] == [[1, 1]]
    assert min(len(path) for path in chains(disc, 0, 2, most=2)) == 1


def test_two_squares_at_a_point_come_apart() -> None:
    """A bow tie has Euler characteristic 1; pulled apart it is two discs."""
    tie = glued(disjoint(grid(1, 1), grid(1, 1)), [(0, 3, 4)])
    assert tie.euler == 1
    found = pulled_apart(tie)
    assert found is not None
    assert found.fans == (1, 1, 1, 2, 1, 1, 1)
    assert (found.components, found.euler, found.orientable) == (2, 2, True)
    assert found.boundary_components == 2


def test_a_torus_and_a_klein_bottle_have_no_boundary() -> None:
    """From one square each, glued with and without a turn."""
    torus = pulled_apart(complex_from_faces([1, [[[0, 0]], [[0, 0]]], [[[0, 0], [1, 1]]]]))
    assert torus is not None
    assert (torus.euler, torus.orientable, torus.boundary_components) == (0, True, 0)
    turned = pulled_apart(complex_from_faces([1, [[[0, 0]]], [[[0, 0], [0, 0]]]]))
    assert turned is None  # all four sides on one edge


def test_three_pages_of_a_book_are_no_surface() -> None:
    """An edge in three squares."""
    pages = disjoint(grid(1, 1), grid(1, 1), grid(1, 1))
    assert pulled_apart(glued(pages, [(1, 0, 4), (1, 0, 8)])) is None


@given(st.sampled_from(SCENES).flatmap(lambda spec: st.tuples(st.just(spec), walks(spec))))
def test_every_move_has_its_window(found: tuple[str, list[Action]]) -> None:
    """Windows are those of the longest chains before and after each move, and both ends work."""
    spec, path = found
    start = scene(spec).start_state
    cubes = normal_cube_path(path)
    assert is_normal(cubes)
    moves = [action for cube in cubes for action in cube]
    before = [1] * len(moves)
    after = [1] * len(moves)
    for j in range(len(moves)):
        for i in range(j):
            if not commute(moves[i], moves[j]):
                before[j] = max(before[j], before[i] + 1)
    for i in reversed(range(len(moves))):
        for j in range(i + 1, len(moves)):
            if not commute(moves[i], moves[j]):
                after[i] = max(after[i], after[j] + 1)
    assert [n for n, cube in enumerate(cubes, 1) for _ in cube] == before
    late = latest_cubes(cubes)
    assert all(late)
    assert end_state(late, start) == end_state(path, start)
    due = zip(moves, (len(cubes) + 1 - count for count in after), strict=True)
    assert Counter(due) == Counter((each, n) for n, cube in enumerate(late, 1) for each in cube)
