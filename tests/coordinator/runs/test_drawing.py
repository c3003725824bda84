"""Pictures of a run follow its modules, hold all its moves, and are written whole or not at all."""

from __future__ import annotations

import os
import subprocess
import sys
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cubepath.agents.environments.world import World
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.runs import drawing as pictures
from cubepath.coordinator.runs.drawing import animate, run_picture, snapshots
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec

Rounds = list[list[Action]]


def random_run(spec: str, count: int) -> tuple[Scene, Rounds, list[tuple[Site, ...]]]:
    """Return the scene, the actions of each round, and where modules were after each."""
    scene = scene_from_spec(spec)
    world, random = World(scene, seed=2), np.random.default_rng(2)
    rounds, where = [], [tuple(world.sites)]
    for _ in range(count):
        masks = [world.observe(module)["action_mask"] for module in range(len(world.sites))]
        chosen = {
            module: int(random.choice(mask.nonzero()[0])) for module, mask in enumerate(masks)
        }
        rounds.append([move.action for move in world.step(chosen).moves.values()])
        where.append(tuple(world.sites))
    return scene, rounds, where


SPECS = ["hex:n=6", "arm:n=6", "agv:graph=grid4x4,n=5", "agv-labelled:graph=C6,n=3", "agv:graph=K5"]


@pytest.mark.parametrize("spec", [*SPECS, "sliding:p=2,q=2,n=5", "arms:n=2"])
def test_modules_are_followed(spec: str) -> None:
    """From the actions alone follows where each module is, as in the world that moved them."""
    scene, rounds, where = random_run(spec, 30)
    found = list(snapshots(scene, rounds))
    assert [snapshot.sites for snapshot in found] == where
    for before, after, snapshot in zip(where, where[1:], found[1:], strict=False):
        left = {n: site for n, site in enumerate(before) if site != after[n]}
        assert snapshot.moved == left
        assert set(snapshot.by) == set(left)


@pytest.mark.parametrize("spec", SPECS)
def test_each_module_ends_at_the_same_place_by_the_cubes(spec: str) -> None:
    """The normal cube path takes every single module where the run took it."""
    scene, rounds, where = random_run(spec, 30)
    *_, last = snapshots(scene, normal_cube_path(chain.from_iterable(rounds)))
    assert last.sites == where[-1]


def test_a_flip_of_an_arm_moves_two_segments() -> None:
    """One action, two modules, each turning in its place."""
    scene = scene_from_spec("arm:n=2")
    rotate = scene.system.action("rotate", (0, 1))
    flip = scene.system.action("flip", (0, 0))
    *_, last = snapshots(scene, [[rotate], [flip]])
    assert last.sites == ((0, 0, 0), (1, 0, 1))
    assert last.moved == {0: (0, 0, 1), 1: (0, 1, 0)}


def test_an_inadmissible_move_is_refused(tmp_path: Path) -> None:
    """The step and the site are named, and no file is left."""
    scene = scene_from_spec("agv:graph=P4,n=1")
    step = scene.system.action("edge", (1, 2))
    for path in (tmp_path / "run.png", tmp_path / "run.gif"):
        with pytest.raises(InputError, match=r"step 1: edge at .* is not admissible"):
            if path.suffix == ".gif":
                animate(scene, [[step]], path)
            else:
                run_picture(scene, [[step]], [[step]], path)
    assert not list(tmp_path.iterdir())


def test_moves_that_cancel() -> None:
    """There and back cancels, with other vehicles' moves in between; the last equal ones do."""
    scene = scene_from_spec("agv:graph=grid6x2,n=2")
    out, on, far = (
        scene.system.action("edge", at)
        for at in (((0, 0), (1, 0)), ((1, 0), (2, 0)), ((0, 1), (1, 1)))
    )
    rounds = [[out, far], [on], [on], [on]]
    cancelled = pictures._cancelled(rounds)
    assert cancelled == {(2, on), (3, on)}
    moves = sum(map(len, rounds))
    assert moves - len(cancelled) == sum(map(len, normal_cube_path(chain.from_iterable(rounds))))


@pytest.mark.parametrize("spec", SPECS)
def test_the_schedule_has_a_box_for_each_move(spec: str) -> None:
    """As executed, pale and hollow boxes together are all moves; below are those of the cubes."""
    scene, rounds, _ = random_run(spec, 30)
    run = list(snapshots(scene, rounds))
    short = list(snapshots(scene, normal_cube_path(chain.from_iterable(rounds))))
    figure = pictures._figure(scene, run, short, "", pictures._cancelled(rounds))
    found: dict[bool, set[tuple[int, int]]] = {False: set(), True: set()}
    for collection in figure.axes[-1].collections:
        for path in collection.get_paths():
            step, module = np.asarray(path.vertices)[:4].mean(axis=0)
            found[module > round(module)].add((round(step), round(module)))
    for below, snaps in ((False, run), (True, short)):
        expected = {(step, module) for step, snap in enumerate(snaps) for module in snap.moved}
        assert found[below] == expected


def test_the_numbers_of_a_run() -> None:
    """The title says what the run had and what is left, in words that agree in number."""
    scene = scene_from_spec("agv:graph=P4,n=1")
    out, on = (scene.system.action("edge", at) for at in ((0, 1), (1, 2)))
    text = pictures._counts([[out], [], [on], [on]], [(out,)])
    assert text == "4 rounds, 3 moves  \N{RIGHTWARDS ARROW}  1 cube, 1 move, largest cube 1"


def test_long_specs_are_cut() -> None:
    """The title leaves out folders, not file names."""
    spec = "agv-labelled:graph=/data/maps/random.map,scene=/data/30.json"
    assert pictures._title(spec) == "agv-labelled:graph=random.map,scene=30.json"
    assert len(pictures._title("x" * 300)) == 80


@pytest.mark.slow
@pytest.mark.parametrize(
    ("suffix", "header"), [(".png", b"\x89PNG\r\n\x1a\n"), (".svg", b"<?xml"), (".PDF", b"%PDF-")]
)
def test_files_are_what_their_suffix_says(tmp_path: Path, suffix: str, header: bytes) -> None:
    """Each kind has its header, and the same run gives the same bytes."""
    scene, rounds, _ = random_run("hex:n=4", 8)
    cubes = normal_cube_path(chain.from_iterable(rounds))
    paths = [tmp_path / f"{name}{suffix}" for name in "ab"]
    for path in paths:
        run_picture(scene, rounds, cubes, path)
    assert paths[0].read_bytes().startswith(header)
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_a_run_without_a_round_has_a_picture(tmp_path: Path) -> None:
    """The start alone is drawn."""
    path = tmp_path / "still.png"
    run_picture(scene_from_spec("arm:n=3"), [], [], path)
    with Image.open(path) as image:
        assert image.size[0] == 1350


@pytest.mark.parametrize("name", ["run.jpeg", "run", "run.gif"])
def test_unknown_suffixes_of_pictures(tmp_path: Path, name: str) -> None:
    """Another suffix is refused in one line, before anything is drawn or written."""
    with pytest.raises(InputError, match=r"ends in \.png or \.svg or \.pdf$"):
        run_picture(scene_from_spec("arm:n=2"), [], [], tmp_path / name)
    with pytest.raises(InputError, match=r"ends in \.gif$"):
        animate(scene_from_spec("arm:n=2"), [], tmp_path / "film.png")
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    """What cannot be written is refused in one line with its name."""
    scene = scene_from_spec("arm:n=2")
    path = tmp_path / "nowhere" / "run.png"
    with pytest.raises(InputError, match=r"run\.png: cannot be written: No such file"):
        run_picture(scene, [], [], path)
    with pytest.raises(InputError, match=r"run\.gif: cannot be written: No such file"):
        animate(scene, [], path.with_suffix(".gif"))


@pytest.mark.slow
def test_a_film(tmp_path: Path) -> None:
    """A frame for the start and each step; progress counts them; nothing else is left behind."""
    scene, rounds, _ = random_run("hex:n=4", 6)
    path, told = tmp_path / "film.gif", list[tuple[int, int]]()
    animate(scene, rounds, path, progress=lambda done, total: told.append((done, total)))
    assert path.read_bytes().startswith(b"GIF89a")
    with Image.open(path) as image:
        assert getattr(image, "n_frames", 1) == 7
    assert told == [(done, 7) for done in range(1, 8)]
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.slow
def test_a_film_that_is_interrupted_leaves_nothing(tmp_path: Path) -> None:
    """An interrupt in the middle leaves neither a film nor a part of one, and an old film stays."""
    scene, rounds, _ = random_run("hex:n=4", 3)
    path = tmp_path / "film.gif"
    path.write_bytes(b"old")

    def stop(done: int, total: int) -> None:
        if done == 2 < total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        animate(scene, rounds, path, progress=stop)
    assert [(found.name, found.read_bytes()) for found in tmp_path.iterdir()] == [
        ("film.gif", b"old")
    ]


@pytest.mark.slow
def test_without_a_home_nothing_is_said_but_the_answer(tmp_path: Path) -> None:
    """Where matplotlib can keep nothing, a picture is drawn all the same, and silently."""
    golden = Path(__file__).parents[3] / "logs" / "golden" / "arm-6.mcap"
    known = {"MPLCONFIGDIR", "XDG_CONFIG_HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-m", "cubepath", "view", str(golden), "-o", str(tmp_path / "arm.png")],
        env={name: text for name, text in os.environ.items() if name not in known}
        | {"HOME": os.devnull},
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "arm.png").exists()
