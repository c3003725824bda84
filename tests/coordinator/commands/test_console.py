"""Standard streams: an answer that nobody takes, and streams that are full or closed."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cubepath.coordinator.commands.main import main
from processes.command_line import GOLDEN, cubepath, here, in_shell, without_reader

pytestmark = pytest.mark.slow

Capture = pytest.CaptureFixture[str]
RECORDING = str(GOLDEN / "agv-3.mcap")
COMMANDS = {
    "systems": ("system", "list"),
    "rules as JSON": ("rule", "list", "--json"),
    "verify": ("verify", RECORDING),
    "info": ("log", "info", RECORDING),
    "explain": ("shorten", RECORDING, "--explain"),
    "complex": ("complex", "arm:n=3"),
    "help": ("--help",),
    "help of a command": ("run", "--help"),
    "version": ("--version",),
}
SHORT = {"rules as JSON", "verify", "help of a command"}
"""A long answer, one of some work, and what argparse says itself; the others are thorough."""
each_command = pytest.mark.parametrize(
    "command",
    [
        pytest.param(command, id=name, marks=[] if name in SHORT else pytest.mark.thorough)
        for name, command in COMMANDS.items()
    ],
)


@pytest.mark.few(1)
@each_command
def test_a_closed_pipe_ends_a_command_as_sigpipe_does(command: tuple[str, ...]) -> None:
    """Nothing is said, and the exit code is that of `yes | head -1` for `yes`."""
    done = without_reader(*command)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.few(1)
@each_command
def test_a_full_standard_output_is_told(command: tuple[str, ...]) -> None:
    """One line and exit code 1: what was asked for has not been answered."""
    with Path("/dev/full").open("w") as full:
        done = cubepath(*command, stdout=full)
    told = "cubepath: standard output: No space left on device\n"
    assert (done.returncode, done.stderr) == (1, told)


def test_a_closed_standard_output_is_told_before_work_begins(tmp_path: Path) -> None:
    """One line and exit code 1, for answers and for help; nothing is written."""
    for arguments in ("system list", "--help", "--version", "complex arm:n=3 -o arm.json"):
        done = in_shell(f"cubepath {arguments} >&-", cwd=tmp_path)
        told = "cubepath: standard output: closed, expected a place for the answer\n"
        assert (done.returncode, done.stderr) == (1, told)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.thorough
def test_standard_error_that_takes_nothing_loses_no_answer(tmp_path: Path) -> None:
    """Full or closed, whatever the command has to complain of."""
    for where in ("2>/dev/full", "2>&-"):
        done = in_shell(f"cubepath complex hex:n=4 --max-states 5 --json {where}")
        assert done.returncode == 1
        assert json.loads(done.stdout)["complete"] is False
        done = in_shell(f"cubepath complex arm:n=3 -o arm.json --json {where}", cwd=tmp_path)
        assert (done.returncode, json.loads(done.stdout)["states"]) == (0, 8)


def test_a_run_with_all_streams_closed_writes_its_recording(tmp_path: Path) -> None:
    """No file of the program takes the number of a stream that is closed."""
    line = "cubepath run agv:graph=P3,n=1 --processes 1 --log run.mcap <&- 2>&-"
    done = in_shell(line, cwd=tmp_path)
    assert done.returncode == 0
    told = here("verify", "run.mcap", cwd=tmp_path)
    assert (told.returncode, told.stderr) == (0, "")


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("encoding", "name"), [("ascii", "\\u540d"), ("latin-1", "\\u540d"), ("utf-8:strict", "名")]
)
def test_what_standard_output_cannot_encode_is_escaped(
    encoding: str, name: str, tmp_path: Path
) -> None:
    """As on standard error; a file name that is not UTF-8 is such a text too."""
    shutil.copy(RECORDING, tmp_path / os.fsdecode(b"lo\xff.mcap"))
    environment = {**os.environ, "PYTHONIOENCODING": encoding}
    for line, shown in (
        (f"cubepath shorten {RECORDING} -o 名.jsonl", f"{name}.jsonl"),
        ("cubepath log info $'lo\\xff.mcap' .", "lo\\udcff.mcap"),
    ):
        done = in_shell(line, cwd=tmp_path, env=environment)
        assert (done.returncode, done.stderr) == (0, "")
        assert shown in done.stdout


@pytest.mark.thorough
def test_too_little_memory_is_told_in_one_line(tmp_path: Path) -> None:
    """With exit code 1, and what helps; nothing is written."""
    code = """
import resource, sys
from pathlib import Path
from cubepath.coordinator.commands.main import main
assert main(["complex", "agv:graph=grid4x4,n=3", "--json"]) == 0
size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (size + (500 << 20),) * 2)
sys.exit(main(sys.argv[1:]))
"""
    with (tmp_path / "large.mcap").open("wb") as large:
        large.truncate(1 << 40)  # takes no place on the disk
    for arguments, helps in (
        (
            ["complex", "agv:graph=grid8x8,n=6", "--max-states=50000000", "-o", "c.json"],
            "a smaller system or --max-states N",
        ),
        (["shorten", "large.mcap"], "a smaller input"),
    ):
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", code, *arguments],
            capture_output=True,
            text=True,
            timeout=100,
            check=False,
            cwd=tmp_path,
        )
        assert (done.returncode, done.stdout.count("\n")) == (1, 1), done.stdout
        assert done.stderr == f"cubepath: out of memory: expected more of it, or {helps}\n"
        assert [path.name for path in tmp_path.iterdir()] == ["large.mcap"]


@pytest.mark.thorough
def test_too_few_open_files_are_told_in_one_line(tmp_path: Path) -> None:
    """Also where they do not suffice to load what a command needs."""
    shutil.copy(RECORDING, tmp_path / "run.mcap")
    for arguments in ("view run.mcap", "run hex:n=3 --log new.mcap"):
        command = f'"$PYTHON" -m cubepath.coordinator {arguments}'  # a script takes a file more
        done = in_shell(f"ulimit -n 5; {command}", cwd=tmp_path)
        assert (done.returncode, done.stdout) == (1, "")
        assert done.stderr.startswith("cubepath: too few open files are allowed: 5, expected ")
        assert done.stderr.endswith(" (ulimit -n)\n")
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]


WILD = "w\x1b[31m\n\x7f\x9b"
SHOWN = r"w\x1b[31m\x0a\x7f\x9b"


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("log info NAME.mcap", 0),
        ("log info FOLDER", 0),
        ("verify FOLDER", 1),
        ("verify FOLDER/NAME.mcap", 1),
        ("log recover NAME.mcap -o FOLDER/NAME-new.mcap", 0),
        ("shorten NAME.jsonl --explain --certificate NAME.json -o NAME-cubes.jsonl", 0),
        ("shorten NAME.jsonl --explain --durations NAME=2", 0),
        ("shorten NAME.jsonl --convert -o NAME-out.jsonl", 0),
        ("complex arm:n=3 -o NAME.json", 0),
        ("view NAME.mcap -o NAME.svg", 0),
        ("log info NAME-none.mcap", 2),
        ("shorten NAME-none.jsonl -o o.jsonl", 2),
    ],
)
def test_control_characters_of_names_are_shown(
    line: str, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """In answers and in complaints, so that a name gives no orders to a terminal."""
    monkeypatch.chdir(tmp_path)
    folder = Path(f"folder{WILD}")
    folder.mkdir()
    shutil.copy(RECORDING, f"{WILD}.mcap")
    whole = Path(RECORDING).read_bytes()
    (folder / f"{WILD}.mcap").write_bytes(whole[: len(whole) * 3 // 4])
    move = {"id": WILD, "support": [0], "trace": [0], "before": [], "after": [0]}
    Path(f"{WILD}.jsonl").write_text(json.dumps(move) + "\n")
    words = line.replace("FOLDER", "folderNAME").split()
    assert main([word.replace("NAME", WILD) for word in words]) == code
    told = capsys.readouterr()
    said = told.out + told.err
    assert SHOWN in said
    assert WILD not in said
    assert all(each.isprintable() for each in said.replace("\n", ""))
    assert all(each.startswith("cubepath: ") for each in told.err.splitlines())


def test_a_document_has_names_as_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """JSON has escapes of its own."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(RECORDING, f"{WILD}.mcap")
    assert main(["log", "info", f"{WILD}.mcap", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["log"] == f"{WILD}.mcap"
