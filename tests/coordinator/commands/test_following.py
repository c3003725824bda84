"""``cubepath shorten --following`` and ``cubepath verify`` of what it writes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.commands.main import main
from faces import ROOT

AGV = ROOT / "tests" / "data" / "agv"
TRAIN = ROOT / "tests" / "data" / "imports"
RING = {
    "grid": [2, 2],
    "starts": [[0, 0], [1, 0], [1, 1], [0, 1]],
    "goals": [[1, 0], [1, 1], [0, 1], [0, 0]],
    "moves": [
        [[0, 0], [1, 0]],
        [[1, 0], [1, 1]],
        [[1, 1], [0, 1]],
        [[0, 1], [0, 0]],
    ],
    "rounds": [4],
}


@pytest.fixture
def ring(tmp_path: Path) -> Path:
    path = tmp_path / "ring.json"
    path.write_text(json.dumps(RING))
    return path


def answered(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, Any, str]:
    code = main([*map(str, arguments), "--json"])
    out, error = capsys.readouterr()
    return code, json.loads(out) if out else None, error


@pytest.mark.parametrize(("rule", "rounds"), [("mapf", 51), ("cgshop", 56)])
def test_algae_beside_its_cubes(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, rule: str, rounds: int
) -> None:
    """The planner has 66 rounds, the class 114 cubes; the file written is proved."""
    given, output = AGV / "cgshop2021-algae.json", tmp_path / "follow.jsonl"
    code, found, _ = answered(capsys, "shorten", given, "--following", rule, "-o", output)
    assert (code, found["cubes"], found["planner_rounds"]) == (0, 114, 66)
    assert found["following"] | {"chain": 0} == {
        "rule": rule,
        "rounds": rounds,
        "makespan": rounds,
        "rotations": 0,
        "chain": 0,
    }
    code, checked, _ = answered(capsys, "verify", output, "--of", given)
    assert (code, checked["ok"], checked["rounds"]) == (0, True, rounds)


def test_a_rotation(capsys: pytest.CaptureFixture[str], ring: Path, tmp_path: Path) -> None:
    """It has no cubes, one round, and a timetable that is proved."""
    output = tmp_path / "ring.jsonl"
    code, found, _ = answered(capsys, "shorten", ring, "--following", "mapf", "-o", output)
    assert (code, found["cubes"], found["reduced_moves"]) == (0, None, 4)
    assert (found["following"]["rounds"], found["following"]["rotations"]) == (1, 1)
    assert answered(capsys, "verify", output, "--of", ring)[0] == 0


def test_a_changed_file_fails_its_check(
    capsys: pytest.CaptureFixture[str], ring: Path, tmp_path: Path
) -> None:
    """The exit code is 1, and the line names the check."""
    output = tmp_path / "ring.jsonl"
    main(["shorten", str(ring), "--following", "mapf", "-o", str(output)])
    output.write_text(output.read_text().replace('"rule":"mapf"', '"rule":"cgshop"'))
    capsys.readouterr()
    code, found, error = answered(capsys, "verify", output, "--of", ring)
    assert (code, found["ok"]) == (1, False)
    assert error == f"cubepath: {output}: checks failed: rule\n"


def test_the_chain_in_words(capsys: pytest.CaptureFixture[str]) -> None:
    """Robots of CG:SHOP 2021 that follow in one direction."""
    plan, instance = TRAIN / "train.solution.json", TRAIN / "train.instance.json"
    code = main(
        ["shorten", str(plan), "--with", str(instance), "--following", "cgshop", "--explain"]
    )
    out = capsys.readouterr().out
    assert code == 0
    assert "following         cgshop" in out
    assert "each of which binds the next" in out
    assert "Checked, so proved: under the rule cgshop" in out


def test_unequal_times_write_when_moves_begin_and_end(
    capsys: pytest.CaptureFixture[str], ring: Path, tmp_path: Path
) -> None:
    """Exact fractions, as in other timetables."""
    output = tmp_path / "ring.jsonl"
    options = ["--following", "mapf", "--duration", "edge=1.5", "-o", output]
    code, found, _ = answered(capsys, "shorten", ring, *options)
    assert (code, found["following"]["makespan"], found["following"]["rounds"]) == (0, "3/2", None)
    assert '"start":0,"end":"3/2"' in output.read_text()
    assert answered(capsys, "verify", output, "--of", ring)[1]["makespan"] == "3/2"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--following", "cgshop"], "round 1: vehicles 0, 3, 2 and 1 rotate at [0, 0]"),
        (["--following", "mapf", "--improve", "1"], "--improve is for cubes"),
        (["--following", "mapf", "--improve", "0"], "--improve is for cubes"),
        (["--following", "mapf", "--bounds"], "--bounds is for cubes"),
        (["--following", "mapf", "--max-states", "9"], "--max-states is for cubes"),
        (["--following", "mapf", "--prove", "1", "--duration", "edge=2"], "--prove counts rounds"),
        (["--following", "mapf", "--prove", "1", "--proof", "a.proof"], "--proof is for cubes"),
        (["--following", "mapf", "--certificate", "a.json"], "--certificate is for cubes"),
        (["--following", "mapf", "-o", "a.npz"], "expected one of .jsonl"),
        (["--following", "mapf", "--with", "a.json"], "expected no --with"),
        (["--following", "mapf", "--system", "hex:n=5"], "expected no --system"),
        (["--following", "mapf", "--duration", "swim=2"], "'swim' is no generator"),
    ],
)
def test_what_does_not_fit_is_refused(
    capsys: pytest.CaptureFixture[str], ring: Path, options: list[str], said: str
) -> None:
    """One line, exit code 2."""
    code, _, error = answered(capsys, "shorten", ring, *options)
    assert code == 2
    assert said in error
    assert error.count("\n") == 1


def test_no_other_command_takes_it_for_a_path(
    capsys: pytest.CaptureFixture[str], ring: Path, tmp_path: Path
) -> None:
    """Neither shortening nor converting nor drawing: its moves do not commute."""
    output = tmp_path / "ring.jsonl"
    main(["shorten", str(ring), "--following", "mapf", "-o", str(output)])
    capsys.readouterr()
    for command in (
        ["shorten", output],
        ["convert", output, tmp_path / "moves.npz"],
        ["view", output],
        ["shorten", output, "--following", "mapf"],
    ):
        code, _, error = answered(capsys, *command)
        assert code == 2
        assert "a timetable of vehicles that follow" in error


def test_an_unsolved_plan_is_told(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """As without the option: a line on standard error, and exit code 1."""
    path = tmp_path / "ring.json"
    goals = [[1, 0], [1, 1], [0, 1], [2, 0]]
    path.write_text(json.dumps({**RING, "goals": goals, "grid": [3, 2]}))
    code, found, error = answered(capsys, "shorten", path, "--following", "mapf")
    assert (code, found["following"]["rounds"]) == (1, 1)
    assert "the plan does not solve its instance: 1 of 4 vehicles ends off the goals" in error
