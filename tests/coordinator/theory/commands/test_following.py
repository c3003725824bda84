"""``cubepath improve --following`` and ``cubepath verify`` of what it writes."""

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
    "moves": [[[0, 0], [1, 0]], [[1, 0], [1, 1]], [[1, 1], [0, 1]], [[0, 1], [0, 0]]],
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
    """The rounds asked for stand first; the planner has 66, the class 114 cubes; all is proved."""
    given, output = AGV / "cgshop2021-algae.json", tmp_path / "follow.jsonl"
    code, found, _ = answered(capsys, "improve", given, "--following", rule, "-o", output)
    assert (code, found["cubes"], found["planner_rounds"]) == (0, 114, 66)
    assert list(found)[:5] == ["following", "rounds", "makespan", "rotations", "chain"]
    assert [found[key] for key in list(found)[:4]] == [rule, rounds, rounds, 0]
    code, checked, _ = answered(capsys, "verify", output, "--of", given)
    assert (code, checked["ok"], checked["rounds"]) == (0, True, rounds)


def test_a_rotation(capsys: pytest.CaptureFixture[str], ring: Path, tmp_path: Path) -> None:
    """It has no cubes, one round, and a timetable that is proved."""
    output = tmp_path / "ring.jsonl"
    code, found, _ = answered(capsys, "improve", ring, "--following", "mapf", "-o", output)
    assert (code, found["cubes"], found["reduced_moves"]) == (0, None, 4)
    assert (found["rounds"], found["rotations"]) == (1, 1)
    assert answered(capsys, "verify", output, "--of", ring)[0] == 0


def test_a_changed_file_fails_its_check(
    capsys: pytest.CaptureFixture[str], ring: Path, tmp_path: Path
) -> None:
    """The exit code is 1, and the line names the check."""
    output = tmp_path / "ring.jsonl"
    main(["improve", str(ring), "--following", "mapf", "-o", str(output)])
    output.write_text(output.read_text().replace('"rule":"mapf"', '"rule":"cgshop"'))
    capsys.readouterr()
    code, found, error = answered(capsys, "verify", output, "--of", ring)
    assert (code, found["ok"]) == (1, False)
    assert error == f"cubepath: {output}: checks failed: rule\n"


def test_the_chain_in_words(capsys: pytest.CaptureFixture[str]) -> None:
    """Robots of CG:SHOP 2021 that follow in one direction."""
    plan, instance = TRAIN / "train.solution.json", TRAIN / "train.instance.json"
    code = main(
        ["improve", str(plan), "--with", str(instance), "--following", "cgshop", "--explain"]
    )
    out = capsys.readouterr().out
    assert code == 0
    assert out.startswith("following         cgshop\nrounds            ")
    assert "each of which binds the next" in out
    assert "Checked, so proved: under the rule cgshop" in out


def test_unequal_times_write_when_moves_begin_and_end(
    capsys: pytest.CaptureFixture[str], ring: Path, tmp_path: Path
) -> None:
    """Exact fractions, as in other timetables."""
    output = tmp_path / "ring.jsonl"
    options = ["--following", "mapf", "--durations", "edge=1.5", "-o", output]
    code, found, _ = answered(capsys, "improve", ring, *options)
    assert (code, found["makespan"], found["rounds"]) == (0, "3/2", None)
    assert '"start":0,"end":"3/2"' in output.read_text()
    assert answered(capsys, "verify", output, "--of", ring)[1]["makespan"] == "3/2"


def test_no_other_command_takes_it_for_a_path(
    capsys: pytest.CaptureFixture[str], ring: Path, tmp_path: Path
) -> None:
    """Neither shortening nor converting nor drawing: its moves do not commute."""
    output = tmp_path / "ring.jsonl"
    main(["improve", str(ring), "--following", "mapf", "-o", str(output)])
    capsys.readouterr()
    for command in (
        ["shorten", output],
        ["shorten", output, "--convert", "-o", tmp_path / "moves.npz"],
        ["view", output],
        ["improve", output, "--following", "mapf"],
    ):
        code, _, error = answered(capsys, *command)
        assert code == 2
        assert "a timetable of vehicles that follow" in error


def test_an_unsolved_plan_is_told(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """As without the option: a line on standard error, and exit code 1."""
    path = tmp_path / "ring.json"
    goals = [[1, 0], [1, 1], [0, 1], [2, 0]]
    path.write_text(json.dumps({**RING, "goals": goals, "grid": [3, 2]}))
    code, found, error = answered(capsys, "improve", path, "--following", "mapf")
    assert (code, found["rounds"]) == (1, 1)
    assert "the plan does not solve its instance: 1 of 4 vehicles ends off the goals" in error


CROSSING: dict[str, Any] = {
    "grid": [3, 3],
    "starts": [[0, 1], [1, 0]],
    "goals": [[2, 1], [1, 2]],
    "moves": [[[0, 1], [1, 1]], [[1, 1], [2, 1]], [[1, 0], [1, 1]], [[1, 1], [1, 2]]],
    "rounds": [1, 1, 1, 1],
}


def test_a_proof_is_written_and_verified(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Two that cross take four rounds by the rule of CG:SHOP, and no plan takes three."""
    pytest.importorskip("pysat.solvers")
    given, proof = tmp_path / "crossing.json", tmp_path / "crossing.proof"
    given.write_text(json.dumps(CROSSING))
    options = ["--following", "cgshop", "--prove", "60", "--proof", proof]
    code, found, _ = answered(capsys, "improve", given, *options)
    assert (code, found["optimal"], found["proof"]) == (0, True, str(proof))
    assert (found["improved"], found["lower_bound"], found["agreed"]) == (4, 4, None)
    cnf, drat = tmp_path / "a.cnf", tmp_path / "a.drat"
    code, checked, _ = answered(capsys, "verify", proof, "--of", given, "-o", cnf, "-o", drat)
    assert (code, checked["ok"], checked["optimal"]) == (0, True, True)
    assert (checked["following"], checked["refuted"], checked["rounds"]) == ("cgshop", 3, 4)
    assert cnf.read_bytes().startswith(
        b"p cnf %d %d\n" % (checked["variables"], checked["clauses"])
    )
    assert cnf.read_bytes().count(b"\n") == checked["clauses"] + 1
    assert main(["verify", str(proof)]) == 0
    out = capsys.readouterr().out
    assert "under the rule cgshop no timetable of 3 rounds or fewer" in out
    assert "the timetable has 4: optimal" in out
    graph = checked["graph"]
    assert (graph["vertices"], graph["edges"], checked["vehicles"]) == (9, 12, 2)
    assert (checked["starts"], checked["ends"]) == (CROSSING["starts"], CROSSING["goals"])
    assert f"graph      9 vertices, 12 edges, SHA-256 {graph['sha256']}\n" in out
    assert "starts     [[0,1],[1,0]]\nends       [[2,1],[1,2]]\n" in out


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"goals": [[1, 2], [2, 1]]}, ""),
        ({"grid": [4, 3]}, "has another workspace"),
        (
            {"starts": [[0, 1], [1, 0], [0, 0]], "goals": [[2, 1], [1, 2], [0, 0]]},
            "has 3 vehicles, the proof 2",
        ),
        ({"moves": CROSSING["moves"][:3], "rounds": [1, 1, 1]}, "vehicle 1 ends at [1,1]"),
    ],
)
def test_a_proof_is_of_its_input(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, changes: dict[str, Any], why: str
) -> None:
    """Starts, ends and workspace must be those of the proof; goals that are not reached are not."""
    pytest.importorskip("pysat.solvers")
    given, proof = tmp_path / "crossing.json", tmp_path / "crossing.proof"
    given.write_text(json.dumps(CROSSING))
    options = ["--following", "mapf", "--prove", "60", "--proof", str(proof)]
    assert main(["improve", str(given), *options]) == 0
    given.write_text(json.dumps(CROSSING | changes))
    capsys.readouterr()
    code, _, error = answered(capsys, "verify", proof, "--of", given)
    assert (code, why in error) == (int(bool(why)), True)


def test_a_changed_proof_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """With the block and the byte at which it begins, and exit code 1; no proof is a path."""
    pytest.importorskip("pysat.solvers")
    given, proof = tmp_path / "crossing.json", tmp_path / "crossing.proof"
    given.write_text(json.dumps(CROSSING))
    main(["improve", str(given), "--following", "cgshop", "--prove", "60", "--proof", str(proof)])
    capsys.readouterr()
    code, _, error = answered(capsys, "shorten", proof)
    assert (code, "a proof of optimality, expected a path" in error) == (2, True)
    data = bytearray(proof.read_bytes())
    data[len(data) // 2] ^= 1
    proof.write_bytes(data)
    code, found, error = answered(capsys, "verify", proof)
    assert (code, found["ok"]) == (1, False)
    assert "block " in error
    assert "it was changed" in error
    assert error.count("\n") == 1
