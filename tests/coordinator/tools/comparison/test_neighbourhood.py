"""What a module senses, drawn: every place once, where the lattice has it."""

from __future__ import annotations

import pytest

from cubepath.coordinator.tools.comparison.comparing import diff
from cubepath.coordinator.tools.comparison.playing import sensed_at
from cubepath.coordinator.tools.comparison.reasons import picture_of
from cubepath.protocol.scenes.specs import scene_from_spec
from samples.twin_runs import twin


def test_hexagons_stand_in_shifted_rows() -> None:
    """The six neighbours of a cell are left and right of it and half a cell beside in rows."""
    scene = scene_from_spec("hex:n=3")
    sites = ((0, 0), (1, 0), (0, 1))
    picture = picture_of(scene.system, 0, (0, 0), sensed_at(scene.system, (0, 0), sites))
    assert picture is not None
    assert picture.splitlines() == [
        "     .   .   .",
        "   .   .   2   .",
        " .   .  (0)  1   .",
        "   .   .   .   .",
        "     .   .   .",
    ]


def test_maps_count_downwards_and_have_walls() -> None:
    """A vehicle in a corner of a map senses the cells that there are."""
    scene = scene_from_spec("agv:graph=grid3x3,n=2")
    sites = ((0, 0), (0, 1))
    picture = picture_of(scene.system, 0, (0, 0), sensed_at(scene.system, (0, 0), sites))
    assert picture == "(0)  .\n 1"


def test_obstacles_and_wide_numbers() -> None:
    """An occupied obstacle is #, and columns are as wide as the widest number."""
    scene = scene_from_spec("sliding:p=3,q=2")
    own = scene.start[0]
    place = scene.system.place_of(own)
    near = [each for each in scene.system.sensed(place) if each is not None]
    sensed = sensed_at(scene.system, own, scene.start)
    picture = picture_of(scene.system, 0, own, sensed)
    assert picture is not None
    marks = picture.split()
    assert len(marks) == len({*near, place})
    assert marks.count("#") == sum(what in ("filled", "closed") for what in sensed.values())
    assert marks.count("(0)") == 1


@pytest.mark.parametrize("spec", ["arm:n=4", "agv:graph=K5,n=3"])
def test_other_places_are_not_drawn(spec: str) -> None:
    """Edges of a lattice and vertices of a graph are no cells."""
    scene = scene_from_spec(spec)
    sensed = sensed_at(scene.system, scene.start[0], scene.start)
    assert picture_of(scene.system, 0, scene.start[0], sensed) is None


def test_both_are_drawn_side_by_side() -> None:
    """In the answer for people, below the reasons, each in its column."""
    found = diff(twin("hex:n=5", seed=1), twin("hex:n=5", seed=2))
    assert found.choice is not None
    one, two = found.choice.a.picture, found.choice.b.picture
    assert one is not None
    assert two is not None
    lines = str(found).splitlines()
    first = next(n for n, line in enumerate(lines) if line.startswith("  around it")) + 1
    rows = lines[first : first + len(one.splitlines())]
    assert [row[16:54].rstrip() for row in rows] == one.splitlines()
    assert [row[56:].rstrip() for row in rows] == two.splitlines()
