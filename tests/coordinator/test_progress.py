"""Progress bars of functions: what `progress=True` counts, and that it changes no result."""

import io
from collections.abc import Sequence
from typing import Any

import pytest
import tqdm.std

from cubepath.agents.environments.rollouts import play
from cubepath.coordinator.experiments.sweeping import sweep
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.progress import StageProgress, each_of, progress_bar
from cubepath.coordinator.runs.run import run
from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.coordinator.theory.complexes.exploration import explore
from cubepath.coordinator.theory.optimality.optimality_report import beyond
from cubepath.coordinator.theory.optimality.tasks import task_of
from cubepath.coordinator.theory.search.anytime import improve
from cubepath.protocol.scenes.specs import scene_from_spec
from samples.recordings import new_path


def shown(capsys: pytest.CaptureFixture[str]) -> str:
    """Return the last state of the bar."""
    return capsys.readouterr().err.rsplit("\r", 1)[-1]


def test_a_run_counts_its_rounds(capsys: pytest.CaptureFixture[str]) -> None:
    """Beside them are its moves and cubes; a function that watches is called as ever."""
    heard: list[object] = []
    found = run("hex:n=3", processes=0, log=str(new_path()), watch=heard.append, progress=True)
    assert f"run: {found.rounds} rounds" in shown(capsys)
    assert len(heard) == found.rounds


def test_a_sweep_counts_its_runs(capsys: pytest.CaptureFixture[str]) -> None:
    """Those that were finished before count too."""
    out = new_path("")
    heard: list[int] = []
    first = sweep("hex:n=2", seeds=2, out=out, progress=True)
    assert "sweep: 100%" in shown(capsys)

    def watch(runs: Sequence[object]) -> None:
        heard.append(len(runs))

    more = sweep("hex:n=2", seeds=3, out=out, watch=watch, progress=True)
    assert "3/3" in shown(capsys)
    assert (len(first.rows), len(more.rows), sum(heard)) == (2, 3, 1)


def test_an_exploration_counts_states(capsys: pytest.CaptureFixture[str]) -> None:
    """The total is what is known then."""
    found = explore(scene_from_spec("agv:graph=K5,n=2"), progress=True)
    assert "explore: 100%" in shown(capsys)
    assert len(found.states) == 10


@pytest.mark.slow
def test_searches_count_steps_and_show_the_best_path(capsys: pytest.CaptureFixture[str]) -> None:
    """The result is that of the search without a bar."""
    played = play("agv:graph=grid3x3,n=3", "random", seed=2, max_rounds=30)
    start, system = played.scene.start_state, played.scene.system
    given: Any = {"iterations": 50, "normal": normal_cube_path(played.path)}
    better = improve(played.path, start, system, progress=True, **given)
    assert f"{better.moves} moves, {better.cubes} cubes" in shown(capsys)
    assert better == improve(played.path, start, system, **given)
    found = shorten(played)
    known = beyond(task_of(found), found, iterations=50, progress=True)
    assert "optimum: " in shown(capsys)
    assert known.optimal


def test_a_stage_begins_at_zero(capsys: pytest.CaptureFixture[str]) -> None:
    """With its own name and, if known, its own total."""
    with progress_bar("work", " steps") as bar:
        stages = StageProgress(bar)
        stages.tick("one", 7)
        stages.tick("two", 1, 2)
        stages.between(3, 5)
        assert (bar.n, bar.total) == (1, 2)
    assert "two:" in (last := shown(capsys))
    assert "5 cubes, open: 3..4" in last


def test_a_bar_that_is_not_shown_writes_nothing() -> None:
    """Its methods may be called all the same."""
    bar = progress_bar("work", " steps", shown=False)
    assert isinstance(bar, tqdm.std.tqdm)
    bar.fp = io.StringIO()
    StageProgress(bar).tick("one", 1)
    bar.close()
    assert not bar.fp.getvalue()


def test_each_watcher_is_called() -> None:
    """Those that are None are not there."""
    heard: list[tuple[int, int]] = []
    each_of(None, lambda one, other: heard.append((one, other)))(1, 2)
    assert heard == [(1, 2)]
