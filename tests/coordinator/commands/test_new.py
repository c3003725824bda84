"""Distributions that ``cubepath new`` begins: they are whole, and hold what they are held to."""

import json
import os
import py_compile
import runpy
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from cubepath.agents import RuleType, play
from cubepath.coordinator.commands.main import main
from cubepath.protocol import Family
from processes.command_line import PYTHON


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in an empty folder."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("kind", ["rule", "system"])
def test_what_is_begun_is_whole(kind: str, tmp_path: Path) -> None:
    """Its files compile, no name is left open, and the entry point names what is there."""
    assert main([kind, "new", "Own_2"]) == 0
    folder = tmp_path / "Own_2"
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert names == {"pyproject.toml", "README.md", "Own_2.py", "tests/test_Own_2.py"}
    assert not any("$" in (folder / name).read_text() for name in names)
    for name in names:
        if name.endswith(".py"):
            py_compile.compile(str(folder / name), str(tmp_path / "compiled"), doraise=True)
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    assert project["name"] == "own-2"
    assert project["entry-points"] == {f"cubepath.{kind}s": {"Own_2": "Own_2:OWN_2"}}
    made = runpy.run_path(str(folder / "Own_2.py"))["OWN_2"]
    assert isinstance(made, RuleType if kind == "rule" else Family)
    assert made.name == "Own_2"
    assert folder.stat().st_mode & 0o777 == 0o755


def test_a_rule_that_is_begun_reaches_its_goal() -> None:
    """As it stands, for every seed."""
    assert main(["rule", "new", "mine"]) == 0
    rule = runpy.run_path("mine/mine.py")["MINE"]
    assert all(play("agv:graph=grid4x4,n=3", rule, seed=seed).reached for seed in range(5))


def test_a_system_that_is_begun_has_an_environment() -> None:
    """Its scene is played, and ends where it is to end."""
    assert main(["system", "new", "mine", "-o", "deep/down"]) == 0
    family = runpy.run_path("deep/down/mine.py")["MINE"]
    scene = family.build("mine", {key: default for key, (default, _) in family.keys.items()})
    assert play(scene, "random", seed=1).reached


def test_the_files_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    """With where they are and what they are for."""
    assert main(["rule", "new", "mine", "-o", "there", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "kind": "rule",
        "name": "mine",
        "folder": "there",
        "files": ["README.md", "mine.py", "pyproject.toml", "tests/test_mine.py"],
    }


def test_nothing_half_written_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """When the disk is full in the middle of it, the line says so and the folder is not there."""
    write, left = Path.write_text, [2]

    def full(path: Path, text: str, encoding: str) -> int:
        left[0] -= 1
        if left[0] < 0:
            raise OSError(28, "No space left on device")
        return write(path, text, encoding)

    monkeypatch.setattr(Path, "write_text", full)
    assert main(["rule", "new", "mine"]) == 1
    assert capsys.readouterr().err == "cubepath: mine: cannot be written: No space left on device\n"
    assert not list(tmp_path.iterdir())


def shell(*command: str, cwd: Path, site: Path) -> str:
    """Run a command that finds what is installed in a folder; return what it says."""
    done = subprocess.run(
        command,
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(site), "PYTEST_ADDOPTS": "-p no:cacheprovider"},
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.thorough
def test_what_is_begun_is_installed_and_passes_its_tests(tmp_path: Path) -> None:
    """Both kinds, installed into a folder of their own; then runs have them by name."""
    site = tmp_path / "site"
    for kind, name in (("rule", "led"), ("system", "hall")):
        assert main([kind, "new", name]) == 0
        install = ["install", "--quiet", "--no-deps", "--no-build-isolation", "--target", str(site)]
        shell(sys.executable, "-m", "pip", *install, f"./{name}", cwd=tmp_path, site=site)
    for name, tests in (("led", 12), ("hall", 5)):
        told = shell(sys.executable, "-m", "pytest", "-q", cwd=tmp_path / name, site=site)
        assert f"{tests} passed" in told
        for check in (["check"], ["format", "--check"]):
            shell(sys.executable, "-m", "ruff", *check, cwd=tmp_path / name, site=site)
    run = [*PYTHON, "run", "--processes", "2", "--json"]
    vehicles = ["agv:graph=grid4x4,n=3", "--rule", "led"]
    assert json.loads(shell(*run, *vehicles, cwd=tmp_path, site=site))["goal_reached"]
    assert json.loads(shell(*run, "hall:n=2", cwd=tmp_path, site=site))["rule"] == "metropolis"
    assert "led" in shell(*PYTHON, "rule", "list", cwd=tmp_path, site=site)
