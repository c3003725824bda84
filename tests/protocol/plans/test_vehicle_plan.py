"""Plans of vehicles with the planner's rounds, in every format that has vehicles."""

import json
from pathlib import Path
from typing import Any

import pytest

from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.file_forms import read_plan
from cubepath.protocol.plans.imported import VehicleMove, VehiclePlan
from faces import ROOT

IMPORTS = ROOT / "tests" / "data" / "imports"
RING = [[0, 0], [1, 0], [1, 1], [0, 1]]
AHEAD = [*RING[1:], RING[0]]


def vehicles(path: Path, *companions: Path) -> VehiclePlan:
    found = read_plan(path, companions=companions)
    assert found.vehicles is not None
    return found.vehicles()


def scenario(tmp_path: Path, **keys: Any) -> VehiclePlan:
    path = tmp_path / "plan.json"
    path.write_text(json.dumps({"starts": RING, "goals": AHEAD, "grid": [2, 2]} | keys))
    return vehicles(path)


def rounds(plan: VehiclePlan) -> list[tuple[int, int | None]]:
    return [(move.vehicle, move.round) for move in plan.moves]


def test_a_rotation_in_lists_of_cells(tmp_path: Path) -> None:
    """All four move in round 1, each after the one that it makes room for."""
    plan, free = tmp_path / "plan.json", tmp_path / "free.map"
    free.write_text("type octile\nheight 2\nwidth 2\nmap\n..\n..\n")
    plan.write_text(json.dumps([[here, there] for here, there in zip(RING, AHEAD, strict=True)]))
    found = vehicles(plan, free)
    assert rounds(found) == [(0, 1), (3, 1), (2, 1), (1, 1)]
    assert (found.rounds, found.called, list(found.ends)) == (1, "agent", [*map(tuple, AHEAD)])
    assert len(found.edges()) == 4


def test_a_rotation_of_cgshop2021(tmp_path: Path) -> None:
    """The competition has no such step, which is up to who reads the plan by its rule."""
    instance, solution = tmp_path / "instance.json", tmp_path / "solution.json"
    targets = {"name": "r", "obstacles": [], "starts": RING, "targets": AHEAD}
    instance.write_text(json.dumps(targets))
    steps = [{"0": "E", "1": "N", "2": "W", "3": "S"}, {}]
    solution.write_text(json.dumps({"instance": "r", "steps": steps}))
    found = vehicles(solution, instance)
    assert rounds(found) == [(0, 1), (3, 1), (2, 1), (1, 1)]
    assert (found.rounds, found.called, found.unsolved) == (2, "robot", None)


@pytest.mark.parametrize(
    ("name", "companion"),
    [("train.solution.json", "train.instance.json"), ("lacam.txt", "room.map")],
)
def test_the_moves_are_those_of_the_path(name: str, companion: str) -> None:
    """Without rotations the same moves come in the same order, and rounds never decrease."""
    path = read_plan(IMPORTS / name, companions=[IMPORTS / companion])
    named = [move.name.at for move in path.moves if isinstance(move.name, GeneratorPlacement)]
    plan = vehicles(IMPORTS / name, IMPORTS / companion)
    assert [tuple(sorted((move.source, move.target))) for move in plan.moves] == named
    numbers = [move.round or 0 for move in plan.moves]
    assert numbers == sorted(numbers)
    assert numbers[-1] <= (plan.rounds or 0)


def test_a_scenario_with_rounds(tmp_path: Path) -> None:
    """Empty rounds count, and a rotation is one round."""
    moves = [list(pair) for pair in zip(RING, AHEAD, strict=True)]
    found = scenario(tmp_path, moves=moves, rounds=[0, 4])
    assert rounds(found) == [(0, 2), (3, 2), (2, 2), (1, 2)]
    assert (found.rounds, found.unsolved) == (2, None)


@pytest.mark.parametrize("order", [[0, 1, 2], [0, 2, 1], [1, 0, 2], [2, 1, 0]])
def test_the_order_of_moves_in_a_round_says_nothing(tmp_path: Path, order: list[int]) -> None:
    """Each vehicle follows the one ahead, in whatever order the file lists them."""
    train = [[[x, 0], [x + 1, 0]] for x in range(3)]
    path = tmp_path / "train.json"
    keys = {"grid": [4, 1], "starts": [a for a, _ in train], "goals": [b for _, b in train]}
    keys |= {"moves": [train[which] for which in order], "rounds": [3]}
    path.write_text(json.dumps(keys))
    found = read_plan(path)
    assert [set(move.before or ()) for move in found.moves] == [{(2, 0)}, {(1, 0)}, {(0, 0)}]
    assert rounds(vehicles(path)) == [(2, 1), (1, 1), (0, 1)]


def test_a_scenario_without_rounds(tmp_path: Path) -> None:
    """Its moves are one after another, and nothing is said of rounds."""
    found = scenario(
        tmp_path, starts=[[0, 0]], goals=[[1, 1]], moves=[[[0, 0], [1, 0]], [[1, 0], [1, 1]]]
    )
    assert found.moves[1] == VehicleMove(0, (1, 0), (1, 1), None)
    assert found.rounds is None


FIRST: list[list[int]] = [[0, 0], [1, 0]]


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"moves": [FIRST], "rounds": [2]}, "rounds of 2 moves, expected as many as there are"),
        ({"moves": [FIRST], "rounds": [-1]}, "Expected `int` >= 0"),
        (
            {"moves": [], "rounds": [0], "peer_makespan": 3},
            "peer_makespan 3 and 1 rounds, expected the same number",
        ),
        (
            {"moves": [FIRST], "rounds": [1]},
            "round 1, vehicle 0, [0,0] to [1,0]: [1,0] is occupied by vehicle 1, which stays",
        ),
        (
            {"moves": [FIRST, FIRST[::-1]], "rounds": [2]},
            "round 1, vehicle 0, [0,0] to [1,0]: vehicle 1 comes the other way",
        ),
        (
            {"moves": [FIRST, [[0, 0], [0, 1]]], "rounds": [2]},
            "round 1, vehicle 0 moves twice, expected once",
        ),
        ({"moves": [[[0, 0], [0, 0]]], "rounds": [1]}, "round 1, vehicle 0 stays at [0,0]"),
        ({"moves": [[[5, 0], [0, 0]]], "rounds": [1]}, "round 1, [5,0] is empty"),
        ({"moves": [FIRST]}, "move 1, vehicle 0, [0,0] to [1,0]: [1,0] is occupied by vehicle 1"),
        ({"moves": [[[0, 0], [-1, 0]]], "rounds": [1]}, "an obstacle or outside, expected free"),
    ],
)
def test_bad_scenarios(tmp_path: Path, keys: dict[str, Any], said: str) -> None:
    """One line says where, who, what was found and what was expected."""
    with pytest.raises(InputError) as error:
        scenario(tmp_path, **keys)
    assert said in str(error.value)
