"""The rule chains takes every straight chain to every other, whatever is lost, skipped or late."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.agents.environments.rollouts import Rollout, play, play_free
from cubepath.agents.rules.chain_route import Row, routes
from cubepath.agents.rules.chain_task import along
from cubepath.agents.rules.chains import CHAINS
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.protocol.core.catalogue import HEX_DIRECTIONS
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from samples.free_plays import Pace, paces

PARALLEL = ["aside=1", "aside=-1", "along=3,aside=2", "along=-2,aside=-4", "aside=7"]


def specs(
    family: str, count: int, far: int, step: int = 1, bends: tuple[int, ...] = (0, 60, 120)
) -> Iterator[str]:
    """Yield parallel and crossing goals, moved by up to `far` cells in two directions."""
    for bend in bends:
        for along_it in range(-far, far + 1, step):
            for aside in range(-far, far + 1, step):
                yield f"{family}:n={count},bend={bend},shift=0,along={along_it},aside={aside}"


def figures(played: Rollout) -> tuple[int, int, int]:
    """Return the numbers of rounds, of moves, and of cubes in the normal form of the moves."""
    moves = [move.action for each in played.rounds for move in each.moves.values()]
    return len(played.rounds), len(moves), len(normal_cube_path(moves))


def check(spec: str, hesitate: float = 0.0) -> None:
    """Play the rule: it reaches the goal, and loses no claim if nobody hesitates."""
    played = play(scene_from_spec(spec), CHAINS, seed=1, hesitate=hesitate, max_rounds=5000)
    assert played.reached, spec
    # Walkers of both sides of a slide may meet at its end, if some hesitate.
    assert hesitate or not any(each.lost for each in played.rounds), spec


# --- It gets there ---------------------------------------------------------------------------


@pytest.mark.few(2)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("family", "hesitate"), [("hex", 0.0), ("hex-open", 0.5), ("hex", 0.5), ("hex-open", 0.0)]
)
def test_goals_in_every_place_are_reached(family: str, hesitate: float) -> None:
    """Parallel ones, crossing ones, those further off, and the start itself."""
    for spec in specs(family, 3, far=4, step=4):
        check(spec, hesitate)


@pytest.mark.thorough
@pytest.mark.parametrize("hesitate", [0.0, 0.5])
@pytest.mark.parametrize("bend", [0, 60, 120])
@pytest.mark.parametrize(
    "count", [3, 4, *(pytest.param(count, marks=pytest.mark.nightly) for count in (5, 6))]
)
def test_goals_in_all_places_are_reached(count: int, bend: int, hesitate: float) -> None:
    """Every parallel or crossing goal that is moved by up to n cells each way."""
    for spec in specs("hex", count, far=count, bends=(bend,)):
        check(spec, hesitate)


@pytest.mark.slow
@pytest.mark.parametrize("where", ["bend=0,along=3,aside=5", "bend=120,along=-4,aside=-7"])
def test_twelve_modules(where: str) -> None:
    """Longer chains do, too."""
    check(f"hex:n=12,{where}")


@pytest.mark.parametrize(
    ("spec", "expected"),
    [
        ("hex:n=6,bend=120", (29, 40, 24)),
        ("hex:n=6,bend=120,along=-2,aside=-3", (51, 73, 37)),
        ("hex:n=6,bend=0,shift=0,along=12", (46, 84, 34)),
        ("hex:n=6,bend=0,shift=0,aside=1", (66, 97, 52)),
    ],
)
def test_figures_of_six(spec: str, expected: tuple[int, int, int]) -> None:
    """Rounds, moves and cubes."""
    assert figures(play(scene_from_spec(spec), CHAINS)) == expected


@pytest.mark.parametrize("turned", [False, True])
def test_goals_and_modules_may_be_listed_in_reverse(turned: bool) -> None:
    """The goal from either end, and the numbers of the modules along the chain or against it."""
    scene = scene_from_spec("hex:n=4,bend=0,aside=2")
    goals = scene.goals[0][::-1]
    start = scene.start[::-1] if turned else scene.start
    assert play(replace(scene, start=start, goals=(goals,) * 4), CHAINS).reached


def test_one_hexagon_is_there_or_cannot_go() -> None:
    """One module alone has reached its own cell, and refuses any other."""
    assert play(scene_from_spec("hex:n=1"), CHAINS).reached
    with pytest.raises(InputError, match="nothing to pivot about"):
        play(scene_from_spec("hex:n=1,aside=1"), CHAINS)


# --- Without rounds --------------------------------------------------------------------------


@pytest.mark.slow
@settings(max_examples=3, derandomize=True)
@given(st.integers(2, 4), st.sampled_from([0, 60, 120]), st.integers(-4, 4), paces())
def test_every_goal_is_reached_without_rounds(count: int, bend: int, far: int, pace: Pace) -> None:
    """Under every scheduler, with late views, hesitation and modules that lose their memory."""
    scene = scene_from_spec(f"hex:n={count},bend={bend},along={far},aside={far // 2}")
    assert pace.play(scene, CHAINS, max_cycles=20_000).reached


@pytest.mark.thorough
@settings(max_examples=40, derandomize=True)
@given(
    st.integers(2, 7),
    st.sampled_from([0, 60, 120, -60]),
    st.integers(-9, 9),
    st.integers(-9, 9),
    paces(),
)
def test_very_many_goals_are_reached_without_rounds(
    count: int, bend: int, along_it: int, aside: int, pace: Pace
) -> None:
    """The same, on many more."""
    scene = scene_from_spec(f"hex:n={count},bend={bend},along={along_it},aside={aside}")
    assert pace.play(scene, CHAINS, max_cycles=60_000).reached


def test_nobody_moves_before_all_know_the_start() -> None:
    """No first look comes too late, however rarely a module acts."""
    played = play_free(scene_from_spec("hex:n=5,aside=1"), CHAINS, seed=1, speeds={2: 100})
    first = next(number for number, commit in enumerate(played.commits) if commit.generator)
    assert first >= 5 + 2  # all say the start, then the last one and its neighbour go on
    assert played.reached


# --- Where it leads, and what it refuses -----------------------------------------------------


@given(st.integers(2, 9), st.integers(0, 5), st.tuples(st.integers(-20, 20), st.integers(-20, 20)))
def test_each_stage_is_a_task_of_chain_and_begins_where_the_last_one_ended(
    count: int, direction: int, first: tuple[int, int]
) -> None:
    """From one row to the next, within n cells, until the goal."""
    start, goal = Row((0, 0), (1, 0), count), Row(first, HEX_DIRECTIONS[direction], count)
    for stages in routes(start, goal)[:5]:
        row = set(start.cells)
        for task in stages:
            for cell in row:
                steps, away = along(task.head, cell)
                assert task.is_goal(cell) or (away == task.away and steps <= count)
            after = set(Row(task.head, task.ahead, count).cells)
            assert len(row - after) == task.steps > 0
            row = after
        assert row == set(goal.cells)


@pytest.mark.parametrize("where", PARALLEL)
def test_goals_nearby_take_few_stages(where: str) -> None:
    """At most four for a parallel goal, and three for one that crosses the start."""
    ends = [(f"hex:n=7,bend=0,shift=0,{where}", 4), ("hex:n=7,along=-3,aside=-4", 3)]
    for spec, most in ends:
        goals = scene_from_spec(spec).goals[0]
        one, other = goals[0], goals[1]
        assert isinstance(one, tuple)
        assert isinstance(other, tuple)
        goal = Row((one[0], one[1]), (other[0] - one[0], other[1] - one[1]), 7)
        assert len(routes(Row((0, 0), (1, 0), 7), goal)[0]) <= most


@pytest.mark.parametrize(
    "start", [((0, 0), (1, 0), (2, -1)), ((0, 0), (1, 0), (3, 0)), ((0, 0), (2, 0), (4, 0))]
)
@pytest.mark.parametrize("clock", ["lockstep", "free"])
def test_a_start_that_is_no_chain_fails_in_one_line(
    start: tuple[tuple[int, int], ...], clock: str
) -> None:
    """Bent, or with gaps."""
    goals = ((0, 2), (1, 2), (2, 2))
    system = scene_from_spec("hex:n=3").system
    scene = Scene("bent", "hex", system, start, frozenset(goals), (goals,) * 3)
    played = play(scene, CHAINS) if clock == "lockstep" else play_free(scene, CHAINS)
    assert played.failed is not None
    assert "no straight chain of 3 modules stands at" in played.failed


def test_a_box_that_is_too_small_is_refused_in_one_line() -> None:
    """It names a cell that is missing for each way there is; with room for one, that is taken."""
    scene = scene_from_spec("hex-open:n=4,bend=0,along=9")
    assert play(scene, CHAINS).reached
    goals = tuple((q, 2) for q in range(4))
    small = scene_from_spec("hex-open:n=4,bend=0,shift=0")
    failed = play(replace(small, goal=frozenset(goals), goals=(goals,) * 4), CHAINS).failed
    assert failed is not None
    assert "room two cells about" in failed


def test_obstacles_are_refused() -> None:
    """A base cell is not part of a chain."""
    assert CHAINS.fits(scene_from_spec("hex-open").system)
    assert not CHAINS.fits(scene_from_spec("hex:base=1").system)
