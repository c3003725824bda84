"""What is known beyond the class of self-contained moves, and what need not be built for it."""

import json
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.normal_form.admissibility import end_of
from cubepath.coordinator.normal_form.definitions import end_state
from cubepath.coordinator.shortening.normal_path import Shortened, shorten
from cubepath.coordinator.theory.optimality import stages
from cubepath.coordinator.theory.optimality.optimality_report import beyond
from cubepath.coordinator.theory.optimality.tasks import task_of
from cubepath.coordinator.theory.search.budget import Budget, SearchStage, SpentError
from cubepath.coordinator.theory.search.transitions import Transitions
from cubepath.coordinator.theory.search.windows import WindowSearch
from cubepath.protocol.core.actions import Action
from cubepath.protocol.path_files.supports import TabledActions
from processes.command_line import ROOT


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


def told(stage: SearchStage) -> tuple[str, int, str]:
    """Return what a stage did, but for how long it took."""
    return stage.name, stage.steps, stage.ended


@pytest.mark.parametrize("most", [20_000, 50])
def test_bounds_are_told_as_without_arrays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    """Where there are too many moves to search among, none is built."""
    monkeypatch.setattr(stages, "_LISTED_MAX", most)
    found = rows_of_moves(tmp_path, 2, 30)
    assert found.cubes == 30
    task = task_of(found)
    known = beyond(task, found, max_states=9)
    assert (made(found) == 0) == (most < 60)
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


def seconds_given(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Return a list that will hold the seconds of each budget that has some."""
    given: list[float] = []

    class Noted(Budget):
        def __init__(self, seconds: float | None = None, **options: Any) -> None:
            super().__init__(seconds, **options)
            if seconds is not None:
                given.append(seconds)

    monkeypatch.setattr(stages, "Budget", Noted)
    return given


def test_time_for_a_proof_goes_to_other_stages_where_there_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A small share of it otherwise; and no more stages begin once the bound is met."""
    found = rows_of_moves(tmp_path, 3, 1)
    given = seconds_given(monkeypatch)
    known = beyond(task_of(found), found, prove=1000.0)
    assert [stage.name for stage in known.spent] == ["bounds"]
    assert given[:2] == [1000.0, 150.0]
    given.clear()
    monkeypatch.setattr(stages, "_LISTED_MAX", 2)
    known = beyond(task_of(found), found, prove=1000.0)
    assert known.optimal
    assert given[:2] == [1000.0, 1000.0]


@pytest.mark.thorough
def test_a_proof_gets_the_time_that_other_stages_leave(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """These are done at once here, and leave it more than their share of 150 seconds is."""
    found = shorten(ROOT / "tests" / "data" / "agv" / "grid8-12agents.json")
    given = seconds_given(monkeypatch)
    known = beyond(task_of(found), found, prove=1000.0, proof=tmp_path / "grid8.proof")
    assert known.optimal
    assert known.spent[-1].name == "proof"
    assert 850.0 < given[-1] <= 1000.0


def row_of(action: Action) -> Any:
    """Return the row in which a vehicle goes."""
    (row,) = {site[1] for site in action.support if isinstance(site, tuple)}
    return row


def test_a_budget_ends_the_choice_of_a_window(tmp_path: Path) -> None:
    """Moves that wait for each other are taken together, in as few passes as they have turns."""
    found = rows_of_moves(tmp_path, 2, 40)
    steps = Transitions(None, found.path.actions)
    cubes = found.cube_path
    windows = WindowSearch(steps, task_of(found).start, cubes)
    window = [steps.number(action) for cube in cubes for action in cube]
    steps.budget = Budget(steps=4)

    class First:
        def choice(self, options: list[int]) -> int:
            return options[40]

        def random(self) -> float:
            return 1.0

    begin = steps.encode(task_of(found).start)
    chosen, rest, still = windows._component(First(), window, begin)  # type: ignore[arg-type]
    rows = {number: row_of(steps.actions[number]) for number in window}
    row = rows[window[40]]
    assert chosen == [number for number in window if rows[number] == row]
    assert sorted(chosen + rest) == sorted(window)
    assert still == steps.encode([(0, 1 - row)])
    steps.budget = Budget(steps=2)
    with pytest.raises(SpentError):
        windows._component(First(), window, begin)  # type: ignore[arg-type]
