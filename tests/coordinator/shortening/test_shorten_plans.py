"""Plans of other programs are shortened, converted and looked beyond like any path."""

import json
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.normal_form.definitions import end_state, is_normal
from cubepath.coordinator.shortening.conversion import convert
from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.coordinator.theory.optimality.tasks import task_of
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.file_forms import PlanHints
from cubepath.protocol.wire.messages import encode
from samples.plans import DATA

AGV = Path(__file__).parents[2] / "data" / "agv"
ROOM = DATA / "room.map"
KITE = PlanHints("cgshop2026:triangulation=0", (DATA / "kite.instance.json",))
SAMPLES: dict[str, tuple[str, str | None, PlanHints, tuple[int, int, int, int | None]]] = {
    "log": ("lacam.txt", None, PlanHints(None, (ROOM,)), (8, 8, 5, 4)),
    "agents": ("eecbs.txt", None, PlanHints(None, (ROOM, DATA / "room.scen")), (8, 8, 5, 4)),
    "lists": ("paths.json", None, PlanHints(None, (ROOM,)), (8, 8, 5, 4)),
    "2021": (
        "train.solution.json",
        None,
        PlanHints(None, (DATA / "train.instance.json",)),
        (12, 12, 5, 4),
    ),
    "2026": ("kite.solution.json", None, KITE, (8, 4, 3, 4)),
    "pivots": ("pivots.txt", "hex:n=3", PlanHints(), (5, 5, 4, None)),
    "slides": ("slides.txt", "sliding:p=3,q=1,n=3", PlanHints(), (3, 1, 1, None)),
}


@pytest.mark.parametrize("name", SAMPLES)
def test_samples(name: str) -> None:
    """Moves, reduced moves, cubes and the planner's own rounds; the end is that of the plan."""
    source, system, hints, expected = SAMPLES[name]
    found = shorten(DATA / source, system=system, format=hints.format, companions=hints.companions)
    document = found.document()
    keys = ("moves", "reduced_moves", "cubes", "planner_rounds")
    assert tuple(document[key] for key in keys) == expected
    assert is_normal(found.cube_path)
    task = task_of(found)
    word = [found.path.actions[number] for number in found.path.numbers.tolist()]
    assert end_state(word, task.start) == end_state(found.cube_path, task.start)
    assert all(isinstance(move, GeneratorPlacement) for cube in found.named for move in cube)


@pytest.mark.parametrize(
    ("name", "rounds"),
    [("grid8-12agents", 12), ("random-32-32-10-30agents", 53), ("cgshop2021-algae", 66)],
)
def test_a_scenario_says_its_planners_rounds(name: str, rounds: int) -> None:
    """The key is that of the file."""
    assert shorten(AGV / f"{name}.json").planner_rounds == rounds


def test_a_plan_becomes_a_moves_file(tmp_path: Path) -> None:
    """Converted, it is a path by generator against the instance as a system."""
    target = tmp_path / "flips.jsonl"
    convert(DATA / "kite.solution.json", target, hints=KITE)
    system = f"triangulation:points={DATA / 'kite.instance.json'}"
    first = shorten(DATA / "kite.solution.json", format=KITE.format, companions=KITE.companions)
    assert encode(shorten(target, system=system).named) == encode(first.named)


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    code = main([str(each) for each in arguments])
    told = capsys.readouterr()
    return code, told.out, told.err


def test_the_command(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Plan, map and scenario in; figures with the planner's rounds, and a cubes file, out."""
    cubes = tmp_path / "cubes.jsonl"
    code, out, _ = run(
        capsys,
        *("shorten", DATA / "lns2.txt", "--with", ROOM, "--with", DATA / "room.scen"),
        *("-o", cubes, "--json"),
    )
    document: dict[str, Any] = json.loads(out)
    assert (code, document["cubes"], document["planner_rounds"]) == (0, 5, 4)
    first = json.loads(cubes.read_text().splitlines()[0])
    assert [move["at"] for move in first["moves"]] == [[[2, 0], [2, 1]], [[4, 2], [4, 3]]]
    code, out, _ = run(capsys, "shorten", DATA / "lacam.txt")
    assert "planner's rounds  4" in out
    code, out, _ = run(capsys, "shorten", DATA / "pivots.txt", "--system", "hex:n=3")
    assert code == 0
    assert "planner" not in out


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"companions": "room.map"}, r"companions='room.map': expected a list of files"),
        ({"companions": [3]}, r"companions=\[3\]: expected a list of files"),
        ({"format": 3}, "format=3: expected the name of a format"),
    ],
)
def test_what_is_no_format_and_no_list_of_files_is_refused(given: dict[str, Any], why: str) -> None:
    """From Python, where a text is a sequence, too."""
    with pytest.raises(InputError, match=why):
        shorten(DATA / "lacam.txt", **given)


REFUSED: dict[str, tuple[tuple[object, ...], str]] = {
    "no map": ((DATA / "eecbs.txt",), "a plan on a map: expected the map, --with FILE"),
    "no instance": (
        (DATA / "train.solution.json",),
        "says nothing of its instance: expected --with",
    ),
    "an instance": (
        (DATA / "kite.instance.json",),
        "an instance without moves, expected its solution",
    ),
    "no system": ((DATA / "slides.txt",), "a list of moves, expected --system SYSTEM"),
    "no plan": (
        (AGV / "grid8-12agents.json", "--with", ROOM),
        "needs no other file, expected no --with",
    ),
    "format": (
        (DATA / "lacam.txt", "--format", "lacam"),
        "unknown format 'lacam', expected one of",
    ),
    "bad move": (
        (DATA / "slides.txt", "--system", "sliding:p=3,q=1,n=2"),
        "slides.txt:2: [2,1] -> [3,1]: site [2,1] is off, expected on",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refusals_are_one_line_and_exit_code_2(
    capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """What is missing or wrong, and what was expected."""
    arguments, told = REFUSED[name]
    code, out, err = run(capsys, "shorten", *arguments)
    assert (code, out) == (2, "")
    assert told in err
    assert len(err.splitlines()) == 1
