"""Plans that do not end as their instance asks: shortened all the same, and told so."""

import json
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.shortening.conversion import convert
from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.protocol.file_forms import PlanHints
from processes.command_line import refused
from samples.plans import DATA, agents_text, log_text, save

TRAIN = json.loads((DATA / "train.instance.json").read_text())
STEPS = json.loads((DATA / "train.solution.json").read_text())["steps"]
SHORT = [*STEPS[:-1], {who: way for who, way in STEPS[-1].items() if who != "0"}]
KITE = json.loads((DATA / "kite.instance.json").read_text())
FLIPS = json.loads((DATA / "kite.solution.json").read_text())["flips"]
ROOM, SCENARIO = DATA / "room.map", DATA / "room.scen"
ROOM_STEPS = [
    [(1, 0), (2, 0), (4, 3)],
    [(2, 0), (2, 1), (4, 3)],
    [(2, 1), (2, 2), (4, 3)],
    [(2, 2), (2, 3), (4, 2)],
    [(1, 2), (2, 3), (4, 2)],
]
TWO_WAYS = {"N": "S", "S": "N"}
OTHER_WAYS = {"W": "E", "E": "W"}
TURNED = {"N": "E", "E": "N", "S": "W", "W": "S"}


def train(folder: Path, steps: object) -> tuple[Path, PlanHints]:
    instance = save(folder / "instance.json", TRAIN)
    solution = save(folder / "plan.json", {"instance": TRAIN["name"], "steps": steps})
    return solution, PlanHints(None, (instance,))


def kite(folder: Path, flips: object, chosen: int = 0) -> tuple[Path, PlanHints]:
    instance = save(folder / "instance.json", KITE)
    solution = save(folder / "plan.json", {"instance_uid": KITE["instance_uid"], "flips": flips})
    return solution, PlanHints(f"cgshop2026:triangulation={chosen}", (instance,))


def room(folder: Path, text: str) -> tuple[Path, PlanHints]:
    return save(folder / "plan.txt", text), PlanHints(None, (ROOM, SCENARIO))


def command(source: Path, hints: PlanHints, *more: str) -> list[str]:
    beside = [word for path in hints.companions for word in ("--with", str(path))]
    spec = [] if hints.format is None else ["--format", hints.format]
    return ["shorten", str(source), *beside, *spec, *more]


CASES: dict[str, tuple[Any, Any, str]] = {
    "2021, no steps": (
        train,
        [],
        (
            "4 of 4 robots end off their targets, the first is robot 0: it ends at [1,1],"
            " expected [3,3]"
        ),
    ),
    "2021, one stops early": (
        train,
        SHORT,
        "1 of 4 robots ends off its target, the first is robot 0: it ends at [2,3], expected [3,3]",
    ),
    "2026, the other does not flip": (
        kite,
        [FLIPS[0], []],
        (
            "1 other triangulation does not end as triangulation 0 does, the first is triangulation"
            " 1: it lacks edge [0, 2], expected all to end alike"
        ),
    ),
    "2026, the other cannot flip": (
        kite,
        [FLIPS[0], [[[0, 1]]]],
        (
            "1 other triangulation does not end as triangulation 0 does, the first is triangulation"
            " 1: flip of [0, 1]: on the hull"
        ),
    ),
    "a log whose goals are others": (
        lambda folder, text: (save(folder / "plan.txt", text), PlanHints(None, (ROOM,))),
        log_text(ROOM_STEPS, goals="(1,2),(2,3),(4,3),"),
        "1 of 3 agents ends off its target, the first is agent 2: it ends at [4,2], expected [4,3]",
    ),
    "paths against a scenario": (
        room,
        agents_text(ROOM_STEPS[:-1]),
        "1 of 3 agents ends off its target, the first is agent 0: it ends at [2,2], expected [1,2]",
    ),
    "a scenario": (
        lambda folder, text: (save(folder / "plan.json", text), PlanHints()),
        {
            "grid": [3, 2],
            "starts": [[0, 0], [2, 0]],
            "goals": [[1, 0], [2, 1]],
            "moves": [[[2, 0], [2, 1]]],
        },
        (
            "1 of 2 vehicles ends off the goals, the first is vehicle 0: it ends at [0,0], its own"
            " goal is [1,0]"
        ),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_a_plan_that_ends_elsewhere_is_a_failed_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """The answer comes, a line says how many are off and which is the first, exit code 1."""
    write, content, told = CASES[name]
    source, hints = write(tmp_path, content)
    cubes = tmp_path / "cubes.jsonl"
    assert main(command(source, hints, "--json", "-o", str(cubes))) == 1
    out, err = capsys.readouterr()
    assert json.loads(out)["cubes"] == len(cubes.read_text().splitlines())
    assert err.startswith(f"cubepath: {source}: the plan does not solve its instance: {told}")
    assert err.count("\n") == 1
    assert (
        shorten(source, format=hints.format, companions=hints.companions).given.unsolved or ""
    ).startswith(told)


def test_a_converted_plan_is_told_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The moves are written, and the exit code is 1."""
    source, hints = train(tmp_path, SHORT)
    target = tmp_path / "moves.jsonl"
    words = command(source, hints)[1:]
    assert main(["shorten", *words[:1], "--convert", "-o", str(target), *words[1:]]) == 1
    assert len(target.read_text().splitlines()) == sum(map(len, SHORT))
    assert "1 of 4 robots ends off its target" in capsys.readouterr().err
    assert "1 of 4 robots" in (convert(source, target, hints=hints).unsolved or "")


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("picture", ["plan.svg", "plan.gif"])
def test_a_plan_that_is_drawn_is_told_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], picture: str
) -> None:
    """The picture is there, the line on standard error is that of shorten, and the exit code is 1.

    A plan that solves its instance is drawn without a word.
    """
    source, hints = train(tmp_path, SHORT)
    assert main(command(source, hints)) == 1
    told = capsys.readouterr().err
    target = tmp_path / picture
    for steps, code, line in ((SHORT, 1, told), (STEPS, 0, "")):
        train(tmp_path, steps)
        assert main(["view", *command(source, hints, "-o", str(target))[1:]]) == code
        assert capsys.readouterr().err == line
        target.unlink()


@pytest.mark.parametrize("name", ["train", "kite 0", "kite 1", "log", "agents", "scenario"])
def test_a_plan_that_solves_its_instance_is_not_told(tmp_path: Path, name: str) -> None:
    """Exit code 0, for each format that has targets; vehicles of a scenario may exchange goals."""
    source, hints = {
        "train": lambda: train(tmp_path, STEPS),
        "kite 0": lambda: kite(tmp_path, FLIPS, 0),
        "kite 1": lambda: kite(tmp_path, FLIPS, 1),
        "log": lambda: room(tmp_path, log_text(ROOM_STEPS)),
        "agents": lambda: room(tmp_path, agents_text(ROOM_STEPS)),
        "scenario": lambda: (
            save(
                tmp_path / "plan.json",
                {
                    "grid": [3, 1],
                    "starts": [[0, 0], [2, 0]],
                    "goals": [[2, 0], [1, 0]],
                    "moves": [[[0, 0], [1, 0]]],
                },
            ),
            PlanHints(),
        ),
    }[name]()
    assert main(command(source, hints)) == 0
    assert shorten(source, format=hints.format, companions=hints.companions).given.unsolved is None


def test_a_scenario_without_moves_is_no_plan(tmp_path: Path) -> None:
    """It is a place to start from, so nothing is expected of its end."""
    source = save(tmp_path / "s.json", {"grid": [3, 1], "starts": [[0, 0]], "goals": [[1, 0]]})
    assert main(["shorten", str(source)]) == 0


def test_a_vehicle_that_moves_twice_in_a_round(tmp_path: Path) -> None:
    """Legal one after the other, these moves are no round: refused also where none follow."""
    moves = [[[0, 0], [1, 0]], [[1, 0], [1, 1]]]
    given = {"grid": [2, 2], "starts": [[0, 0]], "goals": [[1, 1]], "moves": moves, "rounds": [2]}
    source = save(tmp_path / "twice.json", given)
    assert refused("shorten", str(source)) == (
        f"cubepath: {source}: round 1, [1,0] is empty, expected a vehicle"
    )
