"""`cubepath run --from LOG --round N` and `cubepath replay LOG --modules MODULES`."""

import json
from pathlib import Path

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.verification.recording import verify
from cubepath.coordinator.verification.recovery import recover
from processes.command_line import GOLDEN
from tampering.wrecks import taken_apart

LOG = str(GOLDEN / "agv-6.mcap")
Capture = pytest.CaptureFixture[str]


def test_a_run_goes_on_and_names_its_parent(tmp_path: Path, capsys: Capture) -> None:
    """For people in rows, for machines in one document; the recording is a whole one."""
    out = tmp_path / "child.mcap"
    options = ["--rule=random", "--round=5", "--max-rounds=7", "--processes=0", "--log", str(out)]
    assert main(["run", "--from", LOG, *options]) == 0
    told = capsys.readouterr().out
    assert f"parent         {LOG}, rule pibt: 4 of its rounds\n" in told
    assert "what if        rule random from round 5 on\nrounds         7\n" in told
    assert verify(out).ok
    assert main(["log", "info", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["parameters"]
    assert (found["parent"], found["what_if"], found["from_round"]) == ("agv-6.mcap", "random", "5")
    again = [*options[:-1], str(tmp_path / "again.mcap")]
    assert main(["run", "--from", LOG, *again, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["from_round"], document["what_if"], document["rounds"]) == (5, "random", 7)
    assert document["path_digest"] == verify(out).path_digest


def test_live_modules_are_compared(tmp_path: Path, capsys: Capture) -> None:
    """Exit code 0 if all is the same, and 1 with the divergence on both streams."""
    assert main(["replay", LOG, "--modules=0-1", "--processes=0"]) == 0
    assert capsys.readouterr().out == "the same for 16 of 16 rounds\n"
    out = str(tmp_path / "live.mcap")
    other = ["--modules=all", "--rule=random", "--processes=0", "--json", "--log", out]
    assert main(["replay", LOG, *other]) == 1
    told = capsys.readouterr()
    document = json.loads(told.out)
    divergence = document["divergence"]
    assert (document["same"], document["recording"]) == (False, out)
    assert document["rounds"] == divergence["round"] - 1
    line = told.err.splitlines()[-1]
    who = f"round {divergence['round']}, module_{divergence['module']}"
    assert line == (
        f"cubepath: {LOG}: {who}: {divergence['live']}; on record {divergence['recorded']}"
    )


def test_a_recording_that_was_cut_off_says_so(tmp_path: Path, capsys: Capture) -> None:
    """What is not played is said, and the rest is."""
    cut = tmp_path / "cut.mcap"
    cut.write_bytes((GOLDEN / "agv-6.mcap").read_bytes()[:20000])
    assert main(["replay", str(cut), "--modules=0", "--processes=0"]) == 0
    told = capsys.readouterr()
    rounds = int(told.out.split()[3])
    assert f"could be read before it; it is used up to round {rounds}\n" in told.err


def test_what_a_hole_leaves_is_used_and_what_begins_late_is_refused_in_one_line(
    tmp_path: Path, capsys: Capture
) -> None:
    """Recovered or not; where the beginning is lost the damage is told with the refusal."""
    whole = (GOLDEN / "hex-5.mcap").read_bytes()
    chunks = taken_apart("hex-5", whole).chunks
    hole, saved = tmp_path / "hole.mcap", tmp_path / "saved.mcap"
    for place, no_start in ((3, False), (0, True)):
        middle = sum(chunks[place][:2]) // 2
        hole.write_bytes(whole[:middle] + bytes([whole[middle] ^ 0xFF]) + whole[middle + 1 :])
        saved.unlink(missing_ok=True)
        recover(hole, saved)
        for path in (hole, saved):
            for words in (
                ["replay", "--modules=0"],
                ["run", "--rule=chain", "--round=3", "--from"],
            ):
                out = tmp_path / f"{path.stem}-{place}-{words[0]}.mcap"
                keep = ["--log", str(out), "--processes", "0"]
                code = main([*words, str(path), *keep])
                told = capsys.readouterr()
                if no_start:
                    assert (code, told.err.count("\n")) == (2, 1)
                    assert f"{path}: begins in round 3, expected a recording from" in told.err
                    assert ("corrupt at byte" in told.err) == (path == hole)
                else:
                    assert told.err.count("it is used up to round 7\n") == 1
