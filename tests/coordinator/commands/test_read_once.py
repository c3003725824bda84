"""A command opens each of its inputs once, and a path falls onto a heap once."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest

from cubepath.protocol.scenes.toml import scene_to_toml
from processes.audited import Carried, carried_out
from samples.strategies import scene

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
PLANS = ROOT / "tests" / "data" / "imports"
SCENARIO = ROOT / "tests" / "data" / "agv" / "grid8-12agents.json"
CROSSING = [
    {"generator": "edge", "at": [[0, 0], [1, 0]]},
    {"generator": "edge", "at": [[0, 1], [0, 0]]},
    {"generator": "edge", "at": [[1, 0], [2, 0]]},
]
"""A path of two vehicles on a grid, which comes nowhere twice."""
CONTENTS = [
    {"id": 1, "support": [0, 1], "trace": [0, 1], "before": [0], "after": [1]},
    {"id": 2, "support": [1, 2], "trace": [1, 2], "before": [1], "after": [2]},
]
CELLS = "grid.map"

FORMS: dict[str, tuple[str, ...]] = {
    "a recording": ("run.mcap",),
    "lines by generator": ("crossing.jsonl", "--system", "grid.toml"),
    "lines on a map": ("crossing.jsonl", "--system", f"agv:graph={CELLS},n=2"),
    "lines of a scene": ("steps.jsonl", "--system", "agv:scene=scenario.json"),
    "self-contained lines": ("contents.jsonl",),
    "lines that are unusual": ("unusual.jsonl",),
    "arrays": ("crossing.npz",),
    "arrays with a system": ("crossing.npz", "--system", "grid.toml"),
    "a scenario": ("scenario.json",),
    "a log": ("lacam.txt", "--with", "room.map"),
    "a log and its scenario": ("lacam.txt", "--with", "room.scen", "--with", "room.map"),
    "a log by its format": ("lacam.txt", "--with", "room.map", "--format", "mapf-log:order=xy"),
    "agents": ("eecbs.txt", "--with", "room.map", "--with", "room.scen"),
    "lists": ("paths.json", "--with", "room.map"),
    "steps of robots": ("train.solution.json", "--with", "train.instance.json"),
    "flips": (
        *("kite.solution.json", "--with", "kite.instance.json"),
        *("--format", "cgshop2026:triangulation=0"),
    ),
    "a plain list": ("pivots.txt", "--system", "hex.toml"),
}
"""A path in each form of file that there is, with all that it needs."""
NOT_DRAWN = ("self-contained lines", "lines that are unusual", "arrays")
"""Moves that stand for themselves and do not say where their sites lie, or where modules are."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with all these files."""
    found = tmp_path_factory.mktemp("inputs")
    shutil.copytree(PLANS, found, dirs_exist_ok=True)
    shutil.copy(SCENARIO, found / "scenario.json")
    shutil.copy(ROOT / "logs" / "golden" / "agv-3.mcap", found / "run.mcap")
    recording = (found / "run.mcap").read_bytes()
    (found / "cut.mcap").write_bytes(recording[: len(recording) // 2])
    save(found / "crossing.jsonl", CROSSING)
    save(found / "contents.jsonl", CONTENTS)
    save(found / "unusual.jsonl", [{"id": 1, "support": [[1.5]], "trace": [[1.5]]}] * 3)
    save(found / "wrong.jsonl", CROSSING[1:])
    save(found / "cubes.jsonl", [{"moves": [move]} for move in CROSSING])
    steps = json.loads(SCENARIO.read_text())["moves"]
    save(found / "steps.jsonl", [{"generator": "edge", "at": sorted(step)} for step in steps])
    (found / CELLS).write_text("type octile\nheight 2\nwidth 3\nmap\n...\n...\n")
    grid, hexagons = scene("agv:graph=grid3x2,n=2"), scene("hex:n=3")
    (found / "grid.toml").write_text(scene_to_toml(grid))
    (found / "hex.toml").write_text(scene_to_toml(hexagons))
    (found / "durations.toml").write_text('format = "cubepath-durations-1"\ndefault = 2\n')
    made = carried_out(
        found,
        [
            (
                "shorten",
                "crossing.jsonl",
                "--convert",
                "-o",
                "crossing.npz",
                "--system",
                "grid.toml",
            ),
            ("shorten", "crossing.npz", "-o", "cubes.npz"),
            ("shorten", "contents.jsonl", "-o", "told.jsonl"),
            ("shorten", "contents.jsonl", "--certificate", "told.certificate.json"),
        ],
    )
    assert [each.code for each in made] == [0] * 4
    return found


def save(path: Path, lines: Sequence[object]) -> None:
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))


def inputs(folder: Path, command: Sequence[str]) -> set[str]:
    """Return the files that a command names, by themselves or in a system's name, to be read.

    What a command is to write is called `out` and something.
    """
    words = {part for word in command for part in (word, *word.replace(",", "=").split("="))}
    words -= {word for word in words if word.startswith("out")}
    return {word for word in words if word and (folder / word).is_file()}


def opened_once(
    folder: Path, *commands: Sequence[str], code: int = 0, also: Sequence[str] = ()
) -> list[Carried]:
    """Carry out commands that read all files that they name; each must open each of them once.

    What is in `also` is read too. A file in the place of an output is looked at, which does not
    count: recordings are not written over.
    """
    expected = [dict.fromkeys({*inputs(folder, each), *also}, 1) for each in commands]
    found = carried_out(folder, commands)
    for command, once, carried in zip(commands, expected, found, strict=True):
        assert (carried.code, command) == (code, command)
        seen = {name: often for name, often in carried.opened.items() if name[:3] != "out"}
        assert (seen, command) == (once, command)
    return found


def fell_once(found: Sequence[Carried]) -> None:
    """Hold the moves that fell onto heaps against those that the commands count themselves."""
    for carried in found:
        assert (carried.fallen, carried.fallen_plainly) == (carried.document["moves"], 0)


OPTIONS = {
    "nothing else": (),
    "arrays": ("-o", "out.npz"),
    "all that is of the class": (
        *("--explain", "--certificate", "out.json", "--durations", "durations.toml"),
        *("-o", "out.jsonl"),
    ),
}


@pytest.mark.thorough
def test_shortening_reads_once_and_builds_once(folder: Path) -> None:
    """Every form of file, with its system and with what belongs to it, under every option."""
    found = opened_once(
        folder,
        *(
            ("shorten", *form, *options, "--json")
            for options in OPTIONS.values()
            for form in FORMS.values()
        ),
    )
    assert len(found) == len(OPTIONS) * len(FORMS)
    fell_once(found)


@pytest.mark.thorough
def test_looking_beyond_the_class_builds_nothing_of_the_input_again(folder: Path) -> None:
    """Neither for the bounds nor as what an improvement begins with."""
    commands = [
        ("improve", *FORMS[form], *options, "--max-states", "50", "--json")
        for form in ("lines by generator", "self-contained lines", "arrays")
        for options in (("--bounds",), ("--seconds", "0"), ("--seconds", "0", "-o", "out.jsonl"))
    ]
    fell_once(opened_once(folder, *commands))


def test_what_is_wrong_is_found_by_going_back_in_the_open_file(folder: Path) -> None:
    """A move that is not admissible, a damaged recording, and cubes in the place of moves."""
    opened_once(
        folder,
        ("shorten", "wrong.jsonl", "--system", "grid.toml"),
        ("shorten", "cut.mcap"),
        ("shorten", "cubes.npz"),
        ("shorten", "told.jsonl"),
        ("shorten", "kite.instance.json"),
        ("shorten", "cut.mcap", "--convert", "-o", "out.npz"),
        ("run", "--schedule", "cut.mcap"),
        code=2,
    )


@pytest.mark.thorough
def test_converting_reads_once(folder: Path) -> None:
    """Every form to lines and to arrays, and cubes to lines; nothing is shortened."""
    targets = ("out.npz", "out.jsonl")
    commands = [
        ("shorten", form[0], "--convert", "-o", target, *form[1:])
        for form in FORMS.values()
        for target in targets
    ]
    found = opened_once(folder, *commands, ("shorten", "cubes.npz", "--convert", "-o", "out.jsonl"))
    assert {(carried.fallen, carried.fallen_plainly) for carried in found} == {(0, 0)}


@pytest.mark.thorough
def test_verifying_reads_once(folder: Path) -> None:
    """A recording; and certificates of every form, with the cubes beside them."""
    opened_once(folder, ("verify", "run.mcap"))
    beside = ("verify", "told.jsonl", "--of", "contents.jsonl")
    opened_once(folder, beside, also=["told.certificate.json"])
    made = carried_out(
        folder,
        [
            ("shorten", *form, "-o", f"{number}.jsonl", "--certificate", f"{number}.json")
            for number, form in enumerate(FORMS.values())
        ],
    )
    assert {each.code for each in made} == {0}
    found = opened_once(
        folder,
        *(
            ("verify", f"{number}.json", "--of", *form, "--cubes", f"{number}.jsonl")
            for number, form in enumerate(FORMS.values())
        ),
    )
    assert {(carried.fallen, carried.fallen_plainly) for carried in found} == {(0, 0)}


def test_recovering_writes_what_was_verified(folder: Path) -> None:
    """The damaged recording is not read a second time to be written."""
    opened_once(folder, ("log", "recover", "cut.mcap", "-o", "out.mcap"))
    assert (folder / "out.mcap").exists()


@pytest.mark.thorough
def test_what_is_done_with_a_recording_reads_it_once(folder: Path) -> None:
    """Described, replayed and drawn; its moves fall once each time."""
    (told,) = opened_once(folder, ("log", "info", "run.mcap", "--json"))
    moves = told.document["moves"]
    replayed, picture, film = opened_once(
        folder,
        ("replay", "run.mcap"),
        ("view", "run.mcap", "-o", "out.png"),
        ("view", "run.mcap", "-o", "out.gif"),
    )
    assert [carried.fallen for carried in (replayed, picture, film)] == [moves, moves, moves]


@pytest.mark.thorough
def test_drawing_a_path_reads_it_once(folder: Path) -> None:
    """Every form of file whose sites can be drawn, and cubes; the moves fall once."""
    drawn = {name: form for name, form in FORMS.items() if name not in NOT_DRAWN}
    commands = [("view", *form, "-o", "out.png") for form in drawn.values()]
    system = ("--system", "grid.toml")
    commands += [
        ("view", cubes, *system, "-o", "out.png") for cubes in ("cubes.jsonl", "cubes.npz")
    ]
    found = opened_once(folder, *commands)
    told = carried_out(folder, [("shorten", *form, "--json") for form in drawn.values()])
    counts = [each.document["moves"] for each in told] + [len(CROSSING)] * 2
    assert [each.fallen for each in found] == counts


@pytest.mark.few(1)
@pytest.mark.parametrize("processes", [0, 2])
def test_running_reads_once(folder: Path, processes: int) -> None:
    """A system, a schedule, or both, by a run and by the processes that it starts.

    The run falls onto a heap once, as the recording does whose schedule it carries out.
    """

    def run(log: str, *arguments: str) -> tuple[str, ...]:
        options = ("--processes", str(processes), "--max-rounds", "8", "--seed", "1")
        return ("run", *arguments, *options, "--log", f"{log}-{processes}.mcap", "--json")

    found = opened_once(
        folder,
        run("out-plain", "grid.toml"),
        run("out-cubes", "grid.toml", "--schedule", "cubes.jsonl"),
        run("out-again", "--schedule", "run.mcap"),
    )
    fell_once(found[:2])
    (told,) = carried_out(folder, [("log", "info", "run.mcap", "--json")])
    assert found[2].fallen == found[2].document["moves"] + told.document["moves"]


def test_a_complex_reads_its_system_once(folder: Path) -> None:
    """Built, and written to files."""
    opened_once(
        folder, ("complex", "grid.toml", "--homology"), ("complex", "grid.toml", "-o", "out.json")
    )


def test_reading_twice_and_building_twice_are_seen(folder: Path) -> None:
    """What these tests are for: each of the two makes one of them fail."""
    with pytest.raises(AssertionError, match=r"'contents\.jsonl': 2"):
        opened_once(folder, ("read-twice", "contents.jsonl"))
    (found,) = opened_once(folder, ("fall-twice", "contents.jsonl"))
    with pytest.raises(AssertionError, match="4"):
        fell_once([found])
