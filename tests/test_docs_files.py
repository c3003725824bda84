"""The page on files is true: its files load, its commands run and give what stands there."""

from __future__ import annotations

import json
import re
import runpy
import shlex
from dataclasses import dataclass
from pathlib import Path

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.protocol.core.actions import apply
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.path_files.moves import write_cubes
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_from_toml, scene_to_toml
from cubepath.protocol.systems.lattice import LatticeSystem

PAGE = Path(__file__).parent.parent / "docs" / "files.md"


@dataclass(frozen=True)
class Block:
    """A code block: its language, the file it is (or, after an arrow, is expected), its text."""

    language: str
    name: str
    text: str


def blocks() -> list[Block]:
    found = re.findall(r"^```(\w+) ?(.*)\n((?:.*\n)*?)```$", PAGE.read_text("utf-8"), re.MULTILINE)
    return [Block(*parts) for parts in found]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Go to a folder that holds the files of the page."""
    for block in blocks():
        if block.name and not block.name.startswith("->"):
            (tmp_path / block.name).write_text(block.text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_commands_of_the_page_give_what_it_says(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every command ends well, and what follows an arrow is its output or the file it wrote."""
    expected = 0
    for block in blocks():
        if block.language == "sh":
            for line in block.text.splitlines():
                program, *arguments = shlex.split(line, comments=True)
                capsys.readouterr()
                assert program == "cubepath"
                assert main(arguments) == 0
        elif block.name == "->":
            found, told = json.loads(capsys.readouterr().out), json.loads(block.text)
            assert {**found, "seconds": 0} == {**told, "seconds": 0}
            expected += 1
        elif block.name.startswith("-> "):
            assert (folder / block.name.removeprefix("-> ")).read_text() == block.text
            expected += 1
    assert expected == 9


def test_python_of_the_page_runs(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The Python block does what it is there for."""
    found = shorten(folder / "crossing.jsonl", system="agv:graph=grid3x2,n=2")
    write_cubes(folder / "cubes.jsonl", found.named)
    code = [block.text for block in blocks() if block.language == "python"]
    assert len(code) == 1
    (folder / "page.py").write_text(code[0])
    runpy.run_path("page.py")
    assert capsys.readouterr().out.endswith("\n[1, 2]\n")


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("spec", "modules"),
    [
        ("crawl.toml", 2),
        ("yard.toml", 2),
        ("kiln.toml", 2),
        ("house.toml", 2),
        ("triangulation:points=site.txt", 2),
        ("triangulation:points=challenge.json", 2),
        ("agv:scene=room.json", 2),
        ("agv-labelled:scene=room.json", 2),
        ("agv:graph=yard.txt,n=3", 3),
        ("agv:graph=room.map,n=4", 4),
    ],
)
def test_systems_of_the_page_load(spec: str, modules: int) -> None:
    """Each is a scene with a move to make, and comes back the same from its own TOML."""
    scene = scene_from_spec(spec)
    assert len(scene.start) == modules
    assert scene.goal is not None
    moves = [
        move.action for site in scene.start for move in scene.system.moves(site) if move is not None
    ]
    assert moves
    again = scene_from_toml(scene_to_toml(scene), spec)
    assert scene_to_toml(again) == scene_to_toml(scene)


@pytest.mark.usefixtures("folder")
def test_the_crawling_modules_get_to_their_goal() -> None:
    """The lattice of the page does what it is said to do: both modules crawl along the floor."""
    scene = scene_from_spec("crawl.toml")
    assert isinstance(scene.system, LatticeSystem)
    state = scene.start_state
    for x in (2, 3, 4, 0, 1, 2):
        state = apply(scene.system.action("crawl", (x, 1)), state)
    assert scene.reached(state - scene.system.filled)


def test_the_refusal_of_the_page_is_the_one_that_comes(folder: Path) -> None:
    """A further line that starts from an empty dock is refused in these words."""
    words = [line.strip() for line in PAGE.read_text("utf-8").splitlines() if "jsonl:4: " in line]
    assert len(words) == 1
    path = folder / "planned.jsonl"
    both = ["dock", "gate"]
    line = {"id": 4, "support": both, "trace": both, "before": both[:1], "after": both[1:]}
    path.write_text(path.read_text() + json.dumps(line) + "\n")
    with pytest.raises(InputError, match=re.escape(words[0])):
        shorten(path)
    line = {**line, "support": ["dock", "lane"], "trace": ["dock", "lane"], "after": ["lane"]}
    path.write_text("\n".join([*path.read_text().splitlines()[:1], json.dumps(line)]))
    assert shorten(path).cubes == 0
