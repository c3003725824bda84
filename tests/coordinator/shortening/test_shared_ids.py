"""Ids that moves with different contents have: their cubes are told apart, and read back."""

import json
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.path_files.moves import CubeName, NumberedId, read_cubes, read_moves


def step(name: str | int, source: int, target: int) -> dict[str, Any]:
    both = [source, target]
    return {"id": name, "support": both, "trace": both, "before": [source], "after": [target]}


# Two vehicles on a line each; "a" is what their planner calls a first step, whoever makes it.
SHARED = [step("a", 1, 2), step("a", 11, 12), step(7, 2, 3), step("b", 12, 13), step("b", 13, 12)]
CUBES = [[["a", 1], ["a", 2]], [7]]


def saved(path: Path, lines: list[dict[str, Any]]) -> Path:
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


def meant(name: CubeName, moves: Path) -> Action:
    """Return the action that a name in a cubes file means, as a reader finds it in the input."""
    known = list(read_moves(moves))
    if isinstance(name, NumberedId):
        assert known[name.move - 1].name == name.id
        return known[name.move - 1].action
    assert not isinstance(name, GeneratorPlacement)
    (action,) = {move.action for move in known if move.name == name}
    return action


@pytest.mark.parametrize("binary", [False, True])
def test_cubes_read_back_are_the_path(tmp_path: Path, *, binary: bool) -> None:
    """Each name in a cubes file means one action of the input, as lines and by way of .npz."""
    moves, cubes = saved(tmp_path / "moves.jsonl", SHARED), tmp_path / "cubes.jsonl"
    if binary:
        arrays = tmp_path / "cubes.npz"
        assert main(["shorten", str(moves), "-o", str(arrays)]) == 0
        assert main(["shorten", str(arrays), "--convert", "-o", str(cubes)]) == 0
    else:
        assert main(["shorten", str(moves), "-o", str(cubes)]) == 0
    assert [json.loads(line)["moves"] for line in cubes.read_text().splitlines()] == CUBES
    back = [{meant(name, moves) for name in cube} for cube in read_cubes(cubes)]
    assert back == [set(cube) for cube in shorten(moves).cube_path]


def test_an_id_of_one_contents_stands_alone(tmp_path: Path) -> None:
    """Moves that are equal may share an id, there and back."""
    moves = saved(tmp_path / "moves.jsonl", [step(1, 1, 2), step(1, 2, 1), step(1, 1, 2)])
    assert shorten(moves).named == ((1,),)


def test_an_id_of_a_cancelled_move_is_shared_too(tmp_path: Path) -> None:
    """What cancelled is in the input, where a reader looks ids up."""
    moves = saved(tmp_path / "m.jsonl", [step("b", 1, 2), step("b", 2, 1), step("b", 4, 5)])
    assert shorten(moves).named == ((NumberedId("b", 3),),)


def test_a_timetable_tells_them_apart(tmp_path: Path) -> None:
    """Its lines have names as cubes files do."""
    moves, times = saved(tmp_path / "moves.jsonl", SHARED), tmp_path / "times.jsonl"
    assert main(["shorten", str(moves), "--durations", "a=2", "-o", str(times)]) == 0
    lines = map(json.loads, times.read_text().splitlines())
    assert [line["move"] for line in lines] == [["a", 1], ["a", 2], 7]


CHANGED: dict[str, tuple[list[Any], str | None]] = {
    "as written": (CUBES, None),
    "in another order": ([[["a", 2], ["a", 1]], [7]], None),
    "with a number that is not needed": ([[["a", 1], ["a", 2]], [[7, 3]]], None),
    "without numbers": ([["a", "a"], [7]], 'moves with different contents have the id "a"'),
    "one without": ([[["a", 1], "a"], [7]], 'moves with different contents have the id "a"'),
    "one number twice": ([[["a", 1], ["a", 1]], [7]], "cube 1 has other moves"),
    "another number": ([[["a", 1], ["a", 3]], [7]], "cube 1 has other moves"),
    "another id": ([[["a", 1], ["b", 2]], [7]], "cube 1 has other moves"),
}


@pytest.mark.parametrize("name", CHANGED)
def test_verify_compares_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """A certificate holds for cubes that name its very moves, and for no others."""
    moves, cubes = saved(tmp_path / "moves.jsonl", SHARED), tmp_path / "cubes.jsonl"
    proof = tmp_path / "cubes.certificate.json"
    assert main(["shorten", str(moves), "-o", str(cubes), "--certificate", str(proof)]) == 0
    changed, wrong = CHANGED[name]
    saved(cubes, [{"moves": cube} for cube in changed])
    capsys.readouterr()
    code = main(["verify", str(cubes), "--of", str(moves), "--json"])
    (check,) = (
        each for each in json.loads(capsys.readouterr().out)["checks"] if each["name"] == "cubes"
    )
    assert (code, check["ok"]) == (0 if wrong is None else 1, wrong is None)
    assert (wrong or "") in check["detail"]
