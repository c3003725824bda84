"""The command ``simulate``: its answer, its exit codes, a rule that fails, and an interrupt."""

import json
import signal
import subprocess
from pathlib import Path

import pytest

from processes.command_line import PYTHON, cubepath, here

pytestmark = pytest.mark.slow

FICKLE = """
from cubepath.agents.rules.rule import RuleType

made = 0


def make(knowledge):
    global made
    made += 1
    nth = made
    return lambda view: int(view.mask.nonzero()[0][-1]) if nth % 3 else 0


def broken(view):
    raise KeyError("left")


RULE = RuleType("fickle", "does another thing each time", "none", lambda system: True, make)
BROKEN = RuleType("broken", "raises", "none", lambda system: True, lambda knowledge: broken)
"""


@pytest.fixture
def fickle(tmp_path: Path) -> dict[str, str]:
    """Return the environment with a rule whose modules do not do the same twice."""
    (tmp_path / "fickle.py").write_text(FICKLE)
    info = tmp_path / "fickle-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: fickle\nVersion: 1\n")
    (info / "entry_points.txt").write_text(
        "[cubepath.rules]\nfickle = fickle:RULE\nbroken = fickle:BROKEN\n"
    )
    return {"PYTHONPATH": str(tmp_path)}


def with_path(extra: dict[str, str]) -> dict[str, str]:
    import os

    return {**os.environ, **extra}


@pytest.mark.thorough
def test_the_answer_is_a_document(tmp_path: Path) -> None:
    """Seeds, failures, steps and faults by kind, and nothing is left behind."""
    done = here("simulate", "--seeds", "0..7", "--json", "--out", tmp_path / "logs")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["seeds"] == 8
    assert document["failures"] == 0
    assert document["steps"] > 1000
    assert document["faults"]["loss"] > 0
    assert not (tmp_path / "logs").exists()


def test_the_answer_in_words(tmp_path: Path) -> None:
    """A table, the same seeds and steps each time."""
    runs = [here("simulate", "--seeds", "3..3", "--out", tmp_path) for _ in range(2)]
    lines = [run.stdout.splitlines()[:9] for run in runs]
    assert lines[0] == lines[1]
    assert lines[0][:2] == ["seeds                       1", "failures                    0"]


@pytest.mark.thorough
def test_a_failing_seed_is_told_and_kept(tmp_path: Path, fickle: dict[str, str]) -> None:
    """One line with what failed, the command that replays it and the log; exit code 1."""
    options = ["--system", "agv:graph=K3,n=2", "--rule", "fickle"]
    out = tmp_path / "out"
    done = cubepath(
        "simulate", "--seeds", "4..4", *options, "--out", out, "--json", env=with_path(fickle)
    )
    assert done.returncode == 1, done.stderr
    (failed,) = json.loads(done.stdout)["failed"]
    command = f"cubepath simulate --seeds 4..4 {' '.join(options)}"
    assert failed["command"] == command
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"cubepath: seed 4: {failed['kind']}: ")
    assert line.endswith(f"; replay: {command}; log: {out}/simulated-4.mcap")
    assert Path(failed["log"]).exists()
    assert all(Path(picture).exists() for picture in failed["pictures"])


@pytest.mark.thorough
def test_a_rule_that_raises_is_a_failing_seed(tmp_path: Path, fickle: dict[str, str]) -> None:
    """It fails without any fault, which is told; what there is of a recording can be read."""
    options = ["--seeds", "4..4", "--system", "agv:graph=K3,n=2", "--rule", "broken"]
    done = cubepath("simulate", *options, "--out", tmp_path / "out", env=with_path(fickle))
    assert done.returncode == 1
    assert "seed 4: rule: without faults: rule 'broken', module_0: KeyError" in done.stderr
    assert here("log", "info", tmp_path / "out" / "simulated-4.mcap").returncode == 0


@pytest.mark.thorough
@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.thorough)]
)
def test_an_interrupt_ends_with_what_was_found(tmp_path: Path, number: signal.Signals) -> None:
    """Exit code 130, and the seeds so far are counted."""
    with subprocess.Popen(
        [*PYTHON, "simulate", "--seeds", "0..999999", "--json", "--out", str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=with_path({"CUBEPATH_PROGRESS": ""}),
    ) as child:
        assert child.stderr is not None
        first = child.stderr.readline()  # the line of progress after some seconds
        child.send_signal(number)
        try:
            out, err = child.communicate(timeout=60)
        finally:
            child.kill()
    assert "simulate: " in first
    assert child.returncode == 130
    assert err.splitlines()[-1] == "cubepath: interrupted"
    document = json.loads(out)
    assert 0 < document["seeds"] < 1_000_000
    assert document["failures"] == 0


SOMETIMES = """
from cubepath.agents.rules.rule import RuleType
from cubepath.coordinator.testing import sometimes

def make(knowledge):
    def act(view):
        sometimes(view.mask.sum() > 1, "a module may move")
        sometimes(view.mask.sum() > 99, "a module may go anywhere")
        return 0
    return act

MINE = RuleType("mine", "stays", "none", lambda system: True, make)
"""


def test_what_no_seed_has_met_is_told(tmp_path: Path) -> None:
    """A line each with where the rule asks for it, and exit code 1; also in the document."""
    rule = tmp_path / "mine.py"
    rule.write_text(SOMETIMES)
    options = ("--seeds", "1", "--system", "agv:graph=K3,n=2", "--rule", f"{rule}:MINE")
    done = here("simulate", *options, "--json")
    assert done.returncode == 1
    assert done.stderr.startswith(f"cubepath: {rule}:8: 'a module may go anywhere' was false in ")
    document = json.loads(done.stdout)
    assert document["failures"] == 0
    assert done.stderr == f"cubepath: {document['never_met'][0]}\n"
