"""Rules from files: FILE.py:NAME wherever a rule is named, and one line for what is wrong."""

import json
from pathlib import Path

import pytest

from cubepath.agents.rules.registry import rule_in_file, rule_named, rules
from cubepath.coordinator.commands.main import main
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.specs import scene_from_spec
from processes.command_line import here, refused

RULES = """
from dataclasses import dataclass
from cubepath.agents import RuleType


@dataclass
class Memory:
    asked: int = 0


def make(knowledge):
    memory = Memory()

    def choose(view):
        memory.asked += 1
        return int(view.mask.nonzero()[0][-1])

    return choose


LAST = RuleType("last", "the last legal action", "a test", lambda system: True, make)
NARROW = RuleType("narrow", "for nothing", "a test", lambda system: False, make)
BROKEN = RuleType("broken", "cannot tell", "a test", lambda system: 1 / 0, make)
OTHER = "no rule"
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "own.rules.py"
    path.write_text(RULES)
    return path


def test_a_rule_is_found_in_a_file(file: Path) -> None:
    """By its name in the file; the file is run once."""
    system = scene_from_spec("hex:n=3").system
    rule = rule_named(f"{file}:LAST", system)
    assert rule.name == "last"
    assert rule_in_file(f"{file}:LAST") is rule
    with pytest.raises(InputError, match=r"not for the free clock: .*, or a RuleType with free="):
        rule_named(f"{file}:LAST", system, "free")


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("own.rules.py:LASD", r"no rule 'LASD' \(did you mean 'LAST'\?\), expected a RuleType"),
        ("own.rules.py:OTHER", "no rule 'OTHER', expected a RuleType, found BROKEN, LAST, NARROW"),
        ("own.rules.py:BROKEN", r"rule 'broken' \(.*own.rules.py\): its fits: ZeroDivisionError"),
        ("own.rules.py:NARROW", "not for this system: rule '.*NARROW', expected one of"),
        ("nowhere.py:LAST", r"nowhere\.py: no such file, expected FILE\.py:NAME"),
        ("folder.py:LAST", r"folder\.py: is a folder, expected FILE\.py:NAME"),
        ("own.rules.py", r"unknown rule '.*own\.rules\.py' \(a rule in a file is FILE\.py:NAME\)"),
        ("bad.py:LAST", r"bad\.py: SyntaxError: "),
        ("leaves.py:LAST", r"leaves\.py: SystemExit: 3"),
    ],
)
def test_what_is_wrong_is_one_line(file: Path, name: str, why: str) -> None:
    """With the file, what was found and what was expected."""
    file.with_name("bad.py").write_text("def :\n")
    file.with_name("folder.py").mkdir()
    file.with_name("leaves.py").write_text("raise SystemExit(3)\n")
    with pytest.raises(InputError, match=why) as error:
        rule_named(f"{file.parent}/{name}", scene_from_spec("hex:n=3").system)
    assert "\n" not in str(error.value)


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("processes", ["0", "2"])
def test_a_run_takes_a_rule_from_a_file(file: Path, processes: str) -> None:
    """In one process and in several; the recording says which, and its name has no path."""
    options = ["--rule", f"./{file.name}:LAST", "--max-rounds", "3", "--processes", processes]
    done = here("run", "hex:n=3", *options, "--json", cwd=file.parent)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["moves"] > 0
    assert document["rule"] == f"./{file.name}:LAST"
    assert Path(document["log"]).name.startswith("hex-own.rules.py-LAST-0-")


def test_a_rule_that_cannot_tell_what_it_fits_leaves_the_others_usable(
    file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The list of rules names it in one line, and messages on other rules leave it out."""
    broken = rule_in_file(f"{file}:BROKEN")
    monkeypatch.setitem(rules(), "broken", broken)
    assert main(["rule", "list"]) == 0
    told = capsys.readouterr()
    assert "random: " in told.out
    (line,) = told.err.splitlines()
    assert f"rule 'broken' ({file}): its fits: ZeroDivisionError: division by zero" in line
    system = scene_from_spec("hex:n=3").system
    with pytest.raises(
        InputError, match=r"'x', expected one of random, metropolis, chain, chains, leader$"
    ):
        rule_named("x", system)


@pytest.mark.slow
@pytest.mark.parametrize("command", ["run", "sweep", "simulate --system", "rule check"])
def test_each_command_says_which_rule_cannot_tell_what_it_fits(file: Path, command: str) -> None:
    """In one line, with its file."""
    name = f"{file}:BROKEN"
    rule = [name, "hex:n=3"] if command == "rule check" else ["hex:n=3", "--rule", name]
    assert f"rule 'broken' ({file}): its fits: Zero" in refused(*command.split(), *rule)
