"""Paths of runs in memory, shortened without a file between."""

from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from cubepath.agents.environments.rollouts import play, play_free, play_many
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.runs.run import run
from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.specs import scene_from_spec

SPECS = ("hex:n=4", "agv-labelled:graph=grid3x3,n=3", "arm:n=4", "polygon:n=6", "sliding:n=3")


@pytest.mark.thorough
@given(st.sampled_from(SPECS), st.integers(0, 1000))
def test_a_played_path_is_shortened_as_its_actions_are(spec: str, seed: int) -> None:
    """By the compiled heap of numbered moves and by the plain one of actions."""
    played = play(spec, "random", seed=seed, max_rounds=15)
    found = shorten(played)
    plain = normal_cube_path(played.path)
    assert [set(cube) for cube in found.cube_path] == [set(cube) for cube in plain]
    assert found.bound.cubes <= found.cubes
    assert (found.moves, len(played.placed)) == (len(played.path), len(played.path))


def test_a_run_in_processes_is_shortened_as_the_same_run_played(tmp_path: Path) -> None:
    """From memory, and from its recording."""
    outcome = run("hex:n=4", "random", seed=3, processes=0, max_rounds=20, log=tmp_path / "a.mcap")
    played = play("hex:n=4", "random", seed=3, max_rounds=20)
    by_file = shorten(outcome.log)
    assert tuple(outcome.path) == played.path
    assert shorten(outcome).cube_path == shorten(played).cube_path == by_file.cube_path


def test_a_run_without_rounds_is_shortened_too() -> None:
    """Its commits are its path."""
    played = play_free("hex:n=4", seed=1)
    found = shorten(played)
    assert (found.moves, found.reduced_moves) == (len(played.moves), len(played.path))
    assert found.cubes <= len(played.path)


def test_a_played_path_needs_no_other_input() -> None:
    """A system beside it is refused in a line."""
    with pytest.raises(InputError, match="hex:n=3: a path that was played"):
        shorten(play("hex:n=3"), system="hex:n=3")


def test_names_are_played_as_what_they_name() -> None:
    """A system and a rule by name, or the rule that reaches the goal; unknown ones are refused."""
    assert play("hex:n=3") == play(scene_from_spec("hex:n=3"), "chain")
    assert play_many("hex:n=3", None, [0]).reached.all()
    assert play_free("agv:graph=C4,n=1").reached
    with pytest.raises(InputError, match="unknown rule 'chian'"):
        play("hex:n=3", "chian")
    with pytest.raises(InputError, match="unknown system 'hexx'"):
        play_many("hexx", None, [0])
    with pytest.raises(InputError, match="not for this system: rule 'tswap'"):
        play_free("hex:n=3", "tswap")
