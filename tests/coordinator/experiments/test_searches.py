"""What is searched for in a scene is no part of what a run in it is."""

from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.experiments.rows import FinishedRun
from cubepath.coordinator.experiments.sweeping import read_sweep, sweep
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_to_toml


@pytest.mark.few(2)
@pytest.mark.parametrize(
    "searches",
    [
        [{}, {"optimum": 20_000}],
        [{}, {"improve": 60}],
        [{"optimum": 3}, {"optimum": 20_000}, {"improve": 60}],
        [{"optimum": 20_000}, {}],
    ],
)
def test_a_later_search_is_added_to_the_rows_and_plays_nothing(
    tmp_path: Path, searches: list[dict[str, Any]]
) -> None:
    """They are then as if it had been asked for at first; each run is there once."""
    played: list[FinishedRun] = []
    together: dict[str, Any] = {}
    plan: dict[str, Any] = {"rules": ["chain", "random"], "seeds": 2, "max_rounds": 60}
    for given in searches:
        sweep("hex:n=5", out=tmp_path / "a", watch=played.extend, **plan, **given)
        together |= given
    at_once = sweep("hex:n=5", out=tmp_path / "b", **plan, **together)
    found = read_sweep(tmp_path / "a")
    assert [row | {"seconds": 0} for row in found.rows] == [
        row | {"seconds": 0} for row in at_once.rows
    ]
    assert (len(played), len(found.rows)) == (4, 4)
    assert found.rounds == at_once.rounds
    assert found.rows[0]["best_known"] is not None


def test_what_is_searched_is_the_scene_that_was_played(tmp_path: Path) -> None:
    """Not what its file held when it was read before, in the same process."""
    path, bounds = tmp_path / "scene.toml", []
    for size in (5, 6):
        path.write_text(scene_to_toml(scene_from_spec(f"hex:n={size}")))
        sweep(str(path), rules="chain", seeds=1, out=tmp_path / "out")
        bounds.append(sweep(str(path), rules="chain", seeds=1, out=tmp_path / "out", improve=9))
    assert [result.rows[0]["modules"] for result in bounds] == [5, 6]
    assert bounds[0].rows[0]["best_known"] < bounds[1].rows[0]["best_known"]
