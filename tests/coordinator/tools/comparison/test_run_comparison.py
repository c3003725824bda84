"""`cubepath diff`: exit codes, JSON, files of moves, and what is refused."""

import json
import re
import shutil
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.tools.comparison.run_comparison import diff
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.writing import RecordingWriter
from processes.command_line import GOLDEN, in_shell, refused
from samples.free_runs import free_recorded
from samples.recordings import new_path, recorded
from samples.twin_runs import twin

HEX, FREE = str(GOLDEN / "hex-5.mcap"), str(GOLDEN / "hex-free-5.mcap")
PLAIN, GARBAGE = "moves.jsonl", "garbage.mcap"


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
    run = ["run", "hex:n=5", "--processes=0", "--seed=1", "--max-rounds=20", "--log", other]
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
    assert main(["shorten", HEX, "--convert", "-o", str(moves)]) == 0
    capsys.readouterr()
    assert main(["diff", HEX, str(moves), "--system", "hex:n=5"]) == 0
    assert "no difference in what was done" in capsys.readouterr().out
    less = new_path(".jsonl")
    less.write_text("".join(moves.read_text().splitlines(keepends=True)[:-1]))
    assert main(["diff", HEX, str(less), "--system", "hex:n=5"]) == 1
    told = capsys.readouterr().out
    assert "first move      move 28: " in told
    assert "none in b" in told


def test_moves_alone_are_told_as_beside_messages() -> None:
    """A move has one notation, whatever is compared: that of the sites in messages."""
    spec = "agv:graph=grid3x3,n=4"
    found = diff(recorded(spec, seed=1), free_recorded(spec, seed=4, moves=12))
    assert found.move is not None
    assert re.fullmatch(r"edge at \[\[\d,\d\],\[\d,\d\]\]", found.move.a or "")


def test_a_free_run_and_one_with_rounds_are_compared_by_their_moves() -> None:
    """They may be equal up to commuting, which then is said."""
    found = diff(GOLDEN / "hex-5.mcap", GOLDEN / "hex-free-5.mcap")
    assert found.clock == "moves"
    assert found.parameters["format"] == ("cubepath-recording-4", "cubepath-recording-5")
    assert found.paths is not None
    assert found.paths.same is None


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


@pytest.mark.parametrize(("name", "part"), [("hex-5", 0.5), ("hex-free-5", 0.3)])
def test_a_damaged_file_is_compared_as_far_as_it_goes(
    name: str, part: float, tmp_path: Path
) -> None:
    """What could be read is the same: the beginning of the whole; what is missing is said."""
    whole = GOLDEN / f"{name}.mcap"
    data = whole.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: int(len(data) * part)])
    found, back = diff(whole, cut), diff(cut, whole)
    assert not found.identical
    assert found.message is None
    assert found.choice is None
    assert any(note.startswith("b is damaged: truncated") for note in found.notes)
    assert any(note.startswith("b is cut off: no summary") for note in found.notes)
    assert found.ends is not None
    assert found.ends[1] == "not on record"
    assert not found.same
    assert found.answer.startswith("b is the beginning of a: the same")
    assert back.answer.startswith("a is the beginning of b: the same")
    assert found.paths is not None
    assert found.paths.same is None  # of what both have
    assert found.paths.moves[0] == found.paths.moves[1] > 0


def test_a_file_without_its_first_commits_is_refused(tmp_path: Path) -> None:
    """In one line, with what is wrong with it: nobody knows which commit is which."""
    whole, killed = read_recording(FREE), tmp_path / "killed.mcap"
    with RecordingWriter(killed, whole.scene, whole.parameters) as writer:
        for each in takewhile(lambda each: each.kind != "commit", whole.records):
            writer.write(each.topic, each.data, round_number=each.round, wall_ns=each.wall_ns)
        writer.flush()
        data = killed.read_bytes()
    killed.write_bytes(data)
    line = refused("diff", FREE, str(killed))
    assert "its first commits are not on record: it is damaged: truncated at byte" in line


def test_a_chunk_in_the_middle_that_is_lost(tmp_path: Path) -> None:
    """Rounds before it are the same, and the run is not said to end there."""
    whole = recorded("hex:n=5", "chain", hesitate=0.3, rounds=20).path
    data = bytearray(whole.read_bytes())
    data[len(data) // 3] ^= 0xFF
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(data)
    found = diff(whole, damaged)
    assert any(note.startswith("b is damaged: corrupt at byte") for note in found.notes)
    assert any(note.endswith("as a whole: not compared") for note in found.notes)
    assert found.beginning is None
    assert found.answer == f"no difference in {found.compared}; the notes say more"
    assert found.states == ()
    assert found.paths is None
    assert "rounds 1 to" in found.compared
    assert found.compared.endswith(" to 20")


SELF_CONTAINED = {
    "go": '{"id": 1, "support": [1, 2], "trace": [1, 2], "before": [1], "after": [2]}',
    "back": '{"id": 1, "support": [1, 2], "trace": [1, 2], "before": [2], "after": [1]}',
    "lamp": '{"id": 2, "support": [5], "trace": [5], "before": [], "after": [5]}',
    "off": '{"id": 2, "support": [5], "trace": [5], "before": [5], "after": []}',
    "plain": '{"id": 3, "support": [1, 2], "trace": [1]}',
    "other": '{"id": 4, "support": [1, 2], "trace": [1]}',
}


@pytest.mark.parametrize(
    ("one", "other", "told"),
    [
        ("go", "go back", "on are 2 in a alone; 1 in b alone"),
        ("go", "go lamp", "not known: b alone has moves of 5, and leaves it changed"),
        ("go", "go lamp off", "the same state"),
        ("go lamp", "lamp go", "the same state"),
        ("plain", "other", "not known: the moves do not say which sites are on"),
        ("plain", "plain other other", "the same state"),
    ],
)
def test_ends_of_paths_that_carry_no_system(
    one: str, other: str, told: str, tmp_path: Path
) -> None:
    """As far as both tell of the same sites; what is not known is not said to be the same."""
    paths = [tmp_path / f"{name}.jsonl" for name in "ab"]
    for path, names in zip(paths, (one, other), strict=True):
        path.write_text("".join(f"{SELF_CONTAINED[name]}\n" for name in names.split()))
    text = str(diff(*paths))
    assert [line for line in text.splitlines() if line.startswith("end ")] == [
        f"end{' ' * 13}{told}"
    ]


def test_moves_take_the_system_of_the_recording_beside_them(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Also from a pipe; and it is said."""
    moves = new_path(".jsonl")
    assert main(["shorten", HEX, "--convert", "-o", str(moves)]) == 0
    capsys.readouterr()
    for arguments in ([str(moves), HEX], [HEX, str(moves)]):
        assert main(["diff", *arguments]) == 0
        assert "are read as those of hex:n=5" in capsys.readouterr().out
    piped = in_shell(f"cat {moves} | cubepath diff - {HEX}")
    assert piped.returncode == 0
    assert "the moves of a are read as those of hex:n=5" in piped.stdout


def test_runs_of_two_families_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """In one line: nothing of them could be compared."""
    assert main(["diff", HEX, str(GOLDEN / "agv-6.mcap")]) == 2
    assert "runs of hex and agv-labelled, which have nothing in common" in capsys.readouterr().err


def test_no_python_in_what_people_read() -> None:
    """No tuples, None or counts such as 1 rounds, and sites in one spelling."""
    pairs: list[tuple[Recording | Path, Recording | Path]] = [
        (twin("agv-labelled:graph=K5,n=3", seed=1), twin("agv-labelled:graph=K5,n=3", seed=2)),
        (twin("hex:n=5", seed=1), replace(twin("hex:n=5", seed=2), parameters={"system": "hex"})),
        (twin("agv:graph=grid4x4,n=6", "tswap"), twin("agv:graph=grid4x4,n=6", "random")),
        (GOLDEN / "hex-5.mcap", GOLDEN / "hex-free-5.mcap"),
    ]
    for a, b in pairs:
        text = str(diff(a, b))
        assert not re.search(
            r"None|True|False|\(\d+, |\[\d+, \d+\](?= in| finds)| 1 [a-z]+s\b", text
        )
