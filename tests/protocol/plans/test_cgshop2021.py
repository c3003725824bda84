"""CG:SHOP 2021: steps of many moves become moves one after the other, or are refused."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings

from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.file_forms import read_plan
from cubepath.protocol.systems.graphs import scenario_from_json
from samples.plans import (
    DATA,
    Steps,
    actions_read,
    moves_read,
    save,
    steps_2021,
    timesteps,
    vehicle_moves,
)
from samples.strategies import Word, scene, walks

AGV = Path(__file__).parents[2] / "data" / "agv"
SOLUTION, INSTANCE = DATA / "train.solution.json", DATA / "train.instance.json"
VEHICLES = "agv:graph=grid3x3,n=3"


def pair(folder: Path, steps: Steps, **instance: Any) -> tuple[Path, Path]:
    """Save a plan as solution and instance."""
    first, second = steps_2021(steps, [(9, 9)])
    known = {key: value for key, value in {**first, **instance}.items() if value is not None}
    return save(folder / "s.json", second), save(folder / "i.json", known)


def test_the_sample_train() -> None:
    """Three robots that follow one another in one step move from the head on."""
    found = read_plan(SOLUTION, companions=[INSTANCE])
    assert found is not None
    assert found.rounds == 4
    moves = list(found.moves)
    first = [(1, 1), (1, 0), (1, -1), (4, 0)]
    assert [move.before for move in moves[:4]] == [frozenset({cell}) for cell in first]
    assert (len(moves), len(normal_cube_path([move.action for move in moves]))) == (12, 5)
    where = found.scene()
    # The box of all that is named, [1, -1] to [4, 3], and one cell more.
    assert where.system.has_place((0, -2))
    assert where.system.has_place((5, 4))
    assert not where.system.has_place((6, 4))
    assert not where.system.has_place((2, 1))


def test_the_workspace_holds_what_is_visited(tmp_path: Path) -> None:
    """A robot may leave the box of the instance: the plane is not bounded."""
    solution, instance = pair(tmp_path, [[(0, 0)], [(-1, 0)], [(-2, 0)], [(-1, 0)]])
    found = read_plan(solution, companions=[instance])
    assert found is not None
    assert len(list(found.moves)) == 3
    assert found.scene().system.has_place((-3, 0))


@pytest.mark.slow
def test_a_real_solution_as_steps(tmp_path: Path) -> None:
    """The solution of algae_00000_20x20_40_160, put into steps again, has the known figures."""
    known = scenario_from_json(AGV / "cgshop2021-algae.json")
    solution, instance = pair(
        tmp_path,
        timesteps(known.starts, known.moves),  # type: ignore[arg-type]
        targets=known.goals,
        obstacles=[],
    )
    cubes = normal_cube_path(actions_read(solution, companions=[instance]))
    assert (sum(map(len, cubes)), len(cubes)) == (4719, 114)


@settings(max_examples=20, deadline=None)
@given(walks(VEHICLES))
def test_a_solution_read_back_is_the_path(
    tmp_path_factory: pytest.TempPathFactory, word: Word
) -> None:
    """A random legal plan as steps gives the normal cube path of the moves themselves."""
    where = scene(VEHICLES)
    steps = timesteps(where.start, vehicle_moves(word, where.start_state))  # type: ignore[arg-type]
    solution, instance = pair(tmp_path_factory.mktemp("plan"), steps)
    assert normal_cube_path(actions_read(solution, companions=[instance])) == normal_cube_path(word)


ROTATION: Steps = [
    [(5, 5), (0, 0), (1, 0), (1, 1), (0, 1)],
    [(5, 6), (1, 0), (1, 1), (0, 1), (0, 0)],
]
BAD: dict[str, tuple[Steps, str]] = {
    "rotation": (
        ROTATION,
        "steps[0], robot 1, [0,0] to [1,0]: robots 1, 2, 3 and 4 rotate, each into the cell that",
    ),
    "swap": (
        [[(0, 0), (1, 0)], [(0, 1), (1, 0)], [(0, 0), (1, 0)], [(1, 0), (0, 0)]],
        "steps[2], robot 0, [0,0] to [1,0]: robot 1 comes the other way",
    ),
    "occupied": (
        [[(0, 0), (1, 0)], [(1, 0), (1, 0)]],
        "steps[0], robot 0, [0,0] to [1,0]: [1,0] is occupied by robot 1, which stays",
    ),
    "obstacle": ([[(9, 8)], [(9, 9)]], "robot 0, [9,8] to [9,9]: [9,9] is an obstacle"),
}


@pytest.mark.parametrize("name", BAD)
def test_an_illegal_solution_is_refused_at_its_first_bad_move(tmp_path: Path, name: str) -> None:
    """The step, the robots, the move, and what is in its way."""
    steps, told = BAD[name]
    solution, instance = pair(tmp_path, steps)
    with pytest.raises(InputError) as caught:
        moves_read(solution, companions=[instance])
    assert str(caught.value).startswith(f"{solution}: ")
    assert told in str(caught.value)


BAD_ROBOTS = {
    "unknown": ({"2": "E"}, 'steps[0], robot "2": expected a number, 0 to 1'),
    "no number": ({"-1": "E"}, 'steps[0], robot "-1": expected a number'),
    "direction": ({"1": "X"}, 'steps[0], robot 1 goes "X", expected N, E, S or W'),
    "twice": ({"1": "E", "01": "N"}, "steps[0], robot 1 is named twice"),
}


@pytest.mark.parametrize("name", BAD_ROBOTS)
def test_a_step_that_is_none_is_refused(tmp_path: Path, name: str) -> None:
    """The step, the robot, and what was expected."""
    step, told = BAD_ROBOTS[name]
    _, instance = pair(tmp_path, [[(0, 0), (1, 0)]])
    solution = save(tmp_path / "s.json", {"instance": "test", "steps": [step]})
    with pytest.raises(InputError) as caught:
        moves_read(solution, companions=[instance])
    assert told in str(caught.value)


def test_instances_that_do_not_belong_are_refused(tmp_path: Path) -> None:
    """Another name, missing targets, robots on one place, no instance, or two of them."""
    plan: Steps = [[(0, 0), (1, 0)]]
    for change, told in (
        ({"name": "other"}, "a solution of 'test', but .* is 'other'"),
        ({"targets": []}, "2 starts and 0 targets"),
        ({"starts": [[1, 0], [1, 0]]}, "robot 0 and robot 1 start at"),
        ({"starts": None}, "missing required field `starts`"),
    ):
        solution, instance = pair(tmp_path, plan, **change)
        with pytest.raises(InputError, match=told):
            read_plan(solution, companions=[instance])
    with pytest.raises(InputError, match="says nothing of its instance: expected --with FILE"):
        read_plan(SOLUTION)
    with pytest.raises(InputError, match="a second file beside the plan"):
        read_plan(SOLUTION, companions=[INSTANCE, INSTANCE])
    with pytest.raises(InputError, match="expected no --system"):
        read_plan(SOLUTION, companions=[INSTANCE], system=VEHICLES)
