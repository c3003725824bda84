"""Rules of other distributions: found by entry points, and blamed by name when they fail."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

RULES = """
from cubepath.agents import Choice, RuleType


def rule(name, choose, note_length=0):
    return RuleType(name, "of a test", "a test", lambda s: True, lambda b: choose, lambda n:
    note_length)


def boom(view):
    raise ValueError("first line\\nsecond line")


def leave(view):
    raise SystemExit(7)


def speak(view):
    print("a rule prints")
    return view.legal()[0][0] if view.legal() else 0


FINE = rule("fine", speak)
BOOM = rule("boom", boom)
NONE = rule("none", lambda view: None)
ILLEGAL = rule("illegal", lambda view: 99)
LEAVE = rule("leave", leave)
LONG = rule("long", lambda view: Choice(0, (1, 2, 3)), 2)
HUGE = rule("huge", lambda view: Choice(0, (2**40,)), 1)
GIVE_UP = rule("give-up", lambda view: Choice(failed="no\\nhope"))
"""
NAMES = ("fine", "boom", "none", "illegal", "leave", "long", "huge", "give-up")


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Install a distribution with rules into a folder; return an environment that has it."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "others_rules.py").write_text(RULES)
    info = folder / "others_rules-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: others-rules\nVersion: 1.0\n")
    lines = [f"{n} = others_rules:{n.upper().replace('-', '_')}" for n in NAMES]
    (info / "entry_points.txt").write_text("[cubepath.rules]\n" + "\n".join(lines) + "\n")
    return {**os.environ, "PYTHONPATH": str(folder)}


def cubepath(
    arguments: list[str], environment: dict[str, str], folder: Path
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "cubepath.coordinator", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env=environment,
        cwd=folder,
    )


@pytest.mark.thorough
def test_a_rule_of_another_distribution_runs_and_may_print(
    installed: dict[str, str], tmp_path: Path
) -> None:
    """It is listed and run by name; what it prints does not get into the answer."""
    listed = cubepath(["rule", "list", "--json"], installed, tmp_path)
    assert "fine" in {rule["name"] for rule in json.loads(listed.stdout)}
    for processes in ("0", "2"):
        run = ["run", "hex:n=3", "--rule=fine", "--max-rounds=3", f"--processes={processes}"]
        done = cubepath([*run, "--json"], installed, tmp_path)
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout)["moves"] > 0
        assert "a rule prints" in done.stderr


FAILING = [
    (
        "boom",
        "rule 'boom', module_0, round 1: ValueError: first line second line at others_rules.py:11",
    ),
    ("none", "rule 'none', module_0, round 1: returned None, expected one integer, or a Choice"),
    ("illegal", "rule 'illegal', module_0, round 1: chose action 99, legal were [0"),
    ("leave", "rule 'leave', module_0, round 1: SystemExit: 7 at others_rules.py:15"),
    ("long", "rule 'long', module_0, round 1: a note of 3 numbers, expected 2"),
    ("huge", "rule 'huge', module_0, round 1: a note with 1099511627776"),
    ("give-up", "module_0: no hope"),
]
"""Each with the line that is told of it. All that a rule raises takes one way through processes."""


SHORT = {("illegal", "0"), ("boom", "1")}
"""The others are thorough."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rule", "message", "processes"),
    [
        pytest.param(*each, processes, marks=[] if key in SHORT else pytest.mark.thorough)
        for each in FAILING
        for processes in ("0", "1")
        if (key := (each[0], processes))
    ],
)
def test_a_rule_that_fails_is_named_in_one_line(
    installed: dict[str, str], tmp_path: Path, rule: str, message: str, processes: str
) -> None:
    """Whatever a rule does, the run ends with exit code 1 and one line that says whose it is."""
    run = ["run", "hex:n=3", f"--rule={rule}", f"--processes={processes}", "--json"]
    done = cubepath(run, installed, tmp_path)
    assert done.returncode == 1
    where, line = done.stderr.strip().splitlines()
    assert where.startswith("cubepath: endpoint ")
    assert message in line or message.replace("module_0", "module_1") in line
    assert not json.loads(done.stdout)["goal_reached"]


@pytest.mark.slow
def test_a_broken_entry_point_hurts_only_who_asks_for_it(tmp_path: Path) -> None:
    """The default rule runs beside a distribution that cannot be loaded; `rules` names it."""
    info = tmp_path / "broken-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[cubepath.rules]\nbroken = no_such_module:RULE\n")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    assert cubepath(["run", "hex:n=3", "--processes=0"], environment, tmp_path).returncode == 0
    asked = cubepath(["rule", "list"], environment, tmp_path)
    assert asked.returncode == 2
    assert "entry point broken of cubepath.rules (broken): ModuleNotFoundError" in asked.stderr


@pytest.mark.slow
def test_a_rule_is_found_beside_a_broken_entry_point(
    installed: dict[str, str], tmp_path: Path
) -> None:
    """Asked for by name, it runs whatever else is installed."""
    info = tmp_path / "broken-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[cubepath.rules]\nbroken = no_such_module:RULE\n")
    environment = dict(installed)
    environment["PYTHONPATH"] = f"{tmp_path}{os.pathsep}{installed['PYTHONPATH']}"
    arguments = ["run", "hex:n=3", "--rule=fine", "--max-rounds=2", "--processes=1"]
    done = cubepath(arguments, environment, tmp_path)
    assert done.returncode == 0, done.stderr


@pytest.mark.thorough
def test_modules_import_nothing_from_the_working_folder(tmp_path: Path) -> None:
    """A file called like a library beside the user does not break the processes."""
    (tmp_path / "queue.py").write_text("raise RuntimeError('shadowed')\n")
    script = Path(sys.executable).parent / "cubepath"
    done = subprocess.run(
        [script, "run", "hex:n=3", "--processes=2"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
