"""Several recordings in one command: files and folders, each told by itself."""

import contextlib
import json
import os
import shutil
import tracemalloc
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.commands.main import main
from processes.command_line import GOLDEN, in_shell, without_reader

Capture = pytest.CaptureFixture[str]
both = pytest.mark.parametrize("command", ["log info", "verify"])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Go to a folder with a folder of recordings, one of which is cut, and something else."""
    runs = tmp_path / "runs"
    runs.mkdir()
    shutil.copy(GOLDEN / "agv-3.mcap", runs / "b.mcap")
    shutil.copy(GOLDEN / "agv-3.mcap", runs / "a.mcap")
    (runs / "README.md").write_text("no recording")
    os.mkfifo(runs / "pipe.mcap")  # which nobody writes to
    (runs / "folder.mcap").mkdir()
    (tmp_path / "bad.mcap").write_text("no recording")
    whole = (runs / "a.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 3])
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def answered(capsys: Capture, *arguments: str, code: int = 0) -> tuple[Any, list[str]]:
    """Return the JSON document of a command, and the lines on standard error."""
    assert main([*arguments, "--json"]) == code
    told = capsys.readouterr()
    return json.loads(told.out), told.err.splitlines()


@both
def test_a_folder_stands_for_the_recordings_in_it(
    command: str, folder: Path, capsys: Capture
) -> None:
    """In sorted order, and each with the document that it has alone, and its name."""
    alone, _ = answered(capsys, *command.split(), "runs/a.mcap")
    assert isinstance(alone, dict)
    found, said = answered(capsys, *command.split(), "runs")
    assert [each["log"] for each in found] == ["runs/a.mcap", "runs/b.mcap"]
    assert found[0] == {"log": "runs/a.mcap", **alone}
    assert said == []
    again, _ = answered(capsys, *command.split(), "runs/b.mcap", "runs/a.mcap")
    assert again == found[::-1]


@both
def test_people_read_a_heading_for_each_file(command: str, folder: Path, capsys: Capture) -> None:
    """One file alone has none."""
    assert main([*command.split(), "runs/a.mcap"]) == 0
    alone = capsys.readouterr().out
    assert main([*command.split(), "runs/a.mcap", "runs"]) == 0
    first, second, third = capsys.readouterr().out.split("\n\n")
    assert first + "\n" == f"==> runs/a.mcap <==\n{alone}"
    assert second == first
    assert third.startswith("==> runs/b.mcap <==\n")


@both
def test_what_cannot_be_read_does_not_stop_the_others(
    command: str, folder: Path, capsys: Capture
) -> None:
    """One line for each on standard error, and the worst exit code."""
    names = ["bad.mcap", "empty", "runs/a.mcap", "none.mcap"]
    found, said = answered(capsys, *command.split(), *names, code=2)
    assert [each["log"] for each in found] == names
    assert ["unreadable" in each for each in found] == [True, True, False, True]
    assert said == [f"cubepath: {each['unreadable']}" for each in found if "unreadable" in each]
    assert found[1]["unreadable"] == "empty: a folder without .mcap files, expected recordings"
    alone, said = answered(capsys, *command.split(), "empty", code=2)
    assert (alone, len(said)) == ([found[1]], 1)


def test_the_exit_code_is_that_of_the_worst(folder: Path, capsys: Capture) -> None:
    """A check that fails is less than a file that cannot be read, wherever it stands."""
    found, said = answered(capsys, "verify", "cut.mcap", "runs", code=1)
    assert [each["ok"] for each in found] == [False, True, True]
    assert len(said) == 1
    assert said[0].startswith("cubepath: cut.mcap: checks failed: ")
    answered(capsys, "verify", "bad.mcap", "cut.mcap", code=2)
    answered(capsys, "verify", "cut.mcap", "bad.mcap", code=2)


@pytest.mark.thorough
def test_memory_does_not_grow_with_the_number_of_files(folder: Path) -> None:
    """Fifteen recordings take what three take, but for what waits to be collected."""

    def peak(count: int) -> int:
        out = Path("out.json")
        with out.open("w") as stream, contextlib.redirect_stdout(stream):
            tracemalloc.start()
            code = main(["log", "info", "--json", *[str(GOLDEN / "hex-5.mcap")] * count])
            _, most = tracemalloc.get_traced_memory()
            tracemalloc.stop()
        assert (code, len(json.loads(out.read_text()))) == (0, count)
        return most

    peak(3)  # what is loaded once
    assert peak(15) < 2 * peak(3)  # kept, they would be five times as much


@pytest.mark.slow
def test_a_list_that_nobody_reads_ends_quietly(folder: Path) -> None:
    """As one document does; and one recording may come by standard input."""
    done = without_reader("verify", "runs", "--json")
    assert (done.returncode, done.stderr) == (141, "")
    done = in_shell("cubepath log info runs - --json < runs/a.mcap")
    assert (done.returncode, done.stderr) == (0, "")
    found = json.loads(done.stdout)
    assert [each["log"] for each in found] == ["runs/a.mcap", "runs/b.mcap", "standard input"]
    assert {**found[2], "log": "runs/a.mcap"} == found[0]


@pytest.mark.slow
def test_what_was_recovered_is_replayed_as_far_as_it_goes(folder: Path, capsys: Capture) -> None:
    """Exit code 0 and `complete: false`; the damaged file it came from is said to be damaged."""
    assert main(["log", "recover", "cut.mcap", "-o", "whole.mcap"]) == 0
    capsys.readouterr()
    found, said = answered(capsys, "replay", "whole.mcap")
    assert (found["same"], found["complete"], said) == (True, False, [])
    assert main(["replay", "whole.mcap"]) == 0
    lines = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()]
    assert lines[-2:] == [
        ["result", "the same as recorded, as far as it goes"],
        ["complete", "false; the run was cut off"],
    ]
    found, said = answered(capsys, "replay", "cut.mcap")
    assert (found["same"], found["complete"], len(said)) == (True, False, 1)
    assert "cut.mcap: truncated at byte" in said[0]
