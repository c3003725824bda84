"""``cubepath verify FILE.proof``: rows, documents, refusals and files for other checkers."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.protocol.core.actions import Action
from cubepath.protocol.path_files.optimality_proofs import OptimalityProof, read_proof, write_proof
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles.obvious_refutations import log_of, proof_of
from processes.command_line import refused

SPEC = "sliding:p=2,q=2"
LEFT = '{"id": "l", "support": [1, 2], "trace": [1, 2], "before": [1], "after": [2]}\n'
RIGHT = '{"id": "r", "support": [2, 3], "trace": [2, 3], "before": [2], "after": [3]}\n'


def sliding() -> OptimalityProof:
    from cubepath.coordinator.theory.search.exact import optimum
    from cubepath.coordinator.theory.search.transitions import Transitions

    scene = scene_from_spec(SPEC)
    goal = frozenset(scene.goal or ()) | scene.system.filled
    steps = Transitions(scene.system)
    cubes = optimum(steps, steps.encode(scene.start_state), steps.encode(goal)).cubes or ()
    found = proof_of(scene, [[steps.actions[move] for move in cube] for cube in cubes], goal)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("proofs") / "sliding.proof"
    write_proof(path, sliding())
    return path


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    code = main(["verify", *map(str, arguments)])
    out, err = capsys.readouterr()
    return code, out, err


def test_what_was_proved(written: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The rows say what is impossible, what there is, and what was checked for it."""
    code, out, err = run(capsys, written)
    assert (code, err) == (0, "")
    rows = dict(line.split(maxsplit=1) for line in out.splitlines())
    assert rows["proved"] == "no schedule of 7 rounds or fewer; the schedule has 8: optimal"
    assert (rows["variables"], rows["solver"]) == ("106", "cadical195")
    code, out, _ = run(capsys, written, "--json")
    document = json.loads(out)
    assert code == 0
    assert document.pop("seconds") >= 0
    assert document.pop("lemmas") > 0
    system, scene = document.pop("system"), scene_from_spec(SPEC)
    assert rows["system"] == f"{system['name']}, SHA-256 {system['sha256']}"
    assert system["name"] == scene.spec
    assert document.pop("start") == json.loads(rows["start"])
    goal = document.pop("goal")
    assert {tuple(site) for site in goal} == set(sliding().goal)
    assert json.loads(rows["goal"]) == goal
    assert document == {
        "ok": True, "refuted": 7, "cubes": 8, "optimal": True,
        "solver": "cadical195", "moves": 50, "variables": 106, "clauses": 724,
    }  # fmt: skip


def test_a_file_of_any_name(
    written: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A proof is known by its first line, whatever its file is called."""
    (tmp_path / "anything").write_bytes(written.read_bytes())
    assert run(capsys, tmp_path / "anything")[0] == 0


def test_refusals(written: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What is damaged or does not hold ends with exit code 1 and one line on why."""
    bad = tmp_path / "bad.proof"
    data = bytearray(written.read_bytes())
    data[100] ^= 1
    bad.write_bytes(data)
    code, out, err = run(capsys, bad)
    assert code == 1
    assert out.startswith("FAILED  block statement, byte 17: its CRC is")
    assert err.splitlines() == [f"cubepath: {bad}: refused: {out[8:].strip()}"]
    write_proof(bad, replace(read_proof(written), log=[]))
    code, out, err = run(capsys, bad, "--json")
    assert code == 1
    assert json.loads(out) == {
        "ok": False, "detail": "the log ends, and nothing is refuted yet"
    }  # fmt: skip
    bad.write_bytes(b"{}")
    assert "no proof" in refused("verify", str(bad))


def test_a_proof_of_an_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With --of the proof must be about the start, the end and the moves of that input."""
    left, right = Action([1, 2], [1, 2], [1], [2]), Action([2, 3], [2, 3], [2], [3])
    proof = OptimalityProof(
        system=None, start=[1], goal=[3], refuted=1, cubes=2,
        moves=[left, right], schedule=[[0], [1]],
    )  # fmt: skip
    write_proof(tmp_path / "a.proof", proof)
    (tmp_path / "both.jsonl").write_text(LEFT + RIGHT)
    (tmp_path / "one.jsonl").write_text(LEFT)
    code, out, _ = run(capsys, tmp_path / "a.proof", "--of", tmp_path / "both.jsonl")
    assert (code, "optimal" in out) == (0, True)
    assert "system     none, 2 listed moves\nstart      [1]\ngoal       [3]\n" in out
    code, _, err = run(capsys, tmp_path / "a.proof", "--of", tmp_path / "one.jsonl")
    assert code == 1
    assert "one.jsonl has another goal: 2 is on only there" in err


def test_files_for_other_checkers(
    written: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The clauses as DIMACS have no model, as another solve finds; the log is as in the proof."""
    cnf, drat = tmp_path / "a.cnf", tmp_path / "a.drat"
    assert run(capsys, written, "-o", cnf, "-o", drat)[0] == 0
    head, *lines = cnf.read_text().splitlines()
    assert head == "p cnf 106 724"
    clauses = [[int(each) for each in line.split()[:-1]] for line in lines]
    assert len(clauses) == 724
    assert log_of(106, clauses) is not None
    assert drat.read_bytes() == b"".join(read_proof(written).log)


@pytest.mark.parametrize("name", ["a.cnf", "a.drat"])
def test_a_full_disk_refutes_no_proof(
    name: str, written: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where a file for other checkers cannot be written, that alone is said, with exit code 1."""
    full = tmp_path / name
    full.symlink_to("/dev/full")
    code, out, err = run(capsys, written, "-o", full)
    assert (code, out) == (1, "")
    assert err == f"cubepath: {full}: cannot be written: No space left on device\n"


def test_clauses_of_a_changed_proof(
    written: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A proof whose clauses cannot be derived is refused before any file is written."""
    bad, cnf = tmp_path / "bad.proof", tmp_path / "bad.cnf"
    proof = read_proof(written)
    write_proof(bad, replace(proof, variables=proof.variables[:-1]))
    code, out, _ = run(capsys, bad, "-o", cnf)
    assert (code, out[:8]) == (1, "FAILED  ")
    assert not cnf.exists()
