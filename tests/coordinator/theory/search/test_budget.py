"""What a search may spend: it stops where it is due, and says what it spent where."""

import json
from itertools import count
from pathlib import Path
from random import Random
from typing import Any

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.normal_form.definitions import end_state
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.theory.optimality.optimality_report import beyond
from cubepath.coordinator.theory.optimality.tasks import PathTask
from cubepath.coordinator.theory.search.budget import Budget, SpentError
from cubepath.coordinator.theory.search.exact import optimum
from cubepath.coordinator.theory.search.lower_bounds import lower_bound, module_bound
from cubepath.coordinator.theory.search.transitions import Transitions, only_class
from cubepath.coordinator.theory.search.windows import WindowSearch
from cubepath.protocol.core.sites import in_order
from cubepath.protocol.path_files.moves import write_lines
from samples.strategies import random_walk, scene

SPEC = "agv:graph=grid6x6,n=6"
WALK = random_walk(SPEC, 200, seed=2)


def task() -> PathTask:
    where = scene(SPEC)
    return PathTask(tuple(WALK), where.start_state, where.system)


def test_steps_are_counted_and_no_more_are_given() -> None:
    """The step that is one too many raises; who watches is told on the way."""
    told: list[int] = []
    budget = Budget(steps=1000, tick=told.append)
    budget.spend(600)
    budget.spend(400)
    assert not budget.spent
    with pytest.raises(SpentError):
        budget.spend()
    assert told == [600, 1000]
    assert (budget.steps, budget.spent, budget.seconds_left) == (1001, True, None)


def test_the_time_is_over_when_the_clock_says_so() -> None:
    """Seconds count from the start of the budget; without a bound nothing ends."""
    ticks = count(100)
    budget = Budget(3.0, clock=lambda: float(next(ticks)))  # 100: until 103
    budget.spend()  # 101
    assert budget.seconds_left == 1.0  # 102
    with pytest.raises(SpentError):
        budget.spend()  # 103
    assert budget.seconds_left == 0.0
    endless = Budget()
    endless.spend(10**12)
    assert not endless.spent


def test_an_exhaustive_search_stops_within_its_steps() -> None:
    """What it has shown by then holds, and it is less than what more steps show."""
    where = scene(SPEC)
    end = end_state(WALK, where.start_state)
    found = []
    for most in (10, 2_000):
        steps = Transitions(where.system)
        ends = steps.encode(where.start_state), steps.encode(end)
        steps.budget = Budget(steps=most)
        found.append(optimum(steps, *ends))
        assert steps.budget.steps == most + 1
        assert found[-1].states <= most + 2
    assert found[0].at_least < found[1].at_least
    assert [each.cubes for each in found] == [None, None]


def test_a_window_that_is_given_up_leaves_the_path_as_it_was() -> None:
    """Whenever the budget ends, the path is legal and no worse."""
    where = scene(SPEC)
    start = where.start_state
    cubes = normal_cube_path(WALK)
    for most in (1, 30, 300, 3000):
        steps = Transitions(where.system)
        windows = WindowSearch(steps, start, cubes)
        known, random = windows.cost, Random(1)  # noqa: S311 - nothing secret
        steps.budget = Budget(steps=most)
        with pytest.raises(SpentError):
            while True:
                windows.step(random)
        assert windows.cost <= known
        assert end_state(windows.actions(), start) == end_state(WALK, start)
        assert steps.budget.steps < most + 100


def test_a_bound_that_takes_too_long_is_left_out() -> None:
    """The others hold without it."""
    where = scene(SPEC)
    start, end = where.start_state, end_state(WALK, where.start_state)
    with pytest.raises(SpentError):
        module_bound(where.system, start, end, within=99, budget=Budget(steps=3))
    assert module_bound(where.system, start, end, within=99) > 1
    found = lower_bound(where.system, start, end, within=99, budget=Budget(steps=3))
    assert found.cubes == 1
    assert found.why != "way of a module"


def test_a_complex_is_not_explored_beyond_the_budget() -> None:
    """Whether there is but one class is then not known; with more steps it is."""
    where = scene("agv:graph=C5,n=1")
    steps = Transitions(where.system, budget=Budget(steps=3))
    assert only_class(steps, where.start_state) is None
    steps.budget = Budget()
    assert only_class(steps, where.start_state) is False


def test_every_stage_is_told_with_what_ended_it() -> None:
    """Bounded by steps, the stages and what each spent are the same every time."""
    told: list[str] = []

    def tick(stage: str, _steps: int) -> None:
        if stage not in told:
            told.append(stage)

    found = [
        beyond(task(), iterations=20, max_states=500, seed=3, tick=tick).spent for _ in range(2)
    ]
    stages = [(stage.name, stage.steps, stage.ended) for stage in found[0]]
    assert stages == [(stage.name, stage.steps, stage.ended) for stage in found[1]]
    names = [name for name, _, _ in stages]
    assert list(dict.fromkeys(names)) == told
    compiling, searching = ("compile", 0, "done"), ("search", 20, "limit")
    assert stages[2] == stages[5] == compiling
    assert stages[-1] == searching
    assert names == ["classes", "bounds", "compile", "windows", "optimum", "compile", "search"]
    assert [ended for _, _, ended in stages[:5]] == ["done", "done", "done", "done", "limit"]


def test_without_time_every_stage_ends_at_once() -> None:
    """The path is what it was; no stage went further than a few steps."""
    found = beyond(task(), seconds=0.0)
    assert found.cube_path == normal_cube_path(WALK)
    assert found.improved == len(found.cube_path)
    assert sum(stage.steps for stage in found.spent) < 10
    ended = {stage.name: stage.ended for stage in found.spent}
    assert ended.pop("compile") == "done"
    assert ended.pop("solver") == "done"  # of nothing: it was not asked
    assert set(ended.values()) == {"time"}


@pytest.mark.parametrize("when", ["classes", "bounds", "optimum"])
def test_an_interrupt_ends_the_search_and_keeps_what_is_known(when: str) -> None:
    """The stages after it are left out; what came before is told."""

    def interrupt(stage: str, _steps: int) -> None:
        if stage == when:
            raise KeyboardInterrupt

    found = beyond(task(), iterations=5, tick=interrupt)
    assert found.spent[-1].name == when
    assert found.spent[-1].ended == "interrupt"
    assert found.cube_path == normal_cube_path(WALK)


def shortened(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, Any, str]:
    code = main(["improve", *map(str, arguments)])
    told = capsys.readouterr()
    return code, told.out, told.err


def test_effort_counts_steps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One result whatever the machine; it is refused beside a time."""
    path = tmp_path / "moves.jsonl"
    state, lines = scene(SPEC).start_state, []
    for action in WALK:
        edge = list(in_order(action.trace))
        before, state = state & action.trace, state ^ action.trace
        ends = {"before": list(before), "after": list(state & action.trace)}
        lines.append({"id": str(edge), "support": edge, "trace": edge, **ends})
    write_lines(path, lines)
    documents = []
    for _ in range(2):
        code, out, error = shortened(capsys, path, "--steps", 15, "--max-states", 9, "--json")
        assert (code, error) == (0, "")
        document = json.loads(out)
        for stage in document["spent"]:
            del stage["seconds"]
        del document["seconds"]
        documents.append(document)
    assert documents[0] == documents[1]
    assert documents[0]["spent"][-1] == {"stage": "search", "steps": 15, "ended": "limit"}
    assert documents[0]["improved"] <= documents[0]["cubes"]
    _, out, _ = shortened(capsys, path, "--steps", 3, "--max-states", 9)
    assert "search" in out.partition("spent on")[2]
    assert "3 attempts, at its limit" in out
    code, _, error = shortened(capsys, path, "--steps", 3, "--seconds", 1)
    assert (code, error.count("\n")) == (2, 1)
    assert "--seconds and --steps" in error
