"""Films have a frame a step, and are written whole or not at all."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageSequence

from cubepath.agents.rendering.style import palette
from cubepath.coordinator.runs.films import animate
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from samples.random_runs import random_run
from samples.rolling import rolling_cubes


def frames_of(path: Path) -> list[tuple[NDArray[np.uint8], int]]:
    """Return the pixels of each frame, and how long it lasts in hundredths of a second."""
    with Image.open(path) as image:
        return [
            (np.array(frame.convert("RGB")), round(frame.info["duration"] / 10))
            for frame in ImageSequence.Iterator(image)
        ]


@pytest.mark.slow
def test_a_film(tmp_path: Path) -> None:
    """A frame for the start and each step; progress counts them; nothing else is left behind."""
    scene, rounds, _ = random_run("words", 6)
    path, told = tmp_path / "film.gif", list[tuple[int, int]]()
    animate(scene, rounds, path, progress=lambda done, total: told.append((done, total)))
    assert path.read_bytes().startswith(b"GIF89a")
    assert len(frames_of(path)) == 7
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


@pytest.mark.few(2)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate", "lasting"),
    [
        (4, [25, 25, 25, 25, 25]),
        (30, [3, 4, 3, 3, 4]),
        (50, [2, 2, 2, 2, 2]),
        (0.5, [200, 200, 200, 200, 200]),
    ],
)
def test_frames_last_as_long_as_asked_for(tmp_path: Path, rate: float, lasting: list[int]) -> None:
    """In whole hundredths of a second that add up; the end stays for a second and a half more."""
    scene, rounds, _ = random_run("words", 4)
    path = tmp_path / "film.gif"
    animate(scene, rounds, path, frames_per_second=rate)
    assert [time for _, time in frames_of(path)] == [*lasting[:-1], lasting[-1] + 150]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "move", "rate", "lasting"),
    [
        (rolling_cubes(), ("along", (0, 0, 1)), 4, [6, 6, 7, 6, 175]),
        (rolling_cubes(), ("along", (0, 0, 1)), 50, [2, 152]),
        (scene_from_spec("sliding-cubes:n=2"), ("corner-6", (1, 0, 1)), 4, [6, 6, 7, 6, 175]),
        (scene_from_spec("agv:graph=P2,n=1"), ("edge", (0, 1)), 4, [6, 6, 7, 6, 175]),
    ],
    ids=["turns", "fast", "slides", "drives"],
)
def test_a_module_is_seen_on_its_way(
    tmp_path: Path, scene: Scene, move: tuple[str, Site], rate: float, lasting: list[int]
) -> None:
    """Three times, in the time of its step; not if a film would be too fast."""
    path = tmp_path / "film.gif"
    animate(scene, [[scene.system.action(*move)]], path, frames_per_second=rate)
    frames = frames_of(path)
    assert [time for _, time in frames] == lasting
    shots = [pixels[40:, :] for pixels, _ in frames]
    assert all((one != other).any() for one, other in pairwise(shots))


@pytest.mark.parametrize("rate", [0, -1, 50.5, 0.001, float("inf"), float("nan")])
def test_rates_that_no_film_can_have(tmp_path: Path, rate: float) -> None:
    """They are refused in one line, before anything is drawn."""
    scene, rounds, _ = random_run("hex:n=3", 1)
    with pytest.raises(InputError, match=r"frames a second: expected 0\.01 to 50, as GIF"):
        animate(scene, rounds, tmp_path / "film.gif", frames_per_second=rate)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.thorough
@pytest.mark.parametrize("spec", ["hex:n=30,bend=0", "agv:graph=grid20x20,n=27"])
def test_modules_have_their_colours_in_every_frame(tmp_path: Path, spec: str) -> None:
    """Neither the number of colours of a film nor what else is in a frame changes them."""
    scene, rounds, _ = random_run(spec, 3)
    path = tmp_path / "film.gif"
    animate(scene, rounds, path)
    own = np.array([[round(255 * part) for part in colour] for colour in palette(27)])
    for pixels, _ in frames_of(path):
        flat = np.unique(pixels.reshape(-1, 3), axis=0).astype(int)
        nearest = np.abs(flat[None] - own[:, None]).max(axis=2).min(axis=1)
        assert nearest.max() <= 4


@pytest.mark.slow
def test_a_film_does_not_jump(tmp_path: Path) -> None:
    """Where no module is or goes, every frame has the same pixels under the caption."""
    scene = scene_from_spec("agv:graph=grid30x30,n=1")
    steps = [[scene.system.action("edge", ((x, 0), (x + 1, 0)))] for x in range(4)]
    path = tmp_path / "film.gif"
    animate(replace(scene, goal=None, goals=()), steps, path)
    shots = [pixels[40:] for pixels, _ in frames_of(path)]
    changed = np.any([(shot != shots[0]).any(axis=2) for shot in shots], axis=0)
    rows = np.flatnonzero(changed.any(axis=1))
    assert len(rows) > 0
    assert np.ptp(rows) < 0.6 * changed.shape[0]
    assert not changed[rows.max() + 1 :].any()
