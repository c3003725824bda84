"""Coordinates: where places lie, in lengths of a move, as far as a system knows."""

from collections.abc import Sequence

import pytest

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import FAR
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.systems.listed import TabledSystem

PATH = [
    Move(Action(ends, ends, ends[:1], ends[1:]), "go", ends[0], (ends,))
    for ends in ((0, 1), (1, 3))
]


@pytest.mark.parametrize(
    ("spec", "place", "coordinates"),
    [
        ("hex:n=3", (-4, 5), (-4, 5)),
        ("arm:n=3", (7, -2, 1), (7, -2)),
        ("agv:graph=grid3x3,n=2", (2, 1), (2, 1)),
        ("agv:graph=C5,n=2", 3, ()),
        ("words", 0, ()),
        ("assembly", (0, 0), ()),
        ("polygon", (0, 2), ()),
    ],
)
def test_a_place_lies_where_its_name_says(
    spec: str, place: Site, coordinates: tuple[int, ...]
) -> None:
    """Cells and edges of a lattice, vertices of a map; nothing elsewhere, or where nobody moves."""
    system = scene_from_spec(spec).system
    assert system.coordinates(place) == coordinates
    assert system.dimension == len(coordinates)


@pytest.mark.parametrize(
    ("positions", "dimension"),
    [
        ((1e9, 1e9 + 1, 1e9 + 2), 2),
        ((1e12, 1e12 + 1, 1e12 + 2), 0),
        ((-1e12, 0.0, 1e12), 2),
        ((-1.7e308, 0.0, 1.7e308), 0),
    ],
)
def test_places_that_are_too_far_off_tell_no_way(
    positions: Sequence[float], dimension: int
) -> None:
    """Counted in moves, coordinates are no greater than what an observation can hold."""
    spots: dict[Site, tuple[float, float]] = {
        place: (x, 0.0) for place, x in zip((0, 1, 3), positions, strict=True)
    }
    system = TabledSystem(PATH, drawing="graph", positions=spots)
    assert system.dimension == dimension
    assert all(len(system.coordinates(place)) == dimension for place in spots)
    assert all(abs(x) < FAR for place in spots for x in system.coordinates(place))


def test_a_map_that_is_too_far_off_tells_no_way() -> None:
    """Its vertices may lie anywhere, but then not as far as observations can hold."""
    for x, dimension in ((FAR - 1, 2), (FAR, 0)):
        edge = (x - 1, 0), (x, 0)
        assert GraphSystem(edge, [edge], compass=True).dimension == dimension
