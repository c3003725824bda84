"""`cubepath log export`: tables on standard output and in files."""

import csv
import io
import json
from pathlib import Path

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.protocol.recordings.recording import read_recording
from processes.command_line import GOLDEN, cubepath

LOG = str(GOLDEN / "hex-5.mcap")


@pytest.mark.thorough
def test_rows_go_to_standard_output() -> None:
    """As CSV by default, as one JSON list with --json, and otherwise as asked; nothing else."""
    moves = read_recording(LOG).moves()
    found = list(csv.DictReader(io.StringIO(cubepath("log", "export", LOG).stdout)))
    assert [int(row["round"]) for row in found] == moves["round"].tolist()
    done = cubepath("log", "export", LOG, "--json")
    assert [row["module"] for row in json.loads(done.stdout)] == moves["module"].tolist()
    assert done.stderr == "28 moves written to standard output\n"
    lines = cubepath(
        "log", "export", LOG, "--table", "rounds", "--format", "jsonl", "-o", "-"
    ).stdout.splitlines()
    assert [json.loads(line)["round"] for line in lines] == list(range(30))
    converted = cubepath("shorten", LOG, "--convert", "-o", "-").stdout
    assert cubepath("log", "export", LOG, "--format", "moves").stdout == converted


def test_a_file_has_the_form_of_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Or the one that is asked for; --json is the answer then."""
    out = tmp_path / "claims.jsonl"
    count = int((read_recording(LOG).claims()["round"] <= 9).sum())
    assert (
        main(["log", "export", LOG, "-o", str(out), "--table", "claims", "--until", "9", "--json"])
        == 0
    )
    told = json.loads(capsys.readouterr().out)
    assert told == {"what": "claims", "form": "jsonl", "count": count, "output": str(out)}
    assert len(out.read_text().splitlines()) == count
    assert main(["log", "export", LOG, "-o", str(tmp_path / "x.txt"), "--format", "csv"]) == 0
    assert capsys.readouterr().out == f"28 moves written to {tmp_path}/x.txt\n"
