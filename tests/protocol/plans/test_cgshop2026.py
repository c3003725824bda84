"""CG:SHOP 2026: rounds of parallel flips become flips of the system, or are refused."""

from collections.abc import Callable, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.file_forms import read_plan
from cubepath.protocol.scenes.families.triangulations import random_points
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.flips import FlipSystem, all_quadrilaterals
from cubepath.protocol.systems.point_sets import PointSet, Triangles
from oracles.cells import Cell, cell_of
from oracles.point_grids import meet
from samples.plans import DATA, actions_read, flips_2026, moves_read, save
from samples.strategies import random_walk, scene

SOLUTION, INSTANCE = DATA / "kite.solution.json", DATA / "kite.instance.json"
SQUARE = {"points_x": [0, 1, 0, 1], "points_y": [0, 0, 1, 1], "triangulations": [[[0, 3]]]}
"""The square of the format's own description; the hull's edges are left out."""


def pair(folder: Path, instance: dict[str, Any], flips: object) -> tuple[Path, Path]:
    """Save flips of one triangulation, and its instance."""
    first = {"content_type": "CGSHOP2026_Instance", "instance_uid": "test", **instance}
    second = {"content_type": "CGSHOP2026_Solution", "instance_uid": "test", "flips": [flips]}
    return save(folder / "s.json", second), save(folder / "i.json", first)


@pytest.mark.parametrize(("chosen", "moves", "cubes", "rounds"), [(0, 8, 3, 4), (1, 6, 2, 3)])
def test_the_sample_kite(chosen: int, moves: int, cubes: int, rounds: int) -> None:
    """Both paths end in one triangulation; their moves are flips of the instance as a system."""
    found = read_plan(SOLUTION, f"cgshop2026:triangulation={chosen}", companions=[INSTANCE])
    assert found is not None
    read = list(found.moves)
    assert (len(read), found.rounds) == (moves, rounds)
    assert len(normal_cube_path([move.action for move in read])) == cubes
    system = scene_from_spec(f"triangulation:points={INSTANCE}").system
    assert isinstance(system, FlipSystem)
    state = set(found.scene().start_state)
    assert set(scene_from_spec(f"triangulation:points={INSTANCE},start={chosen}").start) <= state
    for move in read:
        assert move.action == system.action("flip", move.name.at)  # type: ignore[union-attr]
        assert move.before == move.action.support & state
        state ^= move.action.trace
    if chosen:
        other = moves_read(SOLUTION, "cgshop2026:triangulation=0", companions=[INSTANCE])
        end = set(scene_from_spec(f"triangulation:points={INSTANCE},start=0").start_state)
        for move in other:
            end ^= move.action.trace
        assert state == end


@settings(max_examples=15, deadline=None)
@given(
    st.integers(0, 10**6), st.integers(0, 12), st.sampled_from(["polygon:n=8", "triangulation:n=9"])
)
def test_flips_read_back_are_the_path(
    tmp_path_factory: pytest.TempPathFactory, seed: int, length: int, spec: str
) -> None:
    """A random walk as rounds of flips gives the normal cube path of the walk itself."""
    where = scene(spec)
    system = where.system
    assert isinstance(system, FlipSystem)
    word = random_walk(spec, length, seed)
    x, y = zip(*system.plane.points, strict=True)
    instance = {
        "points_x": x,
        "points_y": y,
        "triangulations": [sorted(where.start_state, key=repr)],
    }
    flips = flips_2026(word, where.start_state)
    solution, saved = pair(tmp_path_factory.mktemp("flips"), instance, flips)
    assert normal_cube_path(actions_read(solution, companions=[saved])) == normal_cube_path(word)


def test_the_hull_may_be_left_out(tmp_path: Path) -> None:
    """The square as it is published: one diagonal, and its flip."""
    solution, instance = pair(tmp_path, SQUARE, [[[3, 0]], [[1, 2]]])
    moves = moves_read(solution, companions=[instance])
    assert [move.name.at for move in moves] == [(0, 1, 2, 3)] * 2  # type: ignore[union-attr]
    assert normal_cube_path([move.action for move in moves]) == ()


BAD_FLIPS: dict[str, tuple[object, str]] = {
    "no edge": ([[[0, 3]], [[0, 3]]], "round 1, flip of [0, 3]: no edge of the triangulation at"),
    "hull": ([[[0, 1]]], "round 0, flip of [0, 1]: on the hull, with a triangle on one side only"),
    "twice": ([[[0, 3], [3, 0]]], "round 0, flip of [3, 0]: it stands twice, expected the flips"),
}


@pytest.mark.parametrize("name", BAD_FLIPS)
def test_flips_that_are_none_are_refused(tmp_path: Path, name: str) -> None:
    """The round, the edge, and why it cannot flip."""
    flips, told = BAD_FLIPS[name]
    solution, instance = pair(tmp_path, SQUARE, flips)
    with pytest.raises(InputError) as caught:
        moves_read(solution, companions=[instance])
    assert str(caught.value).startswith(f"{solution}: triangulation 0, {told}")


FIVE: dict[str, Any] = {
    "points_x": [0, 4, 5, 2, 0],
    "points_y": [0, 0, 3, 5, 3],
    "triangulations": [[[0, 2], [0, 3]]],
}
DART: dict[str, Any] = {
    "points_x": [0, 8, 4, 4],
    "points_y": [0, 0, 8, 2],
    "triangulations": [[[0, 3], [1, 3], [2, 3]]],
}


def test_flips_of_one_triangle_are_no_round(tmp_path: Path) -> None:
    """Two diagonals of a pentagon share a triangle, so they do not flip at one time."""
    solution, instance = pair(tmp_path, FIVE, [[[0, 2], [0, 3]]])
    with pytest.raises(InputError, match=r"triangle \[0, 2, 3\] is that of \[0, 2\] too"):
        moves_read(solution, companions=[instance])


def test_a_quadrilateral_that_is_not_convex_does_not_flip(tmp_path: Path) -> None:
    """The corner where it bends in is named; so is one where it is straight."""
    solution, instance = pair(tmp_path, DART, [[[2, 3]]])
    with pytest.raises(InputError, match=r"\[0, 1, 2, 3\] is not strictly convex at point 3"):
        moves_read(solution, companions=[instance])
    straight = {**DART, "points_y": [0, 0, 8, 0]}
    straight["triangulations"] = [[[2, 3]]]
    solution, instance = pair(tmp_path, straight, [[[2, 3]]])
    with pytest.raises(InputError, match="not strictly convex at point 3"):
        moves_read(solution, companions=[instance])


BAD_INSTANCES: dict[str, tuple[dict[str, Any], str]] = {
    "crossing": ({"triangulations": [[[0, 3], [1, 2]]]}, "triangulations[0]: no triangle left of"),
    "missing": ({"triangulations": [[]]}, "triangulations[0]: no triangle left of"),
    "edge": ({"triangulations": [[[0, 4]]]}, "(0, 4) is no edge between two points of 0 to 3"),
    "loop": ({"triangulations": [[[1, 1]]]}, "(1, 1) is no edge between two points"),
    "count": ({"points_x": [0, 1, 0]}, "points_x has 3 numbers, points_y 4"),
    "more": (
        {"triangulations": [[[0, 3]], [[1, 2]]]},
        "flips of 1 triangulations, the instance has 2",
    ),
    "none": ({"triangulations": []}, "flips of 1 triangulations, the instance has 0"),
    "same": ({"points_x": [0, 1, 0, 0], "points_y": [0, 0, 1, 1]}, "points 2 and 3 are the same"),
    "line": ({"points_x": [0, 1, 2, 3], "points_y": [0, 0, 0, 0]}, "all 4 points lie on one line"),
    "uid": ({"instance_uid": "other"}, "a solution of 'test', but"),
    "type": ({"content_type": "CGSHOP2025_Instance"}, "content_type is 'CGSHOP2025_Instance'"),
    "decimals": ({"points_x": [0, 1, 0, 1.5]}, "Expected `int`, got `float` - at `$.points_x[3]`"),
}


@pytest.mark.parametrize("name", BAD_INSTANCES)
def test_instances_that_are_none_are_refused(tmp_path: Path, name: str) -> None:
    """The place in the instance, and what is wrong there."""
    change, told = BAD_INSTANCES[name]
    solution, instance = pair(tmp_path, {**SQUARE, **change}, [])
    with pytest.raises(InputError) as caught:
        read_plan(solution, companions=[instance])
    assert told in str(caught.value)


def test_a_point_within_and_overlapping_edges_are_found(tmp_path: Path) -> None:
    """A point that no edge reaches, and two edges that leave one point the same way."""
    lonely = {**DART, "triangulations": [[]]}
    solution, instance = pair(tmp_path, lonely, [])
    with pytest.raises(InputError, match="no edge ends at point 3"):
        read_plan(solution, companions=[instance])
    over = {**DART, "points_y": [0, 0, 8, 4], "triangulations": [[[0, 3], [1, 3], [2, 3]]]}
    over["points_x"], over["points_y"] = [0, 8, 0, 2, 4], [0, 0, 8, 2, 4]
    over["triangulations"] = [[[0, 3], [0, 4], [1, 3], [2, 3], [3, 4]]]
    solution, instance = pair(tmp_path, over, [])
    with pytest.raises(InputError, match=r"edges \[0, 3\] and \[0, 4\] overlap"):
        read_plan(solution, companions=[instance])


def test_which_triangulation_has_to_be_said() -> None:
    """With more than one there is no default; a number that is none is refused."""
    with pytest.raises(InputError, match="2 triangulations, each with a path of its own: expected"):
        read_plan(SOLUTION, companions=[INSTANCE])
    for value in ("2", "-1", "x", "9" * 30):
        with pytest.raises(InputError, match="expected 0 to 1"):
            read_plan(SOLUTION, f"cgshop2026:triangulation={value}", companions=[INSTANCE])
    with pytest.raises(InputError, match="expected no --system"):
        read_plan(SOLUTION, companions=[INSTANCE], system="hex")


@settings(max_examples=25, deadline=None)
@given(st.integers(4, 14), st.integers(0, 10**6), st.sampled_from(["right", "left", "up", "down"]))
def test_triangles_agree_with_the_obvious(count: int, seed: int, direction: str) -> None:
    """Which edges flip, and into what, is what the listed system of the same points says."""
    points = PointSet(random_points(count, seed))
    edges = points.sweep(direction)
    triangles = Triangles(points.points, sorted(edges - points.hull))
    assert triangles.edges() == edges
    flips = {}
    for edge in sorted(edges):
        try:
            a, d, b, c = triangles.corners(edge)
        except InputError:
            continue
        flips[edge] = tuple(sorted((a, b, c, d)))
    obvious = {
        diagonal: each.corners
        for each in all_quadrilaterals(points)
        for diagonal in each.diagonals
        if diagonal in edges and each.sides <= edges
    }
    assert flips == obvious


def subsets(edges: Sequence[Cell], seed: int) -> list[Cell]:
    return [edge for number, edge in enumerate(edges) if seed >> number & 1]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**12 - 1), st.integers(0, 50))
def test_what_is_no_triangulation_is_found(seed: int, points_seed: int) -> None:
    """Of all sets of edges those are taken that do not cross and are as many as can be."""
    system = FlipSystem(random_points(6, points_seed))
    plane = system.plane
    moving = sorted({cell_of(site) for move in system.listed for site in move.action.trace})
    edges = subsets(moving, seed)
    known = [*edges, *system.kept]
    points = list(plane.points)
    crossed = any(meet(points, one, other) for one, other in combinations(known, 2))
    expected = not crossed and len(known) == len(plane.sweep("right"))

    def taken(check: Callable[[list[Cell]], object]) -> bool:
        try:
            check(edges)
        except InputError:
            return False
        return True

    assert taken(system.check_state) == expected
    assert taken(lambda edges: Triangles(plane.points, [*edges, *system.kept])) == expected
