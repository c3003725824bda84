"""`cubepath record` beside other commands, each a process of its own."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from cubepath.protocol.recordings.recording import read_recording
from elsewhere import Commands

pytestmark = pytest.mark.slow


@pytest.fixture
def commands(tmp_path: Path) -> Iterator[Commands]:
    """Return what starts commands, and ends them."""
    with Commands(tmp_path) as found:
        yield found


def test_the_line_that_a_run_says_of_itself_is_what_record_takes(
    commands: Commands, tmp_path: Path
) -> None:
    """Also of a run that listens at an address: its endpoint and its name, to be pasted."""
    run = commands.start("run", "hex:n=3", "--listen=tcp/127.0.0.1:0", "--wait-for=1")
    run.says(r"listening on \S+ without TLS")
    endpoint, name = run.says(r"endpoint (\S+), run (\S+)").groups()
    recorder = commands.start("record", "--connect", endpoint, "--run", name, "-o", "out.mcap")
    recorder.says(f"recording run {name}")
    commands.start("join", "--connect", endpoint, "--modules=0-2")
    assert run.end()[0] == 0
    assert recorder.end()[0] == 0
    assert read_recording(tmp_path / "out.mcap").parameters["attached"] == "1"
