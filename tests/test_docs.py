"""The examples in the README and the docs run, and the commands that they name exist."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from cubepath.agents import RuleType, parallel_env
from cubepath.agents.environments.rollout import play
from cubepath.coordinator.commands.main import main
from cubepath.protocol.scenes.registry import all_families
from cubepath.protocol.scenes.specs import scene_from_spec

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(page: Path, language: str) -> list[str]:
    """Return the code blocks of a page in one language."""
    return [text for found, text in BLOCK.findall(page.read_text()) if found == language]


PYTHON = [
    pytest.param(block, id=f"{page.stem}-{number}")
    for page in PAGES
    if page.stem != "files"  # it has its own test, with the files that it talks of
    for number, block in enumerate(blocks(page, "python"))
]


@pytest.mark.parametrize("block", PYTHON)
def test_python_examples_run(block: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each Python block runs as it stands; a rule that it defines plays in the environment."""
    monkeypatch.chdir(ROOT)
    names: dict[str, object] = {}
    exec(compile(block, "example", "exec"), names)  # noqa: S102 - our own documentation
    for rule in [value for value in names.values() if isinstance(value, RuleType)]:
        assert play(scene_from_spec("hex:n=4"), rule, max_rounds=5).rounds


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_toml_examples_are_toml(page: Path) -> None:
    """Each TOML block is TOML."""
    for block in blocks(page, "toml"):
        assert tomllib.loads(block)


def test_links_lead_somewhere() -> None:
    """Every relative link and picture is a file of the repository."""
    for page in PAGES:
        for target in re.findall(r"\]\((?!http)([^)#]+)", page.read_text()):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_what_contributors_are_sent_to_is_there() -> None:
    """Every file and folder that CONTRIBUTING and the page of the architecture name exists."""
    large = [ROOT / room / "cubepath" for room in ("protocol", "agents", "coordinator")]
    rooms = [room for top in large for room in top.glob("*") if room.is_dir()]
    known = [ROOT, ROOT / "docs", *large, *rooms]
    for page in (ROOT / "CONTRIBUTING.md", ROOT / "docs" / "architecture.md"):
        named = re.findall(r"`([\w/.*-]+(?:\.py|\.toml|/[\w*-]+))`", page.read_text())
        assert len(named) > 3
        for name in named:
            assert any(list(place.glob(name)) for place in known), f"{page.name}: {name}"


def test_the_readme_names_every_system_and_command(capsys: pytest.CaptureFixture[str]) -> None:
    """The README's table has all systems, and all of its commands are there."""
    text = (ROOT / "README.md").read_text()
    assert set(all_families()) <= set(re.findall(r"^\| `([\w-]+)` \|", text, re.MULTILINE))
    for name in sorted(set(re.findall(r"^cubepath (\w+)", text, re.MULTILINE))):
        with pytest.raises(SystemExit) as stopped:
            main([name, "--help"])
        assert stopped.value.code == 0
    assert "--json" in capsys.readouterr().out


def test_the_environment_of_the_readme() -> None:
    """The constructor that the README names makes an environment."""
    assert parallel_env("hex:n=7").possible_agents[-1] == "module_6"
