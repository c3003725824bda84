"""`cubepath diff`: exit codes, JSON, files of moves, and what is refused."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from command_line import GOLDEN, refused
from cubepath.coordinator.commands.main import main
from cubepath.coordinator.comparison.comparing import diff
from recordings import new_path
from twin_runs import twin

HEX = str(GOLDEN / "hex-5.mcap")


@pytest.mark.parametrize("log", sorted(GOLDEN.glob("*.mcap")), ids=lambda path: path.stem)
def test_a_golden_recording_is_the_same_as_itself(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 0, also for a copy; with --json one document."""
    copy = shutil.copy(log, tmp_path / "copy.mcap")
    assert main(["diff", "--json", str(log), str(copy)]) == 0
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert document["same"]
    assert document["identical"]
    assert document["paths"]["identical"]
    assert document["message"] is document["choice"] is document["move"] is None


def test_runs_that_differ_end_with_1(capsys: pytest.CaptureFixture[str]) -> None:
    """And every key of the document is that of the result."""
    other = str(new_path(".mcap"))
    run = ["run", "hex:n=5", "--processes=0", "--seed=1", "--max-rounds=9", "--log", other]
    assert main(run) == 0
    capsys.readouterr()
    assert main(["diff", "--json", HEX, other]) == 1
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    found = diff(HEX, other)
    assert document.keys() == found.document().keys()
    assert document == json.loads(json.dumps(found.document()))
    assert document["choice"]["causes"]


def test_moves_are_compared_with_a_recording(capsys: pytest.CaptureFixture[str]) -> None:
    """The same path in another form, and one move less of it."""
    moves = new_path(".jsonl")
    assert main(["convert", HEX, str(moves)]) == 0
    capsys.readouterr()
    assert main(["diff", HEX, str(moves), "--system", "hex:n=5"]) == 0
    assert "no difference in what was done" in capsys.readouterr().out
    less = new_path(".jsonl")
    less.write_text("".join(moves.read_text().splitlines(keepends=True)[:-1]))
    assert main(["diff", HEX, str(less), "--system", "hex:n=5"]) == 1
    told = capsys.readouterr().out
    assert "first move      move 28: " in told
    assert "none in b" in told


def test_a_free_run_and_one_with_rounds_are_compared_by_their_moves() -> None:
    """They may be equal up to commuting, which then is said."""
    found = diff(GOLDEN / "hex-5.mcap", GOLDEN / "hex-free-5.mcap")
    assert found.clock == "moves"
    assert found.parameters["format"] == ("cubepath-recording-1", "cubepath-recording-3")
    assert found.paths is not None
    assert found.paths.same is None


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        ([HEX, "nothing.mcap"], "No such file"),
        ([HEX, HEX, "--rounds", "a"], "expected FIRST..LAST as 3..9, 3.. or ..9"),
        ([HEX, HEX, "--rounds", "5..2"], "expected 1 or more"),
        ([HEX, HEX, "--context", "-1"], "a whole number of at least 0"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], why: str) -> None:
    """What was found, and what was expected."""
    assert why in refused("diff", *arguments)


def test_the_text_has_the_places_of_the_result() -> None:
    """Top down: the answer, the choice, the message, the move, the paths."""
    found = diff(twin("hex:n=5", seed=1), twin("hex:n=5", seed=2))
    assert found.choice is not None
    text = str(found)
    heads = ["seed", "compared", "answer", "first choice", "first message", "first move", "cubes"]
    places = [text.index(f"\n{head}") for head in heads]
    assert places == sorted(places)
    assert f"round {found.choice.round}, module_{found.choice.module}" in text
    assert max(map(len, text.splitlines())) <= 100


@pytest.mark.parametrize(("name", "part"), [("hex-5", 0.5), ("hex-free-5", 0.2)])
def test_a_damaged_file_is_compared_as_far_as_it_goes(
    name: str, part: float, tmp_path: Path
) -> None:
    """What could be read is the same; what is missing is said."""
    whole = GOLDEN / f"{name}.mcap"
    data = whole.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: int(len(data) * part)])
    found = diff(whole, cut)
    assert not found.identical
    assert found.message is None
    assert any(note.startswith("b: truncated") for note in found.notes)
    assert any(note.startswith("b is cut off: no summary") for note in found.notes)
    assert found.ends is not None
    assert found.ends[1] == "not on record"
    assert not found.same
