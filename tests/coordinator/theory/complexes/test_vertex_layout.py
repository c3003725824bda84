"""Where the vertices of small complexes are drawn."""

from itertools import product

import numpy as np
import pytest

from cubepath.coordinator.theory.complexes.cubical_complex import CubicalComplex
from cubepath.coordinator.theory.complexes.exploration import explore
from cubepath.coordinator.theory.complexes.export import (
    best_view,
    corners_of_cubes,
    corners_of_squares,
    laid_out,
    maximal_cubes,
)
from cubepath.coordinator.theory.complexes.state_complexes import state_complex
from cubepath.protocol.scenes.specs import scene_from_spec


def _complex(spec: str) -> CubicalComplex:
    return state_complex(explore(scene_from_spec(spec))).complex


@pytest.mark.parametrize("spec", ["arm:n=5", "polygon:n=7", "hex-tunnel:n=2"])
def test_cubes_look_like_cubes(spec: str) -> None:
    """Where there is room for it, each maximal cube has edges of 1 and right angles, or nearly."""
    complex_ = _complex(spec)
    places = laid_out(complex_, 3)
    for dimension, corners in maximal_cubes(complex_):
        origin = places[corners[:, 0]]
        edges = np.stack(
            [places[corners[:, 1 << axis]] - origin for axis in range(dimension)], axis=1
        )
        products = np.einsum("nai,nbi->nab", edges, edges)
        assert np.abs(products - np.eye(dimension)).max() < 0.25


@pytest.mark.parametrize("spec", ["arm:n=4", "agv:graph=grid3x3,n=2", "assembly:n=3"])
def test_vertices_lie_apart_and_in_the_same_places_each_time(spec: str) -> None:
    """No two vertices coincide, in space or as they are seen, and nothing is left to chance."""
    complex_ = _complex(spec)
    places = laid_out(complex_, 3)
    assert (places == laid_out(complex_, 3)).all()
    edges = complex_.faces[1][:, 0]
    seen = best_view(places, edges)
    for points in (places, seen.places):
        apart = np.sqrt(((points[:, None] - points) ** 2).sum(axis=2))
        assert apart[~np.eye(len(points), dtype=bool)].min() > 1e-3
    assert seen.nearness.min() == 0
    assert seen.nearness.max() == 1


def test_a_view_turns_and_does_not_stretch() -> None:
    """A picture of points is their image under a rotation: with the depth, distances are kept."""
    points = np.random.default_rng(1).normal(size=(12, 3))
    seen = best_view(points, np.array([(0, 1), (2, 3)], dtype=np.int32))
    depth = seen.nearness[:, None]
    flat = ((seen.places[:, None] - seen.places) ** 2).sum(axis=2)
    solid = ((points[:, None] - points) ** 2).sum(axis=2)
    # What is missing from the squared distance is that of the depths, up to one scale.
    missing = (solid - flat)[np.triu_indices(12, 1)]
    depths = ((depth - depth.T) ** 2)[np.triu_indices(12, 1)]
    assert np.allclose(missing, depths * (missing @ depths) / (depths @ depths))
    across, up = np.ptp(seen.places, axis=0)
    assert across > up


def test_corners_differ_in_the_directions_of_a_cube() -> None:
    """Corners of which one bit differs are the ends of an edge; the ends of an edge are its own."""
    complex_ = _complex("arm:n=5")
    ends = {frozenset(edge) for edge in complex_.faces[1][:, 0].tolist()}
    for corners in corners_of_cubes(complex_, 3).tolist():
        for place, axis in product(range(8), range(3)):
            assert frozenset((corners[place], corners[place ^ 1 << axis])) in ends
    for a, b, c, d in corners_of_squares(complex_).tolist():
        assert {frozenset(pair) for pair in ((a, b), (b, c), (c, d), (d, a))} <= ends


def test_components_lie_side_by_side() -> None:
    """A complex without edges, and one of a single vertex, have a picture too."""
    lone = CubicalComplex((np.empty((3, 0, 2), dtype=np.int32),))
    places = laid_out(lone, 2)
    assert len({tuple(place) for place in places.round(6).tolist()}) == 3
    assert laid_out(CubicalComplex((np.empty((1, 0, 2), dtype=np.int32),)), 2).shape == (1, 2)
