"""The systems of the page on files load, and what it says of its moves is so."""

import json
from pathlib import Path

import pytest

from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.protocol.core.actions import apply
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_from_toml, scene_to_toml
from cubepath.protocol.systems.lattice import LatticeSystem
from pasted import blocks

PAGE = Path(__file__).parent.parent / "docs" / "files.md"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Go to a folder that holds the files of the page."""
    for block in blocks(PAGE):
        if block.name and not block.name.startswith("->"):
            (tmp_path / block.name).write_text(block.text, "utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


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


def test_a_line_of_the_same_contents_goes_back(folder: Path) -> None:
    """The id is a label: the first move of the page again, under another one, undoes it."""
    first = json.loads((folder / "planned.jsonl").read_text().splitlines()[0])
    path = folder / "back.jsonl"
    path.write_text("\n".join(json.dumps(first | {"id": label}) for label in (1, 4)))
    assert shorten(path).cubes == 0
