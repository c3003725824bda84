"""The command ``check-rule``: its answer in words and as a document, and its exit codes."""

import json
import time
from pathlib import Path

import pytest

from processes.command_line import ROOT, here

pytestmark = pytest.mark.slow

CHEATS = ROOT / "tests" / "agents" / "locality" / "cheats"


@pytest.mark.thorough
def test_a_local_rule_ends_with_0() -> None:
    """With a document of what was compared, and no findings."""
    done = here("rule", "check", "tswap", "agv:graph=C6,n=2", "agv:graph=P7,n=3", "--json")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["local"] is True
    assert document["findings"] == []
    assert document["systems"] == ["agv:graph=C6,n=2", "agv:graph=P7,n=3"]
    assert document["modules"] == 5
    assert document["choices"] > 0
    assert document["changes"] > 0


@pytest.mark.parametrize(
    ("loading", "systems"), [("pass", ["hex:n=3"]), ("pass", []), ("make(None)", ["hex:n=3"])]
)
def test_a_check_ends_in_time(tmp_path: Path, loading: str, systems: list[str]) -> None:
    """One line says so of a rule that never returns, or a file that never ends."""
    text = (CHEATS / "sleeps.py").read_text()
    (tmp_path / "endless.py").write_text(f"{text}\n{loading}\n")
    began = time.monotonic()
    done = here("rule", "check", "endless.py:RULE", *systems, "--timeout=1", cwd=tmp_path)
    line = "not checked within 1 s, expected one that answers sooner, or a longer timeout"
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.splitlines() == [f"cubepath: rule 'endless.py:RULE': {line}"]
    assert time.monotonic() - began < 30


def test_a_finding_is_a_line_and_exit_code_1(tmp_path: Path) -> None:
    """In words below the table; the file is found from the folder of the user."""
    (tmp_path / "clock.py").write_text((CHEATS / "clock.py").read_text())
    done = here("rule", "check", "clock.py:RULE", "hex:n=3", "--seed", "4", cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    lines = done.stdout.splitlines()
    assert lines[:2] == ["rule      clock.py:RULE, seed 4", "systems   hex:n=3"]
    assert lines[4].startswith("changes   0 beyond reach: not tested whether the rule sees farther")
    assert lines[5] == "findings  1"
    assert lines[7].startswith("  uses the clock (time.time_ns in clock.py:11): module_")


@pytest.mark.thorough
def test_a_rule_is_played_without_rounds() -> None:
    """By --clock free, which the answer names."""
    done = here("rule", "check", "tswap", "agv:graph=P7,n=3", "--clock", "free")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0] == "rule      tswap, seed 0, free clock"
    assert "findings  none" in done.stdout


def test_rules_say_under_which_clocks_they_hold() -> None:
    """In words, and in the document with the argument."""
    done = here("rule", "list", "--json")
    listed = {rule["name"]: rule for rule in json.loads(done.stdout)}
    assert listed["chain"]["clocks"] == ["lockstep", "free"]
    assert "a guard keeps walkers apart" in listed["chain"]["free"]
    assert "clocks: lockstep, free" in here("rule", "list").stdout
