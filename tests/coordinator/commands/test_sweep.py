"""``cubepath sweep``: many runs in one command, and a line for what is wrong."""

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.experiments.folder import read_runs
from processes.command_line import PYTHON


def test_a_sweep_is_played_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All runs, with what did not fit on standard error; the second time nothing is left to do."""
    words = ["hex:n=4,5", "agv:n=2", "--rule", "chain,random", "--seeds", "2", "--max-rounds", "9"]
    out = ["-o", str(tmp_path / "out"), "--json"]
    for known in (0, 10):
        assert main(["sweep", *words, *out]) == 0
        told = capsys.readouterr()
        document = json.loads(told.out)
        assert (document["runs"], document["finished"], document["known"]) == (10, 10, known)
        assert document["ended"] == {"max-rounds": 10}
        assert told.err.count("left out: agv:n=2: not for this system: rule 'chain'") == 1
    assert len(read_runs(tmp_path / "out")) == 10


def test_a_dry_run_lists_what_would_be_played(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """And plays nothing."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "spec.toml").write_text('systems = "hex:n=4"\nseeds = 3\nhesitate = [0, 0.5]\n')
    assert main(["sweep", "spec.toml", "--dry-run"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "hex:n=4, rule chain, lockstep, hesitate 0, faults none, compiled: 3 runs",
        "hex:n=4, rule chain, lockstep, hesitate 0.5, faults none, compiled: 3 runs",
        "6 runs",
    ]
    assert main(["sweep", "spec.toml", "--dry-run", "--json", "--seeds", "4,7"]) == 0
    assert json.loads(capsys.readouterr().out)["settings"][0]["seeds"] == [4, 7]
    assert [each.name for each in tmp_path.iterdir()] == ["spec.toml"]


@pytest.mark.thorough
def test_a_rule_that_fails_is_told_when_all_others_were_played(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 1, with the system, the rule, the seed and the reason."""
    (tmp_path / "mine.py").write_text(
        "from dataclasses import replace\n"
        "from cubepath.agents.rules.uniform import RANDOM\n"
        "def make(known):\n"
        "    print('one more')\n"
        "    return 1 // (known.modules - 5) and RANDOM.make(known)\n"
        "MINE = replace(RANDOM, make=make, vectorised=None)\n"
    )
    rule = f"{tmp_path}/mine.py:MINE"
    words = ["hex:n=4..6", "--rule", rule, "--seeds", "1", "--max-rounds", "5", "--json"]
    assert main(["sweep", *words, "-o", str(tmp_path / "out")]) == 1
    told = capsys.readouterr()
    document = json.loads(told.out)
    assert (document["finished"], document["failures"]) == (3, 1)
    line = f"cubepath: hex:n=5, rule {rule}, seed 0: error: "
    assert any(each.startswith(line) and "ZeroDivision" in each for each in told.err.splitlines())


@pytest.mark.thorough
def test_an_interrupt_keeps_what_is_finished(tmp_path: Path) -> None:
    """Exit code 130, no process left, and the rest is played the next time."""
    out = tmp_path / "out"
    words = ["sweep", "hex:n=20..60", "--rule", "random", "--seeds", "100", "-o", str(out)]
    with subprocess.Popen(
        [*PYTHON, *words, "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
    ) as process:
        while not list(out.glob("runs/*.parquet")):
            assert process.poll() is None
            time.sleep(0.05)
        os.killpg(process.pid, signal.SIGINT)
        told, error = process.communicate(timeout=100)
    assert process.returncode == 130
    assert error.splitlines()[-1] == "cubepath: interrupted"
    finished = json.loads(told)["finished"]
    assert 0 < finished == len(read_runs(out)) < 4100
    deadline = time.monotonic() + 30
    with pytest.raises(ProcessLookupError):
        while time.monotonic() < deadline:  # the one that tracks the others ends after them
            os.killpg(process.pid, 0)
            time.sleep(0.05)
