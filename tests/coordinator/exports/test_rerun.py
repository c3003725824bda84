"""What rerun's own command line says of the files that are exported for it."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from command_line import GOLDEN
from cubepath.agents.rendering.pictures import solid_of
from cubepath.coordinator.exports.exporting import export
from cubepath.coordinator.runs.states import states_of
from cubepath.protocol.recordings.recording import read_recording
from recordings import new_path

pytestmark = pytest.mark.thorough
PATHS = sorted(GOLDEN.glob("*.mcap"))
each_recording = pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)


def rerun(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run rerun's command line."""
    command = shutil.which("rerun", path=str(Path(sys.executable).parent))
    assert command is not None
    return subprocess.run(
        [command, *map(str, arguments)], capture_output=True, text=True, timeout=100, check=False
    )


@each_recording
@pytest.mark.parametrize("log_time", [None, "wall"])
def test_its_check_finds_nothing(path: Path, log_time: Any) -> None:
    """In the file with all messages and the robot, whatever its log times are."""
    export(path, out := new_path(".mcap"), foxglove=True, log_time=log_time)
    told = rerun("mcap", "check", "--full", out)
    assert told.returncode == 0, told.stdout
    topics = re.findall(r"^(\S+) +\d+ +\d+ +(\S+) +(\S+)$", told.stdout, re.MULTILINE)
    assert {"/robot/poses", "/robot/modules", "/tf"} <= {topic for _, topic, _ in topics}
    assert {(status, issues) for status, _, issues in topics} == {("ok", "—")}


def test_its_check_would_find_something() -> None:
    """A file that is cut off is not all right."""
    export(PATHS[0], out := new_path(".mcap"), foxglove=True)
    out.write_bytes(out.read_bytes()[:-1000])
    assert rerun("mcap", "check", out).returncode == 1


@each_recording
def test_entities_are_where_the_modules_are(path: Path) -> None:
    """Each round has its boxes, at the sites of the first modules; and the file can be loaded."""
    recording = read_recording(path)
    told = export(recording, out := new_path(".rrd"))
    assert rerun("rrd", "verify", out).returncode == 0
    expected = {}
    for state in states_of(recording):
        bodies = [solid_of(recording.scene, site) for site in state.sites[:3]]
        expected[state.round] = [x for body in bodies if body is not None for x in body.middle]
    assert told.count == len(expected)
    found: dict[int, list[float]] = {}
    for chunk in rerun("rrd", "print", "-vvv", out).stdout.split("Chunk(")[1:]:
        if " - /robot/modules - " in chunk.partition("\n")[0]:
            for number, centres in re.findall(r"┆ (\d+) +┆ PT?\w+ +┆ \[(\[.*?)┆", chunk):
                numbers = [float(each) for each in re.findall(r"-?\d+\.\d+(?:e-?\d+)?", centres)]
                found[int(number)] = numbers[: len(expected[int(number)])]
    assert found.keys() == expected.keys()
    for number, at in expected.items():
        assert found[number] == pytest.approx(at, abs=1e-6)
