"""Films have a frame a step, and are written whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from cubepath.coordinator.runs.films import animate
from random_runs import random_run


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
