"""No input leads a command out of its own folder: not by a path in it, not by a link beside it."""

import contextlib
import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import pytest

from cubepath.coordinator import Recorder, run, start
from cubepath.coordinator.commands.main import main
from cubepath.coordinator.experiments.spec import read_sweep_file
from cubepath.coordinator.verification.recovery import with_told_scene
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.remains import remains_of
from cubepath.protocol.scenes.toml import scene_to_toml
from processes.audited import carried_out
from processes.command_line import GOLDEN, refused
from samples.strategies import scene

SCENARIO = {"grid": [3, 2], "starts": [[0, 0]], "goals": [[2, 0]]}
Plant: TypeAlias = Callable[[Path, Path], object]
"""What somebody puts into a folder that you are given, beside one that is yours alone."""


@pytest.fixture
def given(tmp_path: Path) -> Path:
    """Return a folder that you are given, `given`, and make `mine`, which no input may touch."""
    for name in ("given", "mine"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "hex.toml").write_text(scene_to_toml(scene("hex:n=3")))
        (folder / "scene.json").write_text(json.dumps(SCENARIO))
        (folder / "points.txt").write_text("0 0\n3 0\n0 3\n4 4\n")
        shutil.copy(GOLDEN / "hex-5.mcap", folder / "run.mcap")
    (tmp_path / "given" / "link.toml").symlink_to("../mine/hex.toml")
    (tmp_path / "given" / "all").symlink_to("../mine")
    (tmp_path / "given" / "maps").mkdir()
    shutil.copy(tmp_path / "given" / "scene.json", tmp_path / "given" / "maps")
    return tmp_path / "given"


@pytest.mark.parametrize(
    "systems",
    [
        '"../mine/hex.toml"',
        '"{mine}/hex.toml"',
        '"link.toml"',
        '"all/hex.toml"',
        '"maps/../../mine/hex.toml"',
        '["hex.toml", "../mine/hex.toml"]',
        '"agv:scene=../mine/scene.json"',
        '"agv:n=1,graph=K5,{mine}/scene.json"',
        '{{name = "agv-labelled", scene = "all/scene.json"}}',
        '"triangulation:points=../mine/points.txt"',
        '"triangulation:points=points\\u0000.txt"',
    ],
)
@pytest.mark.usefixtures("given")
def test_a_sweep_names_files_in_its_own_folder_alone(given: Path, systems: str) -> None:
    """Neither an absolute path nor .. nor a link leads out of it."""
    study = given / "study.toml"
    study.write_text(f"systems = {systems.format(mine=given.parent / 'mine')}\n")
    line = refused("sweep", str(study), "--dry-run")
    assert line.startswith(f"cubepath: {study}: ")
    assert f"leads out of {given}, expected a path in that folder" in line


def test_files_in_the_folder_of_a_sweep_are_found_from_everywhere(given: Path) -> None:
    """Also those that are values of keys, and below it."""
    study = given / "study.toml"
    study.write_text(
        'systems = ["hex.toml", "maps/../hex.toml", "agv:scene=maps/scene.json,n=1",'
        ' "agv:graph=K5,scene.json,n=1..2", "hex:n=2..3", "standard"]\n'
    )
    assert read_sweep_file(study).systems == (
        f"{given}/hex.toml",
        f"{given}/maps/../hex.toml",
        f"agv:scene={given}/maps/scene.json,n=1",
        "agv:graph=K5,n=1",
        "agv:graph=K5,n=2",
        f"agv:graph={given}/scene.json,n=1",
        f"agv:graph={given}/scene.json,n=2",
        "hex:n=2..3",
        "standard",
    )
    study.write_text('systems = ["hex.toml", "agv:scene=maps/scene.json"]\nseeds = 1\n')
    assert main(["sweep", str(study), "--dry-run"]) == 0


@pytest.mark.parametrize("command", ["verify", "log info"])
def test_a_link_among_recordings_is_not_followed_out_of_their_folder(
    given: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is refused by its name, and the others are read."""
    (given / "link.mcap").symlink_to("../mine/run.mcap")
    (given / "again.mcap").symlink_to("run.mcap")
    assert main([*command.split(), str(given), "--json"]) == 2
    found = json.loads(capsys.readouterr().out)
    assert ["unreadable" in each for each in found] == [False, True, False]
    assert found[1]["unreadable"].startswith(f"{given}/link.mcap: leads out of {given}")
    assert main([*command.split(), str(given / "link.mcap")]) == 0


def _linked(name: str) -> Plant:
    """Put a link of that name to what has the same name in `mine`."""

    def plant(folder: Path, mine: Path) -> None:
        there = folder / name
        if there.is_dir():
            shutil.move(there, mine / there.name)
        elif there.exists():
            there.rename(mine / there.name)
        there.symlink_to(mine / there.name)

    return plant


def _first_part(what: str) -> Plant:
    def plant(folder: Path, mine: Path) -> None:
        part = next((folder / what).glob("*.parquet"))
        _linked(f"{what}/{part.name}")(folder, mine)

    return plant


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plant", "command"),
    [
        (_linked("runs"), "report swept"),
        (_linked("sweep.json"), "report swept"),
        (_linked("report"), "report swept"),
        (_first_part("runs"), "report swept"),
        (_first_part("rounds"), "report swept"),
        (_linked("report.html"), "report swept -o swept"),
        (_linked("runs"), "sweep hex:n=2 -o swept"),
        (_linked("rounds"), "sweep hex:n=2 -o swept"),
        (_linked("sweep.json"), "sweep hex:n=2 -o swept"),
        (_first_part("rounds"), "sweep hex:n=2 -o swept"),
        (_linked("recordings"), "sweep hex:n=2 -o swept --log --core simulated"),
    ],
)
def test_nothing_outside_the_folder_of_a_sweep_is_read_or_written(
    given: Path, monkeypatch: pytest.MonkeyPatch, plant: Plant, command: str
) -> None:
    """Wherever a link in it leads: one line names the link."""
    monkeypatch.chdir(given)
    assert main(["sweep", "hex:n=2", "--seeds", "1", "-o", "swept"]) == 0
    mine = given.parent / "mine"
    plant(given / "swept", mine)
    before = {each: each.stat().st_mtime_ns for each in mine.rglob("*")}
    line = refused(*command.split())
    assert line.startswith("cubepath: swept/")
    assert "leads out of swept, expected a path in that folder" in line
    assert {each: each.stat().st_mtime_ns for each in mine.rglob("*")} == before


def test_the_logs_of_a_run_that_is_resumed_are_beside_it(
    given: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A link to logs elsewhere would have them continued, and cut off where they are damaged."""
    monkeypatch.chdir(given)
    run("hex:n=2", "random", clock="free", processes=1, keepers=1, max_rounds=1, log="free.mcap")
    Path("free.mcap.keepers").symlink_to("../mine")
    line = refused("run", "--from", "free.mcap", "--log", "more.mcap")
    assert line.startswith("cubepath: free.mcap.keepers: leads out of .")


def test_the_certificate_beside_cubes_is_there(
    given: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And no link to another."""
    monkeypatch.chdir(given)
    made = "shorten run.mcap -o cubes.jsonl --certificate cubes.certificate.json"
    assert main(made.split()) == 0
    _linked("cubes.certificate.json")(given, given.parent / "mine")
    line = refused("verify", "cubes.jsonl", "--of", "run.mcap")
    assert line.startswith("cubepath: cubes.certificate.json: leads out of .")


@pytest.mark.thorough
def test_a_name_in_a_recording_opens_no_file(given: Path) -> None:
    """Of the scene, or in its parameters: nothing of that name is read."""
    mine = given.parent / "mine"
    text = (given / "hex.toml").read_text()
    for name, spec in (("file", f"{mine}/hex.toml"), ("key", f"agv:scene={mine}/scene.json")):
        path = given / f"{name}.toml"
        path.write_text(text.replace('"hex:n=3"', json.dumps(spec)))
        run(str(path), "random", processes=0, max_rounds=3, log=given / f"{name}.mcap")
        path.unlink()
    (given / "moves.jsonl").write_text('{"generator": "pivot-1-right", "at": [0, 0]}\n')
    commands = [
        command.split()
        for name in ("given/file.mcap", "given/key.mcap")
        for command in (
            f"diff {name} given/moves.jsonl",
            f"diff {name} given/run.mcap",
            f"log info {name}",
            f"verify {name}",
            f"view {name} -o {name}.html",
            f"shorten {name}",
            f"run --from {name} --rule random --round 2 --processes 0",
            f"run --schedule {name} --processes 0",
        )
    ]
    found = carried_out(given.parent, commands)
    for command, carried in zip(commands, found, strict=True):
        assert carried.code in (0, 1), command
        assert not [each for each in carried.opened if each.startswith("mine")], command
    (mine / "hex.toml").write_text(scene_to_toml(scene("hex:n=4")))
    lost = replace(remains_of(given / "file.mcap"), stored_scene=None)
    assert with_told_scene(lost, scene("hex:n=3")).stored_scene == scene("hex:n=3")


@pytest.mark.slow
def test_a_run_does_not_choose_where_it_is_recorded(
    given: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The name of its family is a part of the name, and no path."""
    monkeypatch.chdir(given)
    text = Path("hex.toml").read_text()
    Path("odd.toml").write_text(text.replace('family = "hex"', 'family = "../../mine/x"'))
    with (
        start("odd.toml", "random", processes=1, max_rounds=2, log="odd.mcap") as running,
        Recorder(running.endpoint) as recorder,
    ):
        running.play()
        recorder.wait(20)
    (path,) = recorder.logs
    assert os.fspath(path).startswith("logs/mine-x-attached-")
    with contextlib.suppress(InputError):
        run("odd.toml", "random", processes=0, max_rounds=1)
    assert not list((given.parent / "mine").glob("x*"))
