"""Triangulations: flips are exact, and the complexes have the sizes that counting gives."""

import pickle
from itertools import combinations
from math import comb, factorial
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cubepath.agents.environments.world import World
from cubepath.protocol.core.actions import Action, commute, end_at
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order, site_text
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.families.triangulations import random_points, read_points
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import read_scene, scene_from_toml, scene_to_toml
from cubepath.protocol.systems import flips
from cubepath.protocol.systems.flips import FlipSystem, all_quadrilaterals
from cubepath.protocol.systems.point_sets import Point, PointSet
from oracles.complexes import actions_at, f_vector, states_of
from oracles.point_grids import all_triangulations, on_grid

GRID: list[Point] = [(x, y) for y in range(3) for x in range(3)]
DOUBLE_6: list[Point] = [(0, 0), (60, 0), (30, 60), (30, 1), (44, 30), (16, 30)]
DOUBLE_8: list[Point] = [
    *((0, 0), (60, 0), (60, 60), (0, 60)),
    *((30, 1), (59, 30), (30, 59), (1, 30)),
]
CROSSED = """{
"points_x": [0, 1, 1, 0], "points_y": [0, 0, 1, 1], "triangulations": [[[0, 2]], [[0, 2], [1, 3]]]
}"""
SIDES: list[Point] = [(0, 0), (2, 0), (4, 0), (0, 3), (0, 6), (1, 2)]


def scene_of(points: list[Point]) -> Scene:
    system = FlipSystem(points)
    return Scene("own", "", system, system.modules_of(system.plane.sweep("right")))


# The complexes.


@pytest.mark.parametrize("corners", [4, 5, 6, 7, 8])
def test_polygons_have_as_many_cubes_as_dissections(corners: int) -> None:
    """A k-cube is a dissection into triangles and k quadrilaterals (plane trees by degrees)."""
    expected = []
    for k in range((corners - 2) // 2 + 1):
        triangles, leaves = corners - 2 - 2 * k, corners - 1
        ways = factorial(leaves + triangles + k - 1)
        expected.append(ways // (factorial(leaves) * factorial(triangles) * factorial(k)))
    assert f_vector(scene_from_spec(f"polygon:n={corners}")) == expected


def test_the_hexagon_by_name() -> None:
    """The associahedron's pentagons are not filled: 14 states, 21 edges, its 3 squares alone."""
    assert f_vector(scene_from_spec("polygon:n=5")) == [5, 5]
    assert f_vector(scene_from_spec("polygon")) == [14, 21, 3]


@pytest.mark.parametrize(
    ("points", "count"),
    [
        (GRID, 64),
        (DOUBLE_6, 4),
        (DOUBLE_8, 30),
        (SIDES, None),
        (list(random_points(7, 3)), None),
        pytest.param(list(random_points(9, 5)), None, marks=pytest.mark.slow),
    ],
)
def test_the_states_are_all_triangulations(points: list[Point], count: int | None) -> None:
    """Flips reach every triangulation (Lawson), also where points are collinear, and no more.

    The 3-by-3 grid has 64. The double circle of 2h points has those of the 2h-gon without h ears.
    """
    scene = scene_of(points)
    states = set(states_of(scene))
    expected = all_triangulations(points)
    assert states == expected
    assert count in (None, len(expected))


def test_double_circles_by_inclusion_and_exclusion() -> None:
    """The counts above are those of the formula."""

    def catalan(n: int) -> int:
        return comb(2 * n, n) // (n + 1)

    for h, count in ((3, 4), (4, 30)):
        assert sum((-1) ** i * comb(h, i) * catalan(2 * h - 2 - i) for i in range(h + 1)) == count


def test_without_empty_pentagons_the_complex_is_contractible_in_numbers() -> None:
    """The grid has no empty convex pentagon (Eppstein 2010): Euler characteristic 1."""
    counts = f_vector(scene_of(GRID))
    assert counts == [64, 132, 88, 20, 1]
    assert sum((-1) ** k * count for k, count in enumerate(counts)) == 1


@pytest.mark.parametrize("spec", ["polygon:n=7", "triangulation:n=8"])
def test_flips_commute_iff_they_share_no_triangle(spec: str) -> None:
    """At a triangulation two flips commute iff no triangle lies in both quadrilaterals."""
    scene = scene_from_spec(spec)
    seen = set()
    for state in states_of(scene, 40):
        for one, other in combinations(actions_at(scene, state), 2):
            corners = [{c for edge in a.support for c in edge} for a in (one, other)]  # type: ignore[attr-defined]
            apart = len(corners[0] & corners[1]) < 3
            assert commute(one, other) == apart
            seen.add(apart)
    assert seen == {True, False}


# Flips that are found where they are needed.


@given(on_grid(10))
def test_flips_that_are_found_are_those_of_the_list(points: list[Point]) -> None:
    """What is found for one edge, and which edges can be modules, the whole list says too."""
    try:
        system = FlipSystem(points)
    except InputError:
        assert all_quadrilaterals(PointSet(points)) == ()
        return
    assert system.move_slots == system.whole.move_slots
    for edge in combinations(range(len(points)), 2):
        listed = [move for move in system.moves(edge) if move is not None]
        assert list(system.moves_at(edge)) == listed
        assert system.has_place(edge) == system.whole.has_place(edge) == bool(listed)
        for move in listed:
            assert system.action("flip", move.at) is move.action
            assert set(system.moves_of(move.action)) == set(system.whole.moves_of(move.action))


@pytest.mark.parametrize("few", [0, 4096])
@given(points=on_grid(9), random=st.randoms(use_true_random=False))
def test_discovery_is_what_the_met_edges_allow(
    few: int, points: list[Point], random: Random
) -> None:
    """It finds each flip whose sides and one diagonal were met, from each diagonal that was."""
    try:
        system = scene_of(points).system
    except InputError:
        return
    assert isinstance(system, FlipSystem)
    edges = [site for site in system.whole.places if random.random() < 0.7]
    edges = list(dict.fromkeys([*edges, *system.kept]))
    random.shuffle(edges)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flips, "_FEW", few)
        discover = system.discovery()
    met = set(edges)
    found = [(move.action, move.source) for site in edges for move in discover(site)]
    assert len(set(found)) == len(found)
    assert set(found) == {
        (move.action, move.source)
        for site in edges
        for move in system.moves_at(site)
        if move.action.reads <= met
    }


@pytest.mark.slow
@given(on_grid(9), st.randoms(use_true_random=False))
def test_discovery_finds_what_is_admissible_where_it_was(
    points: list[Point], random: Random
) -> None:
    """Told of each edge once along a walk, it has found all that the list allows."""
    try:
        scene = scene_of(points)
    except InputError:
        return
    discover = scene.system.discovery()
    assert discover is not None
    state, known = scene.start_state, set[Site]()
    found: set[tuple[Action, Site]] = set()
    for _ in range(8):
        fresh = list(in_order(state - known))
        random.shuffle(fresh)
        known |= state
        for site in fresh:
            found |= {(move.action, move.source) for move in discover(site)}
        here = {(action, source) for action, source in found if end_at(action, state) is not None}
        expected = {
            (move.action, site)
            for site in state
            for move in scene.system.moves(site)
            if move is not None and move.possible(state)
        }
        assert {(action, site) for action, site in here if site in state} == expected
        action, _ = random.choice(sorted(expected, key=lambda each: site_text(each[1])))
        state ^= action.trace


def test_modules_are_the_diagonals_that_can_move() -> None:
    """The hull, split at points on it, and edges in every triangulation are fixed."""
    scene = scene_of(SIDES)
    system = scene.system
    assert isinstance(system, FlipSystem)
    assert system.plane.hull == {(0, 1), (1, 2), (2, 4), (3, 4), (0, 3)}
    everywhere = frozenset.intersection(*all_triangulations(SIDES))
    assert system.filled == everywhere
    assert scene.start_state in all_triangulations(SIDES)


@pytest.mark.parametrize("spec", ["polygon:n=8", "triangulation:n=14,seed=2"])
def test_random_modules_keep_a_triangulation(spec: str) -> None:
    """Whatever the modules claim, after every round there is a triangulation."""
    scene = scene_from_spec(spec)
    world, random = World(scene, seed=1), np.random.default_rng(1)
    moved = 0
    for _ in range(30):
        masks = [world.observe(module)["action_mask"] for module in range(len(world.sites))]
        done = world.step({m: int(random.choice(k.nonzero()[0])) for m, k in enumerate(masks)})
        moved += len(done.moves)
        scene.system.check_state(world.sites)
    assert moved > 30


# Files, and what is refused.


def test_points_from_files(tmp_path: Path) -> None:
    """Decimals are exact: a tenth and two tenths and three tenths are on one line."""
    path = tmp_path / "points.txt"
    path.write_text("# tenths\n0.1 0.1\n\n0.2 .2  # two\n0.3 3e-1\n1 0\n")
    found = read_points(path)
    assert found.points == ((1, 1), (2, 2), (3, 3), (10, 0))
    assert PointSet(found.points).on_the_way(0, 2) == (1,)
    for text in (
        "[[0.1, 0.1], [0.2, 0.2], [0.3, 0.3], [1, 0]]",
        '{"points_x": [0.1, 0.2, 0.3, 1], "points_y": [0.1, 0.2, 0.3, 0]}',
    ):
        (tmp_path / "points.json").write_text(text)
        assert read_points(tmp_path / "points.json") == found


def test_triangulations_from_a_file(tmp_path: Path) -> None:
    """Triangulations are taken by number, with or without the edges of the hull."""
    path = tmp_path / "instance.json"
    hull = "[0, 1], [1, 2], [2, 3], [0, 3]"
    path.write_text(
        '{"points_x": [0, 8, 8, 0, 3], "points_y": [0, 0, 8, 8, 4], "triangulations":'
        f" [[[0, 4], [1, 4], [2, 4], [3, 4], {hull}], [[0, 2], [0, 4], [2, 4], [3, 4]]]}}"
    )
    scene = scene_from_spec(f"triangulation:points={path}")
    assert set(scene.start) == {(1, 4), (2, 4)}
    assert scene.goal == frozenset({(0, 2), (2, 4)})
    again = scene_from_spec(f"triangulation:points={path},start=1,goal=0")
    assert set(again.start) == scene.goal
    assert again.goal == frozenset(scene.start)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("p.txt", "0 0\n1 1\n0.0 0\n", "points 0 and 2 are the same"),
        ("p.txt", "0 0\n1 1\n2 2\n5 5\n", "all 4 points lie on one line"),
        ("p.txt", "0 0\n1 1\n", "2 points, expected at least 3"),
        ("p.txt", "0 0\n1 x\n", "p.txt:2: 'x' is not a decimal number"),
        ("p.txt", "0 0\n1 inf\n", "p.txt:2: 'inf' is not a decimal number"),
        ("p.txt", "0 0\n1 1e999999999\n", "is not a decimal number"),
        ("p.txt", "0 0 0\n", "p.txt:1: expected 'x y', found '0 0 0'"),
        ("p.txt", "0 0\n9 0\n0 9\n3 3\n", "no quadrilateral is convex and empty"),
        ("p.json", "[[0, 0], [1, NaN]]", "'NaN' is not a decimal number"),
        ("p.json", "[[0, 0], [1]]", r"points\[1\]: expected two numbers"),
        ("p.json", "[[0, 0], ", "p.json:1: not JSON"),
        ("p.json", "3", "expected a list of pairs"),
        ("p.json", '{"points_x": [1]}', "a list points_y"),
        ("p.json", '{"points_x": [1], "points_y": []}', "points_x has 1 numbers, points_y 0"),
        (
            "p.json",
            '{"points_x": [0, 1, 1, 0], "points_y": [0, 0, 1, 1], "triangulations": [[[0, 4]]]}',
            r"triangulations\[0\]: \(0, 4\) is no edge between two points of 0 to 3",
        ),
        ("p.json", CROSSED, r"p.json: goal: edges \[0, 2\] and \[1, 3\] cross"),
    ],
)
def test_files_of_points_that_are_refused(
    tmp_path: Path, name: str, text: str, message: str
) -> None:
    """Each mistake is told in one line that names the file."""
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        scene_from_spec(f"triangulation:points={path}")
    assert name in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("at", "message"),
    [
        ((0, 2, 8, 6), r"quadrilateral \[0, 2, 6, 8\] is not empty: point 1 lies in it"),
        ((3, 1, 7, 5), "is not empty: point 4 lies in it"),
        ((0, 1, 2, 4), "is not convex: point 1 lies in the triangle of the other three"),
        ((0, 2, 6, 4), "is not convex: points 2, 4 and 6 lie on one line"),
        ((0, 1, 2, 5), "is not convex"),
        ((0, 1, 9, 3), "9 is no point, expected 0 to 8"),
        ((0, 1, 1, 3), "'at' is four points"),
        (7, "'at' is four points, found 7"),
    ],
)
def test_quadrilaterals_in_which_nothing_flips_are_refused(at: Site, message: str) -> None:
    """The error says which point is in the way, or that it is not convex."""
    with pytest.raises(InputError, match=message):
        FlipSystem(GRID).action("flip", at)


def test_corners_of_a_flip_come_in_any_order() -> None:
    """A strictly convex quadrilateral is told by its corners alone."""
    system = FlipSystem(GRID)
    assert system.action("flip", (4, 0, 3, 1)) == system.action("flip", (0, 1, 3, 4))


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ("[[0, 2], [1, 3]]", r"edges \[0, 2\] and \[1, 3\] cross"),
        ("[[0, 2]]", "1 diagonals, a triangulation of these points has 2"),
        ("[[0, 2], [2, 0]]", r"start: edge \[0, 2\] stands twice"),
        ("[[0, 2], [false, 3]]", "start: a site is a JSON number, string or list, found false"),
        ("[[0, 2], [0, 9]]", r"\(0, 9\) is no edge"),
        ("[[0, 2], [0, 1]]", "1 diagonals, a triangulation of these points has 2"),
        ("[[0, 2], [0, 2]]", r"start: edge \[0, 2\] stands twice"),
    ],
)
def test_a_start_that_is_no_triangulation_is_refused(
    tmp_path: Path, start: str, message: str
) -> None:
    """A file whose diagonals cross, or are too few, is named with the edges."""
    path = tmp_path / "house.toml"
    path.write_text(
        f'format = "cubepath-system-1"\nstart = {start}\n'
        "[triangulation]\npoints = [[0, 0], [4, 0], [4, 3], [2, 5], [0, 3]]\n"
    )
    with pytest.raises(InputError, match=message) as error:
        read_scene(path)
    assert str(path) in str(error.value)


def test_an_edge_does_not_pass_through_a_point() -> None:
    """The start of a grid may not hold its long sides."""
    with pytest.raises(InputError, match=r"edge \[0, 8\] passes through point 4"):
        Scene("own", "", FlipSystem(GRID), start=((0, 8),))


@pytest.mark.parametrize("spec", ["polygon:n=9", "triangulation:n=20"])
def test_a_file_holds_the_points_alone(spec: str) -> None:
    """Flips follow from the points, in TOML and in pickles; the errors stay as exact."""
    scene = scene_from_spec(spec)
    text = scene_to_toml(scene)
    assert "flip" not in text
    for again in (scene_from_toml(text, "text"), pickle.loads(pickle.dumps(scene))):  # noqa: S301
        assert isinstance(again.system, FlipSystem)
        assert isinstance(scene.system, FlipSystem)
        assert again.system.listed == scene.system.listed
        assert again.start_state == scene.start_state


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("polygon:n=3", "n=3: expected a whole number of at least 4, at most 40"),
        ("polygon:goal=6", "goal=6: expected a corner, 0 to 5"),
        ("triangulation:n=3", "n=3: expected"),
        ("triangulation:start=north", "start=north: expected one of right, left, up, down"),
        ("triangulation:goal=0", "goal=0: expected one of right"),
        ("triangulation:points=no.txt", "no.txt: No such file"),
    ],
)
def test_specs_that_are_refused(spec: str, message: str) -> None:
    """Each mistake in a key is named."""
    with pytest.raises(InputError, match=message):
        scene_from_spec(spec)


@pytest.mark.thorough
def test_a_thousand_points_are_a_system() -> None:
    """Flips are found where they are asked for; only the list of all of them has its bounds."""
    scene = scene_from_spec("triangulation:n=1000")
    system = scene.system
    assert isinstance(system, FlipSystem)
    system.check_state(scene.goal or ())
    discover = system.discovery()
    assert discover is not None
    found = [move for site in in_order(scene.start_state) for move in discover(site)]
    assert len(found) > 800
    assert all(move.possible(scene.start_state) for move in found)
    with pytest.raises(InputError, match="1000 points have too many flips to list them all"):
        system.moves(scene.start[0])
