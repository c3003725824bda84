"""What is known beyond the class of self-contained moves, and what need not be built for it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cubepath.coordinator.normal_form.admissibility import end_of
from cubepath.coordinator.normal_form.definitions import end_state
from cubepath.coordinator.search.budget import Stage
from cubepath.coordinator.shortening.normal_path import Shortened, shorten
from cubepath.coordinator.shortening.optimality import beyond
from cubepath.coordinator.shortening.tasks import task_of
from cubepath.protocol.path_files.supports import TabledActions


def rows_of_moves(folder: Path, vehicles: int, steps: int) -> Shortened:
    """Return a path in which each vehicle goes along a row of its own."""
    lines = [
        {"id": number, "support": both, "trace": both, "before": both[:1], "after": both[1:]}
        for number, both in enumerate(
            [[x, y], [x + 1, y]] for x in range(steps) for y in range(vehicles)
        )
    ]
    path = folder / "rows.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return shorten(path)


def made(found: Shortened) -> int:
    """Return how many actions were built."""
    assert isinstance(found.path.actions, TabledActions)
    return found.path.actions.made


def told(stage: Stage) -> tuple[str, int, str]:
    """Return what a stage did, but for how long it took."""
    return stage.name, stage.steps, stage.ended


@pytest.mark.parametrize(("vehicles", "most"), [(50, 0), (2, 6)])
def test_bounds_build_the_actions_that_are_met(tmp_path: Path, vehicles: int, most: int) -> None:
    """None where the search does not begin, else those that it meets; told as without arrays."""
    found = rows_of_moves(tmp_path, vehicles, 30)
    assert found.cubes == 30
    task = task_of(found)
    known = beyond(task, found, max_states=9)
    assert made(found) <= most
    plainly = beyond(task, max_states=9)
    assert [*map(told, known.spent)] == [*map(told, plainly.spent)]
    assert (known.lower_bound, known.optimal) == (plainly.lower_bound, plainly.optimal)
    assert known.cube_path == plainly.cube_path
    assert known.named == found.named
    assert plainly.named == ()


def test_where_a_path_ends_is_told_by_arrays(tmp_path: Path) -> None:
    """As by carrying out the moves one by one."""
    found = rows_of_moves(tmp_path, 3, 4)
    task = task_of(found)
    assert task.goal == end_of(found.path, task.start) == {(4, y) for y in range(3)}
    assert task.goal == end_state(task.path, task.start)
