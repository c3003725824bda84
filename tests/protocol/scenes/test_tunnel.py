"""The hexagonal tunnel: contractible for any length, of higher dimension for longer ones."""

from collections import Counter, deque
from random import Random

import pytest

from cubepath.protocol.core.actions import Action, admissible, apply
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.built_in_pages import page_catalogue
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem
from oracles.cells import cells_of
from oracles.complexes import Key, actions_at, commuting_sets, f_vector, states_of

SIZES = {
    "n=1": [2, 1],
    "n=2": [10, 9],
    "n=3": [23, 26, 4],
    "n=4": [46, 50, 5],
    "n=5": [83, 108, 26],
    "n=4,length=7": [22, 23, 2],
    "n=6": [138, 199, 62],
    "n=6,length=9": [53, 74, 22],
    "n=8": [389, 665, 287, 10],
    "n=8,length=11": [130, 217, 91, 3],
}
LARGE = {
    "n=10": [1019, 2009, 1142, 151],
    "n=12,length=15": [729, 1611, 1122, 243, 4],
    "n=16,length=19": [3971, 10932, 10616, 4194, 545, 5],
}


Cubes = dict[Key, tuple[Action, ...]]
"""Cubes with their actions in a fixed order: no order of a set decides what follows."""


def faces(cube: Key, actions: tuple[Action, ...]) -> list[Key]:
    """Return the faces of a cube, which is what stays on and the actions that may be done."""
    rest, chosen = cube
    return [
        (rest | (end & action.trace), chosen - {action})
        for action in actions
        for end in action.ends
    ]


def cubes_of(scene: Scene) -> Cubes:
    """Return all cubes in the order in which a breadth-first search comes to them."""
    found: Cubes = {}
    for state in states_of(scene):
        found[state, frozenset()] = ()
        for chosen in commuting_sets(actions_at(scene, state)):
            moved = frozenset[Site]().union(*(action.trace for action in chosen))
            found.setdefault((state - moved, frozenset(chosen)), chosen)
    return found


def collapsed(cubes: Cubes) -> Counter[int]:
    """Take away a cube with a free face for as long as there is one; count what is left.

    Free faces wait in a queue. Above dimension two the order matters: with a stack some orders of
    the cubes of the largest tunnel get stuck, with a queue none did.
    """
    above: dict[Key, dict[Key, None]] = {cube: {} for cube in cubes}
    for cube, actions in cubes.items():
        for face in faces(cube, actions):
            above[face][cube] = None
    free = deque(cube for cube in cubes if len(above[cube]) == 1)
    while free:
        face = free.popleft()
        if face not in above or len(above[face]) != 1:
            continue
        (cube,) = above[face]
        assert not above[cube]  # a free face lies in nothing but its one cube
        for gone in (cube, face):
            for each in faces(gone, cubes[gone]):
                if each in above:
                    above[each].pop(gone, None)
                    if len(above[each]) == 1:
                        free.append(each)
            del above[gone]
    return Counter(len(actions) for _, actions in above)


@pytest.mark.parametrize(
    ("sizes", "numbers"),
    [*SIZES.items(), *(pytest.param(*item, marks=pytest.mark.nightly) for item in LARGE.items())],
)
def test_the_complex_collapses_to_a_point(sizes: str, numbers: list[int]) -> None:
    """Cubes of each dimension as counted by another program; one vertex is left of them."""
    cubes = cubes_of(scene_from_spec(f"hex-tunnel:{sizes}"))
    count = Counter(len(actions) for _, actions in cubes)
    assert [count[dimension] for dimension in range(max(count) + 1)] == numbers
    assert collapsed(cubes) == {0: 1}


@pytest.mark.parametrize(
    "sizes", ["n=6", "n=8,length=11", pytest.param("n=12,length=15", marks=pytest.mark.slow)]
)
def test_no_order_of_the_cubes_gets_stuck(sizes: str) -> None:
    """In whatever order the free faces are found, they are enough to come to a point."""
    cubes = list(cubes_of(scene_from_spec(f"hex-tunnel:{sizes}")).items())
    for seed in range(5):
        Random(seed).shuffle(cubes)  # noqa: S311 - to be the same every time
        assert collapsed(dict(cubes)) == {0: 1}


def test_the_collapse_leaves_a_circle_a_circle() -> None:
    """The counter-test: where there is a hole, vertices and edges are left, as many of each."""
    left = collapsed(cubes_of(scene_from_spec("agv:graph=C6,n=1")))
    assert left == {0: 6, 1: 6}


def test_longer_lines_give_higher_dimension() -> None:
    """The dimension of the tables above is floor(n / 4) + 1, except for n = 3."""
    for sizes, numbers in (SIZES | LARGE).items():
        count = int(sizes.split(",")[0].removeprefix("n="))
        assert len(numbers) - 1 == (2 if count == 3 else count // 4 + 1)


@pytest.mark.parametrize("count", range(1, 6))
def test_the_whole_line_crosses(count: int) -> None:
    """The goal, as many columns further as the line is long, can be reached."""
    scene = scene_from_spec(f"hex-tunnel:n={count}")
    assert scene.goal is not None
    assert {(q - count, r) for q, r in cells_of(scene.goal)} == set(scene.start)
    assert scene.goal | scene.system.filled in states_of(scene)


def test_the_channel_has_four_upright_rows() -> None:
    """Filled below, empty above, two rows free; each row half a cell from the one beneath."""
    system = scene_from_spec("hex-tunnel:n=3").system
    assert isinstance(system, LatticeSystem)
    assert system.workspace is not None
    rows: dict[int, list[int]] = {}
    for q, r in sorted(cells_of(system.workspace)):
        rows.setdefault(r, []).append(2 * q + r)
    assert rows == {r: list(range(r % 2, 16 + r % 2, 2)) for r in range(4)}
    assert {r for _, r in cells_of(system.filled)} == {0}
    assert {r for _, r in cells_of(system.empty)} == {3}
    assert len(system.filled) == len(system.empty) == 8


def test_its_pivots_are_those_of_the_two_catalogues() -> None:
    """Along the rows as in the first catalogue, across as in the second, six in all."""
    first, second = map(page_catalogue, ("hexagons-1", "hexagons-2"))
    for pivot in page_catalogue("hexagons-tunnel").generators:
        along = pivot.motion[0][0][1] == pivot.motion[0][1][1]
        assert pivot == (first if along else second).by_name[pivot.name]
    assert len(page_catalogue("hexagons-tunnel").generators) == 6


def test_what_the_second_catalogue_leaves_out_across_are_obstacles() -> None:
    """E and E' of every pivot between the free rows lie in the rows of obstacles."""
    mixed, strict = (
        scene_from_spec(f"hex-tunnel:n=4,catalogue={which}").system for which in ("mixed", "1")
    )
    assert isinstance(strict, LatticeSystem)
    found = 0
    for site in in_order(strict.workspace or ()):
        for one, other in zip(mixed.moves(site), strict.moves(site), strict=True):
            if one is not None and other is not None and one.action != other.action:
                assert one.action.trace == other.action.trace
                assert other.action.support - one.action.support <= strict.obstacles
                found += 1
    assert found


@pytest.mark.parametrize("count", [2, 4, 6])
def test_with_the_first_catalogue_throughout_nothing_moves(count: int) -> None:
    """Every pivot of the line has E or E' on the filled row, or a neighbour of the line there."""
    assert f_vector(scene_from_spec(f"hex-tunnel:n={count},catalogue=1")) == [1]


@pytest.mark.parametrize(("count", "numbers"), [(2, [19, 23, 3]), (3, [113, 196, 78, 4])])
def test_with_the_second_catalogue_throughout_it_is_not_contractible(
    count: int, numbers: list[int]
) -> None:
    """The Euler characteristic is not that of a point."""
    assert f_vector(scene_from_spec(f"hex-tunnel:n={count},catalogue=2")) == numbers
    assert sum((-1) ** k * number for k, number in enumerate(numbers)) in (-1, -9)


def test_the_first_move_climbs_from_an_end_of_the_line() -> None:
    """At the start the modules at both ends can climb onto the line, and nothing else can be."""
    scene = scene_from_spec("hex-tunnel:n=5")
    line = set(scene.start)
    climbs = {
        (move.source, move.target)
        for site in line
        for move in scene.system.moves(site)
        if move is not None and admissible(move.action, scene.start_state)
    }
    assert climbs == {((5, 1), (4, 2)), ((1, 1), (1, 2))}
    for action in actions_at(scene, scene.start_state):
        assert len(apply(action, scene.start_state) & line) == 4


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("hex-tunnel:n=4,length=6", "length=6: expected a whole number of at least 7"),
        ("hex-tunnel:length=long", "length=long: expected a whole number"),
        ("hex-tunnel:catalogue=3", "catalogue=3: expected one of mixed, 1, 2"),
    ],
)
def test_a_tunnel_that_is_none_is_refused(spec: str, message: str) -> None:
    """A line that could not move on, and catalogues that there are not, are named."""
    with pytest.raises(InputError, match=message):
        scene_from_spec(spec)
