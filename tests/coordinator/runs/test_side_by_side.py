"""A film of a run beside its schedule shows both at every step, and the time of the step."""

from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from cubepath.agents.rendering.style import DARK, GOAL, LIGHT, PAPER
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.runs.drawing import cancelled_moves
from cubepath.coordinator.runs.films import _Sides, animate_beside
from cubepath.coordinator.runs.states import snapshots
from cubepath.protocol.core.errors import InputError
from samples.random_runs import random_run


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize(("spec", "dark"), [("arm:n=5", False), ("polygon:n=6", True)])
def test_every_frame_shows_both(tmp_path: Path, spec: str, dark: bool) -> None:
    """Read back, the film has the pictures of all steps, though only what changes is stored."""
    scene, rounds, _ = random_run(spec, 8)
    cubes = normal_cube_path(chain.from_iterable(rounds))
    path, told = tmp_path / "film.gif", list[tuple[int, int]]()
    animate_beside(scene, rounds, cubes, path, dark=dark, progress=lambda *done: told.append(done))
    theme = DARK if dark else LIGHT
    run, shortest = list(snapshots(scene, rounds)), list(snapshots(scene, cubes))
    assert len(shortest) < len(run)
    screen = _Sides(scene, run, shortest, "round", theme)
    screen.chart(cancelled_moves(rounds), "as executed")
    lines = []
    with Image.open(path) as film:
        frames = [np.array(frame.convert("RGB")) for frame in ImageSequence.Iterator(film)]
    assert len(frames) == len(run)
    assert told == [(done, len(run)) for done in range(1, len(run) + 1)]
    goal = np.array(Image.new("RGB", (1, 1), theme.of(GOAL)))[0, 0]
    for number, frame in enumerate(frames):
        drawn = np.array(screen.shot(number))
        off = np.abs(frame.astype(int) - drawn).max(axis=2)
        assert (off > 24).mean() < 0.01
        below = drawn[-90:]
        found = np.flatnonzero((below == goal).all(axis=2).any(axis=0))
        lines.append(int(found.mean()))
    steps = np.diff(lines)
    assert steps.min() > 0
    assert np.ptp(steps) <= 1
    ground = np.array(Image.new("RGB", (1, 1), theme.of(PAPER)))[0, 0]
    assert np.abs(frames[0][-1, 0].astype(int) - ground).max() <= 8
    assert [text.get_text() for text in screen._captions] == [
        f"the run: round {len(run) - 1} of {len(run) - 1}",
        f"its schedule: cube {len(shortest) - 1} of {len(shortest) - 1}",
    ]


def test_what_is_no_film_is_refused(tmp_path: Path) -> None:
    """Another suffix, and a rate that no film can have, in one line and without a file."""
    scene, rounds, _ = random_run("hex:n=3", 2)
    with pytest.raises(InputError, match=r"expected a name that ends in \.gif"):
        animate_beside(scene, rounds, [], tmp_path / "film.png")
    with pytest.raises(InputError, match="frames a second"):
        animate_beside(scene, rounds, [], tmp_path / "film.gif", frames_per_second=0)
    assert not list(tmp_path.iterdir())
