"""No command runs code that an input names: a rule in a file runs only if you name the file."""

import contextlib
import io
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cubepath.agents.rules.registry import forget_rule_files
from cubepath.coordinator import replay_live, run, what_if
from cubepath.coordinator.commands.main import main
from cubepath.coordinator.testing.log import RunLog
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.path_files.optimality_proofs import OptimalityProof, write_proof
from cubepath.protocol.scenes.toml import scene_to_toml
from processes.command_line import GOLDEN, refused
from samples.strategies import scene

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
NAMED = "canary.py:MINE"
SPEC = 'systems = "hex:n=3"\nrules = "canary.py:MINE"\nseeds = 1\nmax_rounds = 2\n'
BY_HAND = [
    (
        "run --from 0.mcap --rule canary.py:MINE --round 2 --processes 0 --max-rounds 3 --log"
        " branch.mcap"
    ),
    "run --schedule 0.mcap --repair --rule canary.py:MINE --processes 0 --log repaired.mcap",
    (
        "sweep hex:n=3 --rule canary.py:MINE --seeds 2 --max-rounds 3 --core simulated --jobs 1"
        " --log -o swept"
    ),
    "run named.toml --rule random --processes 0 --max-rounds 4 --log named.mcap",
    "shorten named.mcap -o cubes.jsonl --certificate cubes.certificate.json",
    "shorten named.mcap --convert -o moves.npz",
    "log split branch.mcap --parts 2 -o halves",
]
"""What makes the other inputs, some with the file where you give it."""


class _Pickled:
    """What leaves a trace when it is read from a pickle."""

    def __reduce__(self) -> tuple[object, ...]:
        return Path.touch, (Path("ran"),)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with inputs of every kind that name a file, or hold code."""
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
        text = scene_to_toml(scene("hex:n=3"))
        text = text.replace('"hex:n=3"', f'"{NAMED}"').replace('"hex"', f'"{NAMED}"')
        Path("named.toml").write_text(text)
        end = {(0, 1), (1, 0), (2, 0)}
        move = GeneratorPlacement("pivot-1-right", (0, 0))
        proof = OptimalityProof(
            system=text,
            start=scene("hex:n=3").start,
            goal=sorted(end),
            refuted=0,
            cubes=1,
            moves=[move],
            schedule=[[0]],
        )
        write_proof("named.proof", proof)
        for command in BY_HAND:
            assert main(command.split()) == 0, command
        arrays = dict(np.load("moves.npz"))
        arrays["moves"] = np.array([_Pickled()], dtype=object)
        np.savez("pickled.npz", allow_pickle=True, **arrays)
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
    "verify 0.mcap --rule other/canary.py:THEIRS",
    "log recover 0.mcap -o saved.mcap",
    "diff 0.mcap 1.mcap --same",
    "verify free-0.mcap",
    "log info 0.mcap",
    "diff free-0.mcap free-1.mcap",
    "diff 0.mcap 1.mcap",
    "run --from 0.mcap --rule random --round 2 --modules 0 --processes 0",
    "replay 0.mcap --modules 0 --processes 0",
    "replay 0.mcap --modules 0 --rule random --processes 0",
    "shorten 0.mcap",
    "log export 0.mcap -o moves.csv",
    "view 0.mcap -o run.html",
    "log filter 0.mcap -o part.mcap",
    "log split 1.mcap --parts 2 -o parts",
    "sweep study.toml -o study --jobs 1",
    "sweep study.toml --dry-run",
    "run --schedule 0.mcap --processes 0",
    "run --from free-0.mcap --log more.mcap",
    "verify branch.mcap repaired.mcap",
    "diff 0.mcap branch.mcap",
    "run --from branch.mcap --rule random --round 3 --modules 0 --processes 0",
    "run --schedule repaired.mcap --processes 0",
    "run named.toml --processes 0 --max-rounds 2",
    "complex named.toml --max-states 50",
    "view named.mcap -o named.html",
    "verify named.proof",
    "verify named.proof --of named.mcap",
    "verify cubes.certificate.json --of named.mcap",
    "verify cubes.jsonl --of named.mcap",
    "shorten pickled.npz --system named.toml",
    "shorten pickled.npz --convert -o moves.jsonl",
    "view pickled.npz --system hex:n=3 -o pickled.html",
    "verify pickled.npz",
    "report swept -o told",
    "sweep hex:n=3 --rule random --seeds 2 --max-rounds 2 -o swept --jobs 1",
    "sweep study.toml -o swept --jobs 1",
    "verify swept/recordings",
    "log export 0.mcap --format moves -o exported.jsonl",
    "log merge halves/branch-000.mcap halves/branch-001.mcap -o merged.mcap",
    "simulate --system named.toml --seeds 1 --out simulated",
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


def test_the_fixtures_of_the_plugin_run_no_file_that_a_log_names(canary: Path) -> None:
    """Neither what checks a log, nor what lets modules live in it."""
    for name in ("0.mcap", "branch.mcap", "free-0.mcap"):
        log = RunLog.read(name)
        log.assert_legal()
        with contextlib.suppress(AssertionError):
            log.assert_same_run(RunLog.read("free-1.mcap" if "free" in name else "1.mcap"))
        for go_on in (
            lambda log=log: replay_live(log.recording, [0], processes=0),
            lambda log=log: what_if(log.recording, "random", from_round=2, modules=[0]),
        ):
            with contextlib.suppress(InputError, CheckError):
                go_on()
    assert not canary.exists()


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        "sweep hex:n=3 --rule random --core simulated --seeds 2 --max-rounds 1 --jobs 2 -o out",
        "run hex:n=2 --max-rounds 1 --processes 1 --log run.mcap",
        "rule check random hex:n=2",
    ],
)
def test_no_process_runs_what_is_in_the_current_folder(tmp_path: Path, command: str) -> None:
    """Whatever it is called: Python would find it before its own modules."""
    for name in ("multiprocessing", "socket", "msgspec", "numpy", "cubepath"):
        (tmp_path / f"{name}.py").write_text(CANARY)
    code = "import sys; from cubepath.coordinator.commands.entry import entry; sys.exit(entry())"
    done = subprocess.run(
        [sys.executable, "-P", "-c", code, *command.split()],
        cwd=tmp_path,
        env={each: told for each, told in os.environ.items() if each != "PYTHONSAFEPATH"},
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "ran").exists()


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


@pytest.mark.parametrize(
    ("command", "line"),
    [
        ("verify 0.mcap --rule nosuch.py:MINE", "nosuch.py: no such file, expected FILE.py:NAME"),
        ("verify 0.mcap --rule random", "rule 'random': expected FILE.py:NAME of a rule in a file"),
        ("verify 0.mcap --rule canary.py:YOURS", "no recording names a rule YOURS in a file"),
        ("verify named.mcap --rule canary.py:MINE", "--rule canary.py:MINE: no recording names a"),
        ("log recover named.mcap --rule canary.py:MINE -o new.mcap", "no recording names a rule"),
        ("verify parts-of --rule canary.py:MINE", "--rule canary.py:MINE: no recording names a"),
    ],
)
@pytest.mark.usefixtures("canary")
def test_a_file_that_is_given_for_nothing_is_refused(command: str, line: str) -> None:
    """It is not there, or no recording names it; and it did not run."""
    Path("parts-of").mkdir(exist_ok=True)
    shutil.copy("named.mcap", "parts-of")
    with contextlib.redirect_stdout(io.StringIO()):
        assert line in refused(*command.split())
    assert not Path("ran").exists()
    assert not Path("new.mcap").exists()


def test_only_what_can_be_required_is_taken() -> None:
    """A check by its name, of a recording."""
    log = str(GOLDEN / "hex-5.mcap")
    assert "--require choses: no such check" in refused("verify", log, "--require", "choses")
    assert "unknown option --require" in refused("diff", log, log, "--same", "--require", "choices")
