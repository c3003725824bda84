"""The search beyond the homotopy class: never worse, always legal, and the short way round."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.coordinator.normal_form.definitions import end_state, is_normal
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.coordinator.theory.optimality.optimality_report import beyond
from cubepath.coordinator.theory.optimality.tasks import PathTask, task_of
from cubepath.coordinator.theory.search.anytime import Improvement, improve
from cubepath.coordinator.theory.search.exact import optimum
from cubepath.coordinator.theory.search.lower_bounds import lower_bound
from cubepath.coordinator.theory.search.own_ends import ends_of
from cubepath.coordinator.theory.search.transitions import Transitions
from cubepath.coordinator.theory.search.vehicle_lns import Replanner
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.moves import read_cubes, write_lines
from cubepath.protocol.systems.graph import GraphSystem
from cubepath.protocol.systems.graphs import scenario_from_json
from marked import all_but
from samples.strategies import random_walk, scene, walks

DATA = Path(__file__).parents[3] / "data" / "agv"
SYSTEMS = (
    "agv:graph=grid4x4,n=4",
    "agv-labelled:graph=grid4x4,n=3",
    "sliding:p=2,q=1,n=3",
    "arm:n=6",
    "arm-free:n=5",
    "arms",
    "polygon:n=9",
    "triangulation:n=12",
    "words:presentation=free2",
    "assembly:n=3",
    "hex:n=6",
    "hex-open:n=4",
)


def checked(where: Scene, walk: list[Action], **options: Any) -> Improvement:
    """Improve a walk, and check each path on the way: legal, to the same end, better and better."""
    start = where.start_state
    end = end_state(walk, start)
    begun = normal_cube_path(walk)
    cost = len(begun), sum(map(len, begun))

    def watch(better: Improvement) -> None:
        nonlocal cost
        assert end_state(better.cube_path, start) == end
        assert is_normal(better.cube_path)
        assert (better.cubes, better.moves) < cost
        cost = better.cubes, better.moves

    found = improve(walk, start, where.system, watch=watch, **options)
    assert (found.cubes, found.moves) == cost
    assert end_state(found.cube_path, start) == end
    return found


@pytest.mark.few(4)
@pytest.mark.slow
@pytest.mark.parametrize("spec", all_but(SYSTEMS, {"triangulation:n=12"}))
def test_every_step_of_an_improvement_is_legal_and_better(spec: str) -> None:
    """From long random walks, on every system; bound, optimum, improved and cubes in this order."""
    where = scene(spec)
    walk = random_walk(spec, 150, seed=3)
    found = checked(where, walk, iterations=60, seed=1)
    end = end_state(walk, where.start_state)
    cubes = len(normal_cube_path(walk))
    assert lower_bound(where.system, where.start_state, end, within=cubes).cubes <= found.cubes
    steps = Transitions(where.system)
    exact = optimum(steps, steps.encode(where.start_state), steps.encode(end), max_states=5_000)
    assert exact.at_least <= found.cubes <= cubes


@pytest.mark.slow
@settings(max_examples=8)
@given(st.data())
def test_an_improvement_is_never_worse(data: st.DataObject) -> None:
    """Of any walk, short or long, with any seed and hardly any time."""
    where = scene(data.draw(st.sampled_from(SYSTEMS)))
    walk = data.draw(walks(where.spec, max_size=25))
    checked(where, walk, iterations=data.draw(st.integers(0, 6)), seed=data.draw(st.integers(0, 9)))


@pytest.mark.few(2)
@pytest.mark.parametrize(
    "spec",
    all_but(["agv:graph=grid4x4,n=4", "hex:n=6", "triangulation:n=12"], {"triangulation:n=12"}),
)
def test_the_same_seed_finds_the_same_path(spec: str) -> None:
    """Bounded by iterations, nothing but input and seed counts."""
    where = scene(spec)
    walk = random_walk(spec, 150, seed=5)
    one, other = (
        improve(walk, where.start_state, where.system, iterations=12, seed=4) for _ in range(2)
    )
    assert one == other


HASHED = """
from cubepath.coordinator.theory.search.anytime import improve
from cubepath.coordinator.theory.search.own_ends import ends_of
from cubepath.coordinator.theory.search.transitions import Transitions
from cubepath.protocol.scenes.specs import scene_from_spec
from random import Random

for spec in ("words:presentation=free2", "arms", "agv:graph=grid4x4,n=4"):
    scene = scene_from_spec(spec)
    steps, random, path = Transitions(scene.system), Random(1), []
    state = steps.encode(scene.start_state)
    for _ in range(120):
        number = random.choice(steps.possible(state))
        state ^= steps.toggle[number]
        path.append(steps.actions[number])
    found = improve(path, scene.start_state, scene.system, iterations=12, seed=2)
    print([[action.label for action in cube] for cube in found.cube_path])
"""


@pytest.mark.thorough
def test_hashes_of_strings_decide_nothing() -> None:
    """Two interpreters that hash differently find the same path."""
    said = [
        subprocess.run(
            [sys.executable, "-c", HASHED],
            check=True,
            capture_output=True,
            text=True,
            env=os.environ | {"PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("1", "2")
    ]
    assert said[0] == said[1]
    assert len(said[0].splitlines()) == 3


def round_the_cycle(where: Scene, vehicles: int, steps: int) -> list[Action]:
    """Return the moves of vehicles on a cycle of twelve that all go on by so many steps."""
    assert isinstance(where.system, GraphSystem)
    labelled = where.system.labels is not None
    walk: list[Action] = []
    for step in range(steps):
        for vehicle in reversed(range(vehicles)):
            ends = ((vehicle + step) % 12, (vehicle + step + 1) % 12)
            walk.append(where.system.action("edge", (*ends, vehicle) if labelled else ends))
    return walk


@pytest.mark.parametrize("name", ["agv", "agv-labelled"])
@pytest.mark.parametrize("vehicles", [1, 2, 3])
def test_the_long_way_round_a_cycle_becomes_the_short_one(name: str, vehicles: int) -> None:
    """Nine steps one way are three the other, and the exact optimum says that is all."""
    where = scene(f"{name}:graph=C12,n={vehicles}")
    walk = round_the_cycle(where, vehicles, 9)
    assert len(normal_cube_path(walk)) > 8
    found = checked(where, walk, iterations=200, seed=1)
    steps = Transitions(where.system)
    end = steps.encode(end_state(walk, where.start_state))
    exact = optimum(steps, steps.encode(where.start_state), end)
    assert exact.cubes is not None
    assert found.cubes == len(exact.cubes) <= 2 + vehicles


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "iterations", "expected"),
    [
        pytest.param("grid8-12agents", 2000, 11, marks=pytest.mark.nightly),
        ("random-32-32-10-30agents", 50, 53),
    ],
)
def test_vehicles_of_a_planner_are_improved_and_keep_their_goals(
    name: str, iterations: int, expected: int
) -> None:
    """The planner's own plan gets shorter where it can, and each vehicle ends at its goal."""
    path = DATA / f"{name}.json"
    found = shorten(path)
    task = task_of(found)
    known = beyond(task, found, iterations=iterations, seed=1, max_states=1000)
    assert known.improved == len(known.cube_path) == expected
    assert known.lower_bound <= expected <= found.cubes
    scenario = scenario_from_json(path)
    goals = dict(zip(scenario.starts, scenario.goals, strict=True))
    assert ends_of((move for cube in known.cube_path for move in cube), task.start) == goals


def test_labelled_goals_are_kept_or_exchanged() -> None:
    """One goes round a ring to the place behind the other: ten cubes, or two if they exchange."""
    where = scene("agv:graph=C12,n=2")
    assert isinstance(where.system, GraphSystem)
    walk = [where.system.action("edge", (place, place + 1)) for place in range(1, 11)]
    start = where.start_state
    free = improve(walk, start, where.system, iterations=300, seed=1)
    own = improve(walk, start, where.system, iterations=300, seed=1, labelled_goals=True)
    assert (free.cubes, own.cubes) == (2, 10)
    moves = [move for cube in own.cube_path for move in cube]
    assert ends_of(moves, start) == ends_of(walk, start) == {0: 0, 1: 11}


def test_labelled_goals_hold_for_the_exhaustive_search_too() -> None:
    """It looks at labelled vehicles, and gives back moves of those without labels."""
    where = scene("agv:graph=grid3x3,n=3")
    for seed in range(4):
        walk = tuple(random_walk(where.spec, 40, seed))
        known = beyond(
            PathTask(walk, where.start_state, where.system, labelled_goals=True), iterations=0
        )
        assert known.optimal
        assert known.improved == known.lower_bound == len(known.cube_path)
        moves = [move for cube in known.cube_path for move in cube]
        assert ends_of(moves, where.start_state) == ends_of(walk, where.start_state)
        free = beyond(PathTask(walk, where.start_state, where.system), iterations=0)
        assert free.optimal
        assert free.lower_bound <= known.lower_bound


def test_a_plan_of_vehicles_is_its_cube_path() -> None:
    """What is read into a plan comes out again, and its rounds are the cubes."""
    where = scene("agv:graph=grid4x4,n=4")
    assert isinstance(where.system, GraphSystem)
    cubes = normal_cube_path(random_walk(where.spec, 60, seed=1))
    plan = Replanner(
        where.system, where.system.graph, where.start_state, cubes, labelled_goals=False
    )
    assert plan.rounds == len(cubes)
    assert normal_cube_path(plan.actions()) == cubes


def test_an_empty_path_and_no_time_are_no_trouble() -> None:
    """Nothing to improve, or no step to do it with: the path comes back; no bound is refused."""
    where = scene("hex:n=6")
    assert improve([], where.start_state, where.system, iterations=5).cubes == 0
    walk = random_walk("hex:n=6", 20, seed=1)
    found = improve(walk, where.start_state, where.system, iterations=0)
    assert found.cube_path == normal_cube_path(walk)
    assert improve(walk, where.start_state, where.system, seconds=0).steps == 0
    with pytest.raises(InputError, match="when to stop"):
        improve(walk, where.start_state, where.system)
    with pytest.raises(InputError, match="own ends"):
        improve(walk, where.start_state, where.system, iterations=1, labelled_goals=True)


def loop(path: Path) -> Path:
    """Write a moves file of one thing on a ring of six places, five steps round."""
    ring = [
        {
            "id": place,
            "support": [place, (place + 1) % 6],
            "trace": [place, (place + 1) % 6],
            "before": [place],
            "after": [(place + 1) % 6],
        }
        for place in range(6)
    ]
    # There and back over the last edge: it cancels, but from then on it is known.
    write_lines(path, [*ring, ring[5] | {"before": [0], "after": [5]}])
    return path


def test_moves_that_stand_for_themselves_are_improved_by_one_another(tmp_path: Path) -> None:
    """Without a system, what occurs in the file is all that there is to do."""
    path = loop(tmp_path / "ring.jsonl")
    found = shorten(path)
    assert found.cubes == 5
    known = beyond(task_of(found), found, iterations=30)
    assert (known.improved, known.lower_bound, known.optimal) == (1, 1, True)
    assert known.named == ((5,),)
    assert beyond(task_of(found), found).optimal is False


def test_a_move_that_cancelled_is_told_from_others_of_its_id(tmp_path: Path) -> None:
    """Where all ids are alike, the improved path names the move of the input that it means."""
    path = loop(tmp_path / "ring.jsonl")
    lines = [json.loads(line) | {"id": "step"} for line in path.read_text().splitlines()]
    write_lines(path, lines)
    found = shorten(path)
    known = beyond(task_of(found), found, iterations=30)
    assert known.improved == 1
    assert known.named == ((("step", 6),),)


def test_moves_without_contents_cannot_be_looked_beyond(tmp_path: Path) -> None:
    """The line says what is missing; so it does for moves that the system does not have."""
    path = tmp_path / "named.jsonl"
    write_lines(path, [{"id": "a", "support": [1, 2], "trace": [1]}])
    with pytest.raises(InputError, match='"before" and "after"'):
        task_of(shorten(path))
    write_lines(path, [{"id": 1, "support": [0, 3], "trace": [0, 3], "before": [0], "after": [3]}])
    system = "agv:graph=C5,n=1"
    with pytest.raises(InputError, match="is no move of"):
        task_of(shorten(path, system=system))


def test_where_there_is_but_one_class_nothing_is_searched() -> None:
    """An arm's normal cube path is the shortest of all, and it is said so."""
    where = scene("arm:n=6")
    walk = random_walk("arm:n=6", 40, seed=2)
    cubes = normal_cube_path(walk)
    found = improve(walk, where.start_state, where.system, iterations=40)
    assert found.cubes == len(cubes)


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    from cubepath.coordinator.commands.main import main

    code = main([str(each) for each in arguments])
    told = capsys.readouterr()
    return code, told.out, told.err


def test_the_command_line_says_which_gap_is_left(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Keys only where they are asked for, the improved path in the file, misuse refused."""
    path = loop(tmp_path / "ring.jsonl")
    code, out, _ = run(capsys, "shorten", path, "--json")
    assert (code, "improved" in json.loads(out)) == (0, False)
    _, out, _ = run(capsys, "improve", path, "--bounds", "--json")
    keys = ("cubes", "improved", "lower_bound", "optimal", "only_class")
    assert [json.loads(out)[key] for key in keys] == [5, None, 1, False, None]
    cubes = tmp_path / "cubes.jsonl"
    code, out, _ = run(
        capsys, "improve", path, "--seconds", 0.2, "--seed", 2, "-o", cubes, "--json"
    )
    assert [json.loads(out)[key] for key in keys] == [5, 1, 1, True, None]
    assert list(read_cubes(cubes)) == [(5,)]
    _, out, _ = run(capsys, "improve", path, "--seconds", 0.1)
    assert "improved       1\n" in out
    assert "lower bound    1" in out


def test_an_interrupt_keeps_the_best_path_so_far() -> None:
    """The search ends with what it has found, which is better than the class and checked."""
    path = random_walk("agv:graph=grid6x6,n=5", 300, 1)
    where = scene("agv:graph=grid6x6,n=5")
    better: list[Improvement] = []

    def interrupt(_stage: str, _steps: int) -> None:
        if better:
            raise KeyboardInterrupt

    task = PathTask(tuple(path), where.start_state, where.system)
    known = beyond(task, iterations=10_000, max_states=10, watch=better.append, tick=interrupt)
    assert better
    assert known.improved == better[-1].cubes < len(normal_cube_path(path))
    assert end_state(known.cube_path, where.start_state) == end_state(path, where.start_state)
