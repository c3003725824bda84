"""The rule leader: shapes reach their goals, whatever is skipped, lost or late."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.agents.environments.rollouts import Rollout, play
from cubepath.agents.rules import leader
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.leader import LEADER
from cubepath.protocol.core.actions import apply
from cubepath.protocol.core.catalogue import SQUARES, Cell
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.families.shapes import sliding_catalogue
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.lattice import LatticeSystem
from oracles.touching import touching
from samples.free_plays import Pace, paces

SHAPES = ["sliding-shapes:n=6,walk=60", "sliding-shapes:n=6,k=1,walk=60", "hex-shapes:n=6,walk=60"]


def run(spec: str, *, seed: int, hesitate: float = 0.0, max_rounds: int = 3000) -> Rollout:
    scene = scene_from_spec(f"{spec},seed={seed}")
    return play(scene, LEADER, seed=seed, hesitate=hesitate, max_rounds=max_rounds)


def squares(start: Sequence[Cell], goal: Sequence[Cell]) -> Scene:
    """Return a scene of squares in a box of 12 by 12 cells."""
    system = LatticeSystem(
        sliding_catalogue(len(start) - 1),
        workspace=[(x, y) for x in range(-4, 8) for y in range(-4, 8)],
    )
    goals = (tuple(goal),) * len(start)
    return Scene("by hand", "sliding", system, tuple(start), frozenset(goal), goals)


@pytest.mark.few(3)
@pytest.mark.slow
@pytest.mark.parametrize("spec", SHAPES)
@pytest.mark.parametrize("hesitate", [0.5, 0.0])
def test_shapes_get_where_a_walk_leads(spec: str, hesitate: float) -> None:
    """Every seed does, and no claim is lost."""
    for seed in range(4):
        played = run(spec, seed=seed, hesitate=hesitate)
        assert played.reached
        assert not any(each.lost for each in played.rounds)


@pytest.mark.nightly
@pytest.mark.parametrize(
    "spec", ["sliding-shapes:n=8,walk=400", "sliding-shapes:n=12", "hex-shapes:n=6,walk=300"]
)
@pytest.mark.parametrize("hesitate", [0.0, 0.5])
def test_many_larger_shapes_get_there(spec: str, hesitate: float) -> None:
    """The same for twelve seeds, none of which draws a straight line of squares."""
    for seed in range(1, 13):
        played = run(spec, seed=seed, hesitate=hesitate)
        assert played.reached
        assert not any(each.lost for each in played.rounds)


@pytest.mark.thorough
def test_news_takes_many_hops() -> None:
    """Hexagons hear three cells far, so orders to 20 of them are passed on by others."""
    reached = sum(run("hex-shapes:n=20,walk=200", seed=seed).reached for seed in range(1, 9))
    assert reached >= 6


@pytest.mark.slow
def test_squares_go_round_an_obstacle() -> None:
    """Obstacles that are on hold the squares, and do not move."""
    assert play(scene_from_spec("sliding:p=2,q=1,n=3"), LEADER, max_rounds=300).reached


@pytest.mark.slow
def test_moves_that_commute_are_made_in_one_round() -> None:
    """A run has more moves than rounds in which something moves."""
    played = run("hex-shapes:n=12,walk=300", seed=2)
    assert played.reached
    assert len(played.path) > sum(bool(each.moves) for each in played.rounds)


LINE = [(x, 0) for x in range(4)]
BLOCK = [(0, 0), (1, 0), (0, 1), (1, 1)]


@pytest.mark.slow
@pytest.mark.parametrize(("start", "goal"), [(LINE, BLOCK), (BLOCK, LINE)])
def test_no_way_from_or_to_a_straight_line(start: list[Cell], goal: list[Cell]) -> None:
    """The side of the line has soon met all that it can, and the leader gives up in one line."""
    played = play(squares(start, goal), LEADER, max_rounds=100)
    assert not played.path
    assert played.failed is not None
    assert re.fullmatch(r"module_\d: gave up after \d+ rounds? without progress", played.failed)


@pytest.mark.slow
def test_any_module_may_lead() -> None:
    """The one that gives up is the one that leads; the seed decides, and only the seed."""
    scene = squares(LINE, BLOCK)
    failed = [play(scene, LEADER, seed=seed, max_rounds=100).failed for seed in range(12)]
    again = [play(scene, LEADER, seed=seed, hesitate=0.5, max_rounds=100) for seed in range(12)]
    assert {each and each[:8] for each in failed} == {f"module_{module}" for module in range(4)}
    assert [each.failed for each in again] == failed


@pytest.mark.slow
def test_it_gives_up_where_the_search_takes_too_long(monkeypatch: pytest.MonkeyPatch) -> None:
    """A leader whose search outlasts its patience, which is less here, fails in one line."""
    monkeypatch.setattr(leader, "PATIENCE", 4)
    monkeypatch.setattr(leader, "EXPANDED", 1)
    played = run("sliding-shapes:n=6,walk=60", seed=1)
    assert played.failed == "module_1: gave up after 3 rounds without progress"
    assert len(played.rounds) < 10


@pytest.mark.slow
@settings(max_examples=3, derandomize=True)
@given(paces(), st.sampled_from(SHAPES))
def test_without_rounds_at_any_pace(pace: Pace, spec: str) -> None:
    """Late views, slow modules, skipped turns and lost memories keep no shape from its goal."""
    scene = scene_from_spec(f"{spec},seed=2")
    played = pace.play(scene, LEADER)
    assert played.failed is None
    assert played.reached


@pytest.mark.nightly
@settings(max_examples=20, derandomize=True)
@given(paces(), st.sampled_from(SHAPES), st.integers(0, 20))
def test_without_rounds_at_many_more_paces(pace: Pace, spec: str, seed: int) -> None:
    """The same for more of them, from more shapes."""
    played = pace.play(scene_from_spec(f"{spec},seed={seed}"), LEADER)
    assert played.failed is None
    assert played.reached


@pytest.mark.slow
def test_the_same_seed_gives_the_same_run() -> None:
    """Nothing but hesitation is random."""
    one, two, six = (run("hex-shapes:n=6,walk=60", seed=3, hesitate=h) for h in (0.3, 0.3, 0.0))
    assert one == two
    assert one != six


def test_it_is_for_cells_whose_modules_know_the_whole_goal() -> None:
    """It is not offered for edges, vehicles or what is not local, and needs all goal cells."""
    for spec in ("sliding", "hex-shapes", "hex:n=4"):
        assert LEADER.fits(scene_from_spec(spec).system)
    for spec in ("arm:n=4", "agv:graph=K5", "polygon:n=6"):
        assert not LEADER.fits(scene_from_spec(spec).system)
    scene = replace(squares(BLOCK, BLOCK), goals=())
    with pytest.raises(InputError, match="goal of 4 cells that every module knows, found 0"):
        actors_for(scene, LEADER, seed=0, hesitate=0.0)


def shapes_of(count: int) -> set[frozenset[Cell]]:
    """Return all shapes of squares, each where its least coordinates are 0."""
    found: set[frozenset[Cell]] = {frozenset({(0, 0)})}
    for _ in range(count - 1):
        found = {
            placed(shape | {cell})
            for shape in found
            for here in shape
            for cell in touching(SQUARES, here) - shape
        }
    return found


def placed(shape: frozenset[Cell]) -> frozenset[Cell]:
    left, low = (min(axis) for axis in zip(*shape, strict=True))
    return frozenset((x - left, y - low) for x, y in shape)


def moved_once(system: LatticeSystem, cells: frozenset[Cell]) -> list[frozenset[Cell]]:
    """Return the shapes one move away; obstacles stand still."""
    state = cells | system.filled
    return [
        frozenset(map(SQUARES.check, apply(move.action, state) - system.filled))
        for cell in sorted(cells)
        for move in system.moves(cell)
        if move is not None and move.possible(state)
    ]


@pytest.mark.parametrize(
    ("count", "walls"),
    [(1, {(0, 2), (1, 2), (2, 2)}), (2, {(x, y) for x in range(-1, 4) for y in range(-1, 3)})],
)
def test_one_square_turns_no_convex_corner_and_two_do(count: int, walls: set[Cell]) -> None:
    """On a wall of 3 by 2 one stays on its side, and two in a row come to all cells about it."""
    wall = [(x, y) for x in range(3) for y in range(2)]
    system = LatticeSystem(sliding_catalogue(count - 1), filled=wall)
    found: list[frozenset[Cell]] = [frozenset((x, 2) for x in range(count))]
    for shape in found:
        found += [after for after in dict.fromkeys(moved_once(system, shape)) if after not in found]
    assert {cell for shape in found for cell in shape} == walls.difference(wall)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("longest", "stuck"),
    [(1, [2, 3, 6, 24]), (2, [2, 2, 6, 14]), (6, [0, 0, 0, 0])],
    ids=["one", "two", "any"],
)
def test_shapes_that_cannot_be_left(longest: int, stuck: list[int]) -> None:
    """Of 3 to 6 squares, by how many may slide at one time; all of them shift a straight line."""
    shapes = [(count, shape) for count in range(3, 7) for shape in shapes_of(count)]
    system = LatticeSystem(sliding_catalogue(longest - 1))
    fixed = Counter(count for count, shape in shapes if not moved_once(system, shape))
    assert [fixed[count] for count in range(3, 7)] == stuck


@pytest.mark.slow
@pytest.mark.parametrize(
    ("count", "reached"),
    [(3, 4), (4, 17), (5, 61), pytest.param(6, 214, marks=pytest.mark.thorough)],
)
def test_all_shapes_but_straight_lines_reach_one_another(count: int, reached: int) -> None:
    """By enumeration, taken as equal if one is the other moved; the two lines reach nothing."""
    system = LatticeSystem(sliding_catalogue(count - 1))
    rest, groups = shapes_of(count), list[int]()
    while rest:
        group = [rest.pop()]
        for shape in group:
            near = {placed(after) for after in moved_once(system, shape)} & rest
            rest -= near
            group += near
        groups.append(len(group))
    assert sorted(groups) == [1, 1, reached]
