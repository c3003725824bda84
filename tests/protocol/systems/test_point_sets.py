"""Point sets of the plane: geometry is exact, at any size and where points are collinear."""

from itertools import combinations
from math import comb

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.families.triangulations import polygon_points, random_points
from cubepath.protocol.systems.flips import all_quadrilaterals
from cubepath.protocol.systems.point_sets import SWEEPS, Point, PointSet
from oracles.point_grids import between, meet, on_grid, turn


@pytest.mark.slow
@given(on_grid(9))
def test_quadrilaterals_by_their_definition(points: list[Point]) -> None:
    """Those that turn left at every corner, or right, and hold no other point; each once."""
    expected = set()
    for four in combinations(range(len(points)), 4):
        a, *rest = four
        for b, c, d in (rest, [rest[0], rest[2], rest[1]], [rest[1], rest[0], rest[2]]):
            p = [points[k] for k in (a, b, c, d)]
            turns = {turn(p[k - 2], p[k - 1], p[k]) for k in range(4)}
            sign = turns.pop()
            if turns or sign == 0:
                continue
            inside = [
                point
                for point in points
                if point not in p and all(turn(p[k - 1], p[k], point) * sign >= 0 for k in range(4))
            ]
            if not inside:
                expected.add(four)
    found = [each.corners for each in all_quadrilaterals(PointSet(points))]
    assert set(found) == expected
    assert len(found) == len(expected)
    plane = PointSet(points)
    for four in combinations(range(len(points)), 4):
        assert (plane.why_no_flip(four) is None) == (four in expected)


@given(on_grid(9), st.sampled_from(sorted(SWEEPS)))
def test_a_sweep_is_a_triangulation(points: list[Point], direction: str) -> None:
    """Its edges pass through no point, do not meet, hold the hull, and are as many as can be."""
    plane = PointSet(points)
    edges = plane.sweep(direction)
    for a, b in edges:
        assert not any(between(points[a], points[b], c) for c in points)
    assert not any(meet(points, one, other) for one, other in combinations(edges, 2))
    assert plane.hull <= edges
    assert len(edges) == 3 * len(points) - 3 - len(plane.hull)


@given(on_grid(7))
def test_edges_that_cross(points: list[Point]) -> None:
    """Edges through no point cross iff they meet in more than a corner, not their lines alone."""
    plane = PointSet(points)
    edges = [e for e in combinations(range(len(points)), 2) if not plane.on_the_way(*e)]
    for edge in edges:
        others = [other for other in edges if other != edge]
        expected = [meet(points, edge, other) for other in others]
        assert plane.crossings(edge, np.array(others)).tolist() == expected


def test_sweeps_go_different_ways() -> None:
    """The default start and goal of random points differ."""
    assert len({PointSet(random_points(12, 1)).sweep(way) for way in SWEEPS}) == 4


def test_no_rounding() -> None:
    """Beside a line by one unit in 10^30 is not on it, at any size."""
    far = 10**30
    points = [(0, 0), (far, far), (2 * far, 2 * far - 1), (far, -far)]
    assert [each.corners for each in all_quadrilaterals(PointSet(points))] == [(0, 1, 2, 3)]
    straight = [*points[:2], (2 * far, 2 * far), points[3]]
    assert all_quadrilaterals(PointSet(straight)) == ()


def test_polygons_are_convex() -> None:
    """Every four corners of a polygon on whole numbers can flip, up to the largest."""
    for count in (*range(4, 12), 40):
        p = polygon_points(count)
        assert all(turn(p[k - 2], p[k - 1], p[k]) > 0 for k in range(count))
    assert len(all_quadrilaterals(PointSet(polygon_points(12)))) == comb(12, 4)


@pytest.mark.slow
@pytest.mark.thorough
def test_too_many_flips_are_refused() -> None:
    """Many points in convex position have more flips than a list should hold."""
    with pytest.raises(InputError, match="more than 200000 flips among 60 points"):
        _ = all_quadrilaterals(PointSet(polygon_points(60)))
