"""No command runs code that an input names: a rule in a file runs only if you name the file."""

from __future__ import annotations

import contextlib
from pathlib import Path

import pytest

from command_line import GOLDEN, refused
from cubepath.agents.rules.rule_files import forget_rule_files
from cubepath.coordinator import run
from cubepath.coordinator.commands.main import main

CANARY = """
from pathlib import Path
from cubepath.agents import FreeRule, RuleType

Path(__file__).with_name("ran").touch()
MINE = RuleType(
    "mine",
    "moves",
    "a test",
    lambda system: True,
    lambda knowledge: lambda view: int(view.mask.nonzero()[0][-1]),
    free=FreeRule("it knows nothing"),
)
"""
SPEC = 'systems = "hex:n=3"\nrules = "canary.py:MINE"\nseeds = 1\nmax_rounds = 2\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with recordings under either clock and a sweep that name a file."""
    made = tmp_path_factory.mktemp("named")
    (made / "canary.py").write_text(CANARY)
    (made / "study.toml").write_text(SPEC)
    with contextlib.chdir(made):
        forget_rule_files()
        for seed in (0, 1):
            log = f"{seed}.mcap"
            run("hex:n=3", "canary.py:MINE", processes=0, max_rounds=3, seed=seed, log=log)
            run(
                "hex:n=3",
                "canary.py:MINE",
                clock="free",
                processes=1,
                keepers=1,
                max_rounds=2,
                seed=seed,
                log=f"free-{log}",
            )
        Path("free-0.mcap.keepers").mkdir()
    return made


@pytest.fixture
def canary(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in that folder; return what the file leaves when it runs, which is not there."""
    monkeypatch.chdir(folder)
    forget_rule_files()
    (folder / "ran").unlink(missing_ok=True)
    return folder / "ran"


COMMANDS = [
    "verify 0.mcap",
    "verify 0.mcap --require choices",
    "verify 0.mcap --rule other.py:MINE",
    "verify 0.mcap --recover saved.mcap",
    "verify 0.mcap 1.mcap --same",
    "verify free-0.mcap",
    "info 0.mcap",
    "diff free-0.mcap free-1.mcap",
    "diff 0.mcap 1.mcap",
    "replay 0.mcap --what-if random --from 2 --modules 0 --processes 0",
    "replay 0.mcap --live 0 --processes 0",
    "replay 0.mcap --live 0 --rule random --processes 0",
    "shorten 0.mcap",
    "export 0.mcap -o moves.csv",
    "view 0.mcap -o run.html",
    "filter 0.mcap -o part.mcap",
    "split 0.mcap --parts 2 -o parts",
    "merge 0.mcap 1.mcap -o both.mcap",
    "sweep study.toml -o study --jobs 1",
    "sweep study.toml --dry-run",
    "run --schedule 0.mcap --processes 0",
    "run --resume free-0.mcap --log more.mcap",
]


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_runs_a_file_that_an_input_names(canary: Path, command: str) -> None:
    """Whatever the command makes of the input, the file was not executed."""
    try:
        code = main(command.split())
    except SystemExit as stopped:
        code = int(stopped.code or 0)
    assert code in (0, 1, 2)
    assert not canary.exists()


@pytest.mark.slow
@pytest.mark.parametrize("log", ["0.mcap", "free-0.mcap"])
def test_choices_are_checked_with_a_file_that_you_give(
    canary: Path, log: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without it they are not, which you can require them to be."""
    assert main(["verify", log]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[-1].startswith("choices not checked: rule 'canary.py:MINE' is in a file")
    assert main(["verify", log, "--require", "choices"]) == 1
    assert "checks required and not made: choices" in capsys.readouterr().err
    assert not canary.exists()
    given = ["--rule", f"{canary.parent}/canary.py:MINE", "--require", "choices"]
    assert main(["verify", log, *given]) == 0
    assert canary.exists()


def test_only_what_can_be_required_is_taken() -> None:
    """A check by its name, of a recording."""
    log = str(GOLDEN / "hex-5.mcap")
    assert "--require choses: no such check" in refused("verify", log, "--require", "choses")
    assert "expected recordings" in refused("verify", log, log, "--same", "--require", "choices")
