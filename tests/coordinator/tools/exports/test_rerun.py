"""What rerun's own command line says of the files that are exported for it."""

import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cubepath.agents.rendering.pictures import solid_of
from cubepath.coordinator.runs.states import states_of
from cubepath.coordinator.tools.exports.exporting import export
from cubepath.protocol.recordings.recording import read_recording
from processes.command_line import GOLDEN
from samples.recordings import new_path

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
    assert {"/robot/modules", "/tf"} <= {topic for _, topic, _ in topics}
    assert {(status, issues) for status, _, issues in topics} == {("ok", "—")}


def test_its_check_would_find_something() -> None:
    """A file that is cut off is not all right."""
    export(PATHS[0], out := new_path(".mcap"), foxglove=True)
    out.write_bytes(out.read_bytes()[:-1000])
    assert rerun("mcap", "check", out).returncode == 1


@each_recording
def test_entities_are_where_the_modules_are(path: Path) -> None:
    """Each round has its boxes, at the sites of all modules, as rerun's own reader finds them."""
    recording = read_recording(path)
    told = export(recording, out := new_path(".rrd"))
    assert rerun("rrd", "verify", out).returncode == 0
    expected = {
        state.round: [
            body.middle
            for site in state.sites
            if (body := solid_of(recording.scene, site)) is not None
        ]
        for state in states_of(recording)
    }
    assert told.count == len(expected)
    reader: Any = import_module("rerun.chunk").RrdReader(out)
    clock = "level" if recording.clock == "free" else "round"
    found: dict[int, Any] = {}
    for chunk in reader.stream().to_chunks():
        if chunk.entity_path == "/robot/modules":
            batch = chunk.to_record_batch()
            if clock not in batch.schema.names:  # modules on their ways, between two rounds
                continue
            (centres,) = (name for name in batch.schema.names if "centers" in name)
            found |= zip(batch[clock].to_pylist(), batch[centres].to_pylist(), strict=True)
    assert found.keys() == expected.keys()
    for number, at in expected.items():
        assert np.array(found[number]) == pytest.approx(np.array(at), abs=1e-6)
