"""Paths by their definitions, envelopes, and complexes pulled apart: small ones, by hand."""

from __future__ import annotations

from math import isclose, sqrt

from hypothesis import given
from hypothesis import strategies as st

from cubepath.coordinator.claims_geometry import corner_of_a_cube, open_box
from cubepath.coordinator.cubes import end_state, is_normal
from cubepath.coordinator.cubical import cubical_complex
from cubepath.coordinator.envelope import envelope
from cubepath.coordinator.heap import normal_cube_path
from cubepath.coordinator.pinches import without_pinches
from cubepath.coordinator.walks import closure, diagonals, geodesics, normal_cube_paths
from cubepath.protocol.actions import Action
from strategies import SCENES, scene, walks

SQUARE = cubical_complex([4, [[[0, 1]], [[2, 3]], [[0, 2]], [[1, 3]]], [[[2, 3], [0, 1]]]])


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


def test_a_box_has_a_locally_shortest_path_that_is_not_shortest() -> None:
    """Round three sides of the rim or along one: both are normal."""
    lengths = sorted(len(path) for path in normal_cube_paths(open_box(), 0, 3, most=3))
    assert lengths == [1, 3]


def test_two_squares_at_a_point_come_apart() -> None:
    """A bow tie has Euler characteristic 1; pulled apart it is two discs."""
    tie = cubical_complex(
        [
            7,
            [[[0, 1]], [[2, 3]], [[0, 2]], [[1, 3]], [[3, 4]], [[5, 6]], [[3, 5]], [[4, 6]]],
            [[[2, 3], [0, 1]], [[6, 7], [4, 5]]],
        ]
    )
    assert tie.euler == 1
    assert without_pinches(tie) == (2, True, 2)


def test_a_torus_and_a_klein_bottle_have_no_rim() -> None:
    """From one square each, glued with and without a turn."""
    assert without_pinches(cubical_complex([1, [[[0, 0]], [[0, 0]]], [[[0, 0], [1, 1]]]])) == (
        0,
        True,
        0,
    )
    assert not without_pinches(cubical_complex([1, [[[0, 0]]], [[[0, 0], [0, 0]]]]))[1]


@given(st.sampled_from(SCENES).flatmap(lambda spec: st.tuples(st.just(spec), walks(spec))))
def test_every_move_has_its_window(found: tuple[str, list[Action]]) -> None:
    """As early as the normal path, as late as the reversed one, and both are schedules."""
    spec, path = found
    start = scene(spec).start_state
    cubes = normal_cube_path(path)
    assert is_normal(cubes)
    windows = envelope(cubes)
    late: list[list[Action]] = [[] for _ in cubes]
    for place, cube in enumerate(cubes):
        for _ in cube:
            assert any(window.earliest == place + 1 for window in windows)
    for window in windows:
        assert 1 <= window.earliest <= window.latest <= len(cubes)
        assert window.action in cubes[window.earliest - 1]
        late[window.latest - 1].append(window.action)
    assert end_state(late, start) == end_state(path, start)
