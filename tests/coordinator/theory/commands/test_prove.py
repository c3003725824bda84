"""``improve --prove``: what it says, writes and refuses, and how it is ended."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.theory.optimality import stages
from oracles.minimal_checker import check
from processes.command_line import GOLDEN, PYTHON, ROOT, cubepath
from processes.living import is_there

HEX = str(GOLDEN / "hex-5.mcap")
GRID = str(ROOT / "tests" / "data" / "agv" / "grid8-12agents.json")
ALGAE = str(ROOT / "tests" / "data" / "agv" / "cgshop2021-algae.json")
Capture = pytest.CaptureFixture[str]
PROVE = ("--prove", "60", "--steps", "1")
"""Time for the proof alone: other stages are bounded by steps."""
ENDLESS = ("--prove", "600", "--steps", "1", "--max-states", "9")
"""The proof begins at once, and is not soon over."""


def document(capsys: Capture, *arguments: str) -> dict[str, Any]:
    """Return the JSON document of a command that must be done."""
    assert main([*arguments, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def stage(found: dict[str, Any], name: str = "proof") -> dict[str, Any]:
    """Return what a stage spent."""
    (told,) = (each for each in found["spent"] if each["stage"] == name)
    return dict(told)


@pytest.mark.thorough
def test_the_time_of_a_command_includes_its_search(capsys: Capture) -> None:
    """The seconds of the command are no fewer than those of its longest stage."""
    found = document(capsys, "improve", HEX, "--seconds", "0.5", "--max-states", "9")
    longest = max(each["seconds"] for each in found["spent"])
    assert found["seconds"] >= longest - 0.001
    assert longest > 0.05


@pytest.mark.thorough
def test_the_optimum_is_proved_and_written(tmp_path: Path, capsys: Capture) -> None:
    """The schedule comes out like any other, and the proof beside it."""
    cubes, proof = tmp_path / "cubes.jsonl", tmp_path / "path.proof"
    options = (*PROVE, "--max-states", "9", "--proof", str(proof), "-o", str(cubes))
    found = document(capsys, "improve", HEX, *options)
    keys = ("improved", "lower_bound", "optimal", "proved_by", "agreed", "proof")
    assert [found[key] for key in keys] == [13, 13, True, "SAT solver", None, str(proof)]
    assert stage(found)["ended"] == "done"
    assert len(cubes.read_text().splitlines()) == 13
    assert check(proof.read_bytes())[:2] == (12, 13)
    assert [each["stage"] for each in found["spent"]].count("compile") == 1


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("seed", ["7", "1", "2"])
def test_all_seeds_find_the_same_numbers(seed: str, capsys: Capture) -> None:
    """The optimum is one, whatever the path."""
    options = (*PROVE, "--seed", seed, "--max-states", "9")
    found = document(capsys, "improve", HEX, *options)
    assert (found["improved"], found["lower_bound"], found["optimal"]) == (13, 13, True)


@pytest.mark.thorough
def test_vehicles_with_goals_of_their_own_keep_them(tmp_path: Path, capsys: Capture) -> None:
    """The clauses know labels, the schedule that is written does not."""
    cubes, proof = tmp_path / "cubes.jsonl", tmp_path / "grid.proof"
    options = (*PROVE, "--proof", str(proof), "-o", str(cubes))
    found = document(capsys, "improve", GRID, *options)
    assert (found["improved"], found["lower_bound"], found["optimal"]) == (11, 11, True)
    assert found["proof"] == str(proof)
    assert check(proof.read_bytes())[:2] == (10, 11)
    assert len(cubes.read_text().splitlines()) == 11


def moves_of(folder: Path, *moves: Sequence[str]) -> str:
    """Write self-contained moves, each from one site to another, and return the file."""
    path = folder / "moves.jsonl"
    lines = [
        {"id": number, "support": both, "trace": both, "before": [both[0]], "after": [both[1]]}
        for number, both in enumerate(map(list, moves))
    ]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return str(path)


@pytest.mark.parametrize("seconds", ["0", "0.01"])
def test_no_time_is_no_failure(seconds: str, tmp_path: Path, capsys: Capture) -> None:
    """What is known is told, and whether a proof was written; with no time at all there is none."""
    proof = tmp_path / "a.proof"
    assert main(["improve", GRID, "--prove", seconds, "--proof", str(proof)]) == 0
    told = capsys.readouterr().out
    none = "proof             none: no length was refuted by clauses" in told
    assert none != proof.exists()
    if seconds == "0":
        assert "optimal           not known" in told
        assert "(0 problems, out of time)" in told
        assert none


def test_a_file_that_is_not_written_is_left_as_it_was(tmp_path: Path, capsys: Capture) -> None:
    """So that nobody takes an earlier proof for one of this path, the summary says so."""
    proof = tmp_path / "a.proof"
    proof.write_text("of another path")
    assert main(["improve", GRID, "--prove", "0", "--proof", str(proof)]) == 0
    assert f"refuted by clauses; {proof} is left as it was\n" in capsys.readouterr().out
    assert proof.read_text() == "of another path"


def test_moves_of_a_file_alone(tmp_path: Path, capsys: Capture) -> None:
    """No others exist, so the clauses are about these."""
    moves = moves_of(tmp_path, "ab", "bc", "cd", "xy")
    proof = tmp_path / "a.proof"
    found = document(capsys, "improve", moves, "--prove", "60", "--proof", str(proof))
    assert (found["cubes"], found["improved"], found["lower_bound"]) == (3, 3, 3)
    assert (found["proved_by"], found["proof"]) == ("exhaustive search", str(proof))
    assert check(proof.read_bytes())[:2] == (2, 3)


@pytest.mark.parametrize("moves", [(), ("ab", "ab")])
def test_a_path_to_where_it_begins(moves: tuple[str, ...], tmp_path: Path, capsys: Capture) -> None:
    """Nothing is shorter than no cubes: there is no length to refute."""
    options = ("--prove", "60", "--proof", str(tmp_path / "a.proof"))
    found = document(capsys, "improve", moves_of(tmp_path, *moves), *options)
    assert (found["cubes"], found["improved"], found["optimal"]) == (0, 0, True)
    assert found["proof"] is None
    assert stage(found)["why"] == "a path without cubes needs no proof"


def test_one_round(tmp_path: Path, capsys: Capture) -> None:
    """No path has no round where the ends differ: the windows say so."""
    options = ("--prove", "60", "--proof", str(tmp_path / "a.proof"))
    found = document(capsys, "improve", moves_of(tmp_path, "ab", "xy"), *options)
    assert (found["cubes"], found["improved"], found["optimal"]) == (1, 1, True)
    assert found["proof"] is not None


@pytest.mark.thorough
def test_what_is_too_large_is_told_in_its_row(tmp_path: Path, capsys: Capture) -> None:
    """Why nothing was proved, without a proof file."""
    assert main(["improve", ALGAE, "--prove", "2", "--proof", str(tmp_path / "a.proof")]) == 0
    (row,) = (line for line in capsys.readouterr().out.splitlines() if " proof 0.0 s" in line)
    assert row.strip() == "proof 0.0 s (0 problems, clauses for 160 labels, 64 at most)"
    assert list(tmp_path.iterdir()) == []


def test_too_many_listed_moves_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """They are not looked at one by one."""
    monkeypatch.setattr(stages, "_LISTED_MAX", 2)
    moves = moves_of(tmp_path, "ab", "bc", "cd")
    found = document(capsys, "improve", moves, *PROVE, "--proof", str(tmp_path / "a.proof"))
    assert stage(found)["ended"] == "limit"
    assert stage(found)["why"] == "clauses for 3 moves, 2 at most"


def test_without_the_library_it_says_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """In one line, with exit code 2; other options need none."""
    for name in ("pysat", "pysolvers"):
        monkeypatch.setitem(sys.modules, name, None)
    assert main(["improve", HEX, "--prove", "1"]) == 2
    told = capsys.readouterr()
    expected = "cubepath: a proof takes the library python-sat: pip install 'cubepath[proofs]'\n"
    assert (told.out, told.err) == ("", expected)
    assert main(["improve", HEX, "--bounds"]) == 0


@pytest.mark.thorough
def test_an_interrupt_ends_it_as_the_time_does(tmp_path: Path) -> None:
    """With what is known by then; and no process and no file is left."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    line = [*PYTHON, "improve", chain(tmp_path), *ENDLESS, "--json"]
    where = os.environ | {"TMPDIR": str(temporary)}
    with subprocess.Popen(
        line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=where
    ) as command:
        wait_for_solvers(command.pid)
        command.send_signal(signal.SIGINT)
        out, told = command.communicate(timeout=100)
    assert (command.returncode, told) == (130, "cubepath: interrupted\n")
    found = json.loads(out)
    assert stage(found)["ended"] == "interrupt"
    assert 1 < found["lower_bound"] <= found["improved"] <= found["cubes"]
    assert list(temporary.iterdir()) == []


@pytest.mark.thorough
@pytest.mark.parametrize("by", [signal.SIGKILL, signal.SIGTERM])
def test_solvers_end_with_the_command(by: signal.Signals, tmp_path: Path) -> None:
    """However that ends."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    line = [*PYTHON, "improve", chain(tmp_path), *ENDLESS]
    where = os.environ | {"TMPDIR": str(temporary)}
    with subprocess.Popen(
        line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=where
    ) as command:
        solvers = wait_for_solvers(command.pid)
        command.send_signal(by)
        command.communicate(timeout=100)
    deadline = time.monotonic() + 30
    while any(map(is_there, solvers)) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not any(map(is_there, solvers))
    assert list(temporary.iterdir()) == []


def chain(folder: Path) -> str:
    """Return a recording whose optimum takes minutes to prove."""
    path = folder / "run.mcap"
    done = cubepath("run", "hex:n=11", "--processes", "0", "--log", path)
    assert done.returncode == 0, done.stderr
    return str(path)


def wait_for_solvers(parent: int) -> list[int]:
    """Return the processes of solvers, once one of them writes its log."""
    deadline = time.monotonic() + 90
    while time.monotonic() < deadline:
        found = [
            int(pid) for pid in Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
        ]
        if any(map(has_a_log, found)):
            return found
        time.sleep(0.02)
    raise TimeoutError("no solver began")


def has_a_log(pid: int) -> bool:
    """Return whether a solver writes, to a file without a name."""
    try:
        return any("(deleted)" in os.readlink(each) for each in Path(f"/proc/{pid}/fd").iterdir())  # noqa: PTH115 - a link that leads nowhere
    except OSError:
        return False
