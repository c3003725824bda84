"""Files that commands name: standard streams, no output in the place of an input, names."""

import fcntl
import json
import os
import shutil
import signal
import subprocess
import termios
import time
from pathlib import Path

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.protocol.core.actions import Action
from cubepath.protocol.path_files.optimality_proofs import OptimalityProof, write_proof
from cubepath.protocol.scenes.toml import scene_to_toml
from processes.command_line import GOLDEN, PYTHON, ROOT, in_shell
from samples.strategies import scene

PLANS = ROOT / "tests" / "data" / "imports"
MOVES = [
    {"id": 1, "support": [0, 1], "trace": [0, 1], "before": [0], "after": [1]},
    {"id": 2, "support": [1, 2], "trace": [1, 2], "before": [1], "after": [2]},
]
EDGE = {"generator": "edge", "at": [[0, 0], [1, 0]]}
CUBES = '{"moves":[1]}\n{"moves":[2]}\n'
Capture = pytest.CaptureFixture[str]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Go to a folder with inputs of every kind."""
    shutil.copytree(PLANS, tmp_path, dirs_exist_ok=True)
    shutil.copy(GOLDEN / "agv-3.mcap", tmp_path / "run.mcap")
    (tmp_path / "moves.jsonl").write_text("".join(json.dumps(move) + "\n" for move in MOVES))
    (tmp_path / "edge.jsonl").write_text(json.dumps(EDGE) + "\n")
    (tmp_path / "cubes.jsonl").write_text(json.dumps({"moves": [EDGE]}) + "\n")
    (tmp_path / "grid.toml").write_text(scene_to_toml(scene("agv:graph=grid3x2,n=2")))
    (tmp_path / "durations.toml").write_text('format = "cubepath-durations-1"\n')
    (tmp_path / "grid.map").write_text("type octile\nheight 2\nwidth 3\nmap\n...\n...\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def contents(folder: Path) -> dict[str, bytes]:
    """Return every file of a folder with its bytes."""
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.mark.few(2)
@pytest.mark.slow
@pytest.mark.parametrize(
    "line",
    [
        "cat moves.jsonl | cubepath shorten - -o -",
        "cubepath shorten - -o - < moves.jsonl",
        "cubepath shorten /dev/stdin -o /dev/stdout < moves.jsonl",
        "cubepath shorten <(cat moves.jsonl) -o -",
        "cat moves.jsonl | cubepath shorten - --convert -o - | cubepath shorten - -o -",
        "cubepath shorten moves.jsonl --convert -o m.npz >&2; cat m.npz | cubepath shorten - -o -",
        "cubepath shorten moves.jsonl -o c.npz >&2; cat c.npz | cubepath shorten - --convert -o -",
    ],
)
def test_moves_and_cubes_come_and_go_by_standard_streams(line: str, folder: Path) -> None:
    """From pipes, redirections and process substitutions; nothing else is on standard output."""
    done = in_shell(line)
    assert (done.returncode, done.stdout) == (0, CUBES)
    assert "standard output" in done.stderr


@pytest.mark.slow
def test_a_redirected_file_is_added_to(folder: Path) -> None:
    """Standard output is written where it is, not from the start of its file, nor replaced."""
    in_shell("{ echo first; cubepath shorten moves.jsonl -o -; echo last; } > all.txt")
    assert (folder / "all.txt").read_text() == f"first\n{CUBES}last\n"


PROVED = "proved     no schedule of 1 round or fewer; the schedule has 2: optimal\n"


@pytest.mark.few(4)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("cat two.proof | cubepath verify -", PROVED),
        ("cubepath verify - < run.mcap", "ok      readable"),
        ("cubepath log recover - -o new.mcap < run.mcap", "ok      readable"),
        ("cubepath verify <(cat c.json) --of moves.jsonl", "ok      form"),
        ("cubepath verify - < two.proof", PROVED),
        ("cubepath verify <(cat two.proof)", PROVED),
        ("cubepath verify - --of moves.jsonl < c.json", "ok      form"),
    ],
)
def test_what_is_verified_comes_by_any_stream(line: str, told: str, folder: Path) -> None:
    """A proof, a recording, a certificate: its first bytes say which, and are read once."""
    left, right = Action([1, 2], [1, 2], [1], [2]), Action([2, 3], [2, 3], [2], [3])
    proof = OptimalityProof(
        system=None, start=[1], goal=[3], refuted=1, cubes=2,
        moves=[left, right], schedule=[[0], [1]],
    )  # fmt: skip
    write_proof("two.proof", proof)
    assert main(["shorten", "moves.jsonl", "--certificate", "c.json"]) == 0
    done = in_shell(line)
    assert (done.returncode, done.stdout[: len(told)]) == (0, told)


@pytest.mark.thorough
def test_plans_recordings_and_schedules_come_by_pipes(folder: Path) -> None:
    """Every kind of input that its content tells, also from the middle of a stream on."""
    for line in (
        "cat lacam.txt | cubepath shorten - --with room.map",
        "cat room.map | cubepath shorten lacam.txt --with -",
        "cat run.mcap | cubepath shorten - --explain",
        "cat run.mcap | cubepath verify -",
        "cat durations.toml | cubepath shorten moves.jsonl --durations -",
        "cat cubes.jsonl | cubepath run grid.toml --schedule - --processes 0 --log a.mcap",
        "cat run.mcap | cubepath run --schedule - --processes 0 --log b.mcap",
        "cubepath shorten moves.jsonl --certificate c.json",
        "cat c.json | cubepath verify - --of moves.jsonl",
        "{ read line; cubepath shorten - ; } < <(cat edge.jsonl moves.jsonl)",
        "cubepath complex <(cat grid.toml)",
    ):
        done = in_shell(line)
        said = [each for each in done.stderr.splitlines() if ": endpoint " not in each]
        assert (done.returncode, said, line) == (0, [], line)


@pytest.mark.few(2)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("echo '{}' | cubepath shorten -", "standard input:1: Object missing required field"),
        ("cubepath shorten - <&-", "standard input: closed, expected what to read"),
        ("cubepath shorten - --with - < moves.jsonl", "standard input: named twice"),
        ("cubepath shorten moves.jsonl -o - --json", "--json: standard output has the cubes"),
        ("cubepath shorten moves.jsonl --certificate -", "standard output: takes moves and cubes"),
        ("cubepath view run.mcap -o -", "standard output: takes moves and cubes alone"),
        ("cubepath view - < run.mcap", "standard input: has no name for a picture"),
    ],
)
def test_what_is_wrong_with_a_stream_is_told(line: str, message: str, folder: Path) -> None:
    """By the name that people know it by, in one line."""
    done = in_shell(line)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"cubepath: {message}")
    assert done.stderr.count("\n") == 1


def wait_until_it_reads(pid: int, pipe: int) -> None:
    """Wait until a process has read what is in a pipe, and sleeps for more."""
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        unread = fcntl.ioctl(pipe, termios.FIONREAD, bytes(4))
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        if not any(unread) and state == "S":
            return
        time.sleep(0.01)
    raise TimeoutError("the command does not read")


@pytest.mark.slow
def test_a_signal_leaves_the_old_file_and_nothing_else(folder: Path) -> None:
    """SIGTERM in the middle of writing: one line, exit code 130."""
    (folder / "cubes.jsonl").write_text("old")
    before = contents(folder)
    pipe = folder / "pipe"
    os.mkfifo(pipe)
    with (
        subprocess.Popen(
            [*PYTHON, "shorten", "pipe", "-o", "cubes.jsonl"], stderr=subprocess.PIPE, text=True
        ) as child,
        pipe.open("wb") as moves,
    ):
        moves.write(b'{"id": "a", "support": [1], "trace": [1]}\n' * 10_000)
        moves.flush()
        wait_until_it_reads(child.pid, moves.fileno())
        child.send_signal(signal.SIGTERM)
        _, told = child.communicate(timeout=60)
    assert (child.returncode, told) == (130, "cubepath: interrupted\n")
    assert contents(folder) == before


@pytest.mark.parametrize(
    "line",
    [
        "shorten moves.jsonl -o NAME.jsonl",
        "shorten moves.jsonl --certificate NAME.json",
        "shorten moves.jsonl --convert -o NAME.npz",
        "complex arm:n=3 -o NAME.json",
        "view run.mcap -o NAME.png",
        "log recover run.mcap -o NAME.mcap",
        "run arm:n=3 --log NAME.mcap",
        "log info NAME.mcap",
        "verify NAME.mcap",
        "shorten NAME.jsonl",
        "shorten moves.jsonl --system NAME.toml",
        "shorten moves.jsonl --system NAME",
    ],
)
def test_a_name_that_is_too_long_is_told(line: str, folder: Path, capsys: Capture) -> None:
    """In one line that begins with the file or is about the system; nothing is written."""
    before = contents(folder)
    assert main(line.replace("NAME", "a" * 300).split()) == 2
    told = capsys.readouterr()
    begin = "unknown system '" if line.endswith("NAME") else ""
    assert told.err.startswith(f"cubepath: {begin}{'a' * 300}")
    assert ("File name too long" in told.err) == (not begin)
    assert (told.out, told.err.count("\n")) == ("", 1)
    assert contents(folder) == before
