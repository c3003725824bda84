"""The rule chain without rounds: whoever acts when, and however late it sees, it gets there."""

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.agents.environments.rollouts import play_free
from cubepath.agents.rules.chain import CHAIN
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from samples.free_plays import Pace, paces


@st.composite
def chains(draw: st.DrawFn) -> Scene:
    """Return a chain of either catalogue with any bend or slide."""
    family = draw(st.sampled_from(["hex", "hex-open"]))
    n, bend = draw(st.integers(2, 8)), draw(st.sampled_from([60, 120, -60, -120, 0]))
    shift = draw(st.integers(1, n)) if bend == 0 else 1
    return scene_from_spec(f"{family}:n={n},bend={bend},shift={shift}")


@pytest.mark.slow
@settings(max_examples=4, derandomize=True)
@given(chains(), paces())
def test_every_chain_reaches_its_goal(scene: Scene, pace: Pace) -> None:
    """Under every scheduler, with late views, hesitation and modules that lose their memory."""
    played = pace.play(scene, CHAIN)
    assert played.failed is None
    assert played.reached


@pytest.mark.nightly
@settings(max_examples=40, derandomize=True)
@given(chains(), paces())
def test_very_many_chains_reach_their_goals(scene: Scene, pace: Pace) -> None:
    """The same, on many more."""
    assert pace.play(scene, CHAIN).reached


def test_the_moves_are_those_of_the_rule_with_rounds() -> None:
    """The one-sided task has one homotopy class: 154 moves, and a height of 54 levels."""
    played = play_free(scene_from_spec("hex:n=12"), CHAIN, seed=3)
    assert (len(played.moves), max(move.level for move in played.moves)) == (154, 54)


@pytest.mark.thorough
def test_without_the_guard_walkers_that_see_late_are_stuck(monkeypatch: pytest.MonkeyPatch) -> None:
    """The guard is what keeps them apart: the same runs without it do not all get there."""
    from cubepath.agents.rules.chain_task import ChainTask

    guarded = ChainTask.guarded
    scene = scene_from_spec("hex:n=8")
    assert all(play_free(scene, CHAIN, seed=seed, lag=5).reached for seed in range(4))
    monkeypatch.setattr(ChainTask, "guarded", lambda task, view: (guarded(task, view)[0], ()))
    runs = [play_free(scene, CHAIN, seed=seed, lag=5, max_cycles=300) for seed in range(4)]
    assert not all(played.reached for played in runs)


def test_nobody_moves_before_all_ahead_know_their_task() -> None:
    """The tail is the last to write its register: no first look comes too late."""
    scene = scene_from_spec("hex:n=6")
    played = play_free(scene, CHAIN, seed=1, speeds={2: 100})
    first = next(number for number, commit in enumerate(played.commits) if commit.generator)
    assert first == 5  # all but the module that is on the goal
    assert len(played.commits) == first + len(played.moves)


def test_a_start_that_is_no_chain_fails_in_one_line() -> None:
    """As with rounds."""
    system = scene_from_spec("hex:n=3").system
    goals = ((0, 0), (0, 1), (0, 2))
    scene = Scene("bent", "hex", system, ((0, 0), (1, 0), (2, -1)), frozenset(goals), (goals,) * 3)
    played = play_free(scene, CHAIN)
    assert played.failed is not None
    assert "no straight chain leads from" in played.failed or "no goal end" in played.failed
    assert not played.moves
