"""What is searched for in a scene, before or after runs in it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cubepath.coordinator.experiments.sweeping import read_sweep, sweep
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_to_toml


def test_what_is_searched_is_the_scene_that_was_played(tmp_path: Path) -> None:
    """Not what its file held when it was read before, in the same process."""
    path, bounds = tmp_path / "scene.toml", []
    for size in (5, 6):
        path.write_text(scene_to_toml(scene_from_spec(f"hex:n={size}")))
        sweep(str(path), rules="chain", seeds=1, out=tmp_path / "out")
        bounds.append(sweep(str(path), rules="chain", seeds=1, out=tmp_path / "out", improve=9))
    assert [result.rows[0]["modules"] for result in bounds] == [5, 6]
    assert bounds[0].rows[0]["best_known"] < bounds[1].rows[0]["best_known"]


def test_a_later_search_plays_the_runs_again(tmp_path: Path) -> None:
    """A report has each of them once, with what was searched for most."""
    plan: dict[str, Any] = {
        "rules": ["chain", "random"],
        "seeds": 2,
        "max_rounds": 60,
        "out": tmp_path,
    }
    sweep("hex:n=5", **plan)
    again = sweep("hex:n=5", optimum=20_000, **plan)
    sweep("hex:n=5", **plan)
    assert again.known == 0
    assert again.rows[0]["best_known"] is not None
    assert read_sweep(tmp_path).rows == again.rows
