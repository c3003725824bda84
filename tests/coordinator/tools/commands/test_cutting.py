"""`cubepath log filter`, `split` and `merge`: recordings in, recordings out."""

import json
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.protocol.recordings.recording import read_recording
from processes.command_line import GOLDEN

Capture = pytest.CaptureFixture[str]
LOG = str(GOLDEN / "agv-3.mcap")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Go to an empty folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def answered(capsys: Capture, *arguments: str) -> Any:
    """Return the JSON document of a command."""
    assert main([*arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_split_and_merged_it_is_the_recording(capsys: Capture) -> None:
    """The parts are named after the recording, and all of them make it again."""
    found = answered(capsys, "log", "split", LOG, "-o", "parts", "--rounds", "6")
    assert found["parts"] == [f"parts/agv-3-00{number}.mcap" for number in range(3)]
    told = answered(capsys, "log", "merge", *reversed(found["parts"]), "-o", "whole.mcap")
    assert told == {"messages": 241, "recordings": 3, "output": "whole.mcap"}
    whole = read_recording(Path("whole.mcap"))
    assert list(whole.records) == list(read_recording(LOG).records)


def test_verify_says_why_a_part_is_not_complete(capsys: Capture) -> None:
    """It was cut from a longer one, which is not the same as a run that was cut off."""
    answered(capsys, "log", "filter", LOG, "-o", "late.mcap", "--from", "3")
    assert main(["verify", "late.mcap"]) == 0
    kept = len(read_recording(Path("late.mcap")).records)
    last = capsys.readouterr().out.splitlines()[-2:]
    why = f"{kept} of 241 messages (from 3)"
    assert last == [f"complete: false; {why}, and this part is fine", f"choices not checked: {why}"]


def test_a_filter_says_how_much_it_took(capsys: Capture) -> None:
    """Patterns may be given several times; the parameters of the result say what was taken."""
    arguments = ["--topics", "reports", "--topics", "ready/*", "--exclude", "*_1", "--until", "4"]
    found = answered(capsys, "log", "filter", LOG, "-o", "some.mcap", *arguments)
    kept = list(read_recording(Path("some.mcap")).records)
    assert found == {"messages": len(kept), "of": 241, "output": "some.mcap"}
    assert {record.topic for record in kept} == {*("reports/process_0", "ready/process_0")}
    told = answered(capsys, "log", "info", "some.mcap")["parameters"]
    assert told["filtered"] == "topics reports ready/*, without *_1, until 4"
    assert told["whole_messages"] == "241"
    assert main(["verify", "some.mcap"]) == 0
    assert f"{len(kept)} of 241 messages (topics reports" in capsys.readouterr().out
