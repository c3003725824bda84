"""The rule tunnel: a line climbs along its channel, towards where its end says that the goal is."""

from dataclasses import replace

import pytest

from cubepath.agents.environments.rollouts import play, play_free
from cubepath.agents.rules.registry import rule_for
from cubepath.agents.rules.tunnel import TUNNEL
from cubepath.coordinator.theory.complexes.exploration import explore
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import in_order
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles.obvious import obvious_normal_form


@pytest.mark.slow
@pytest.mark.parametrize("n", [2, 4, 7, 12])
def test_a_line_is_at_its_goal_one_round_after_the_least(n: int) -> None:
    """In the first round nobody has heard where the goal is."""
    played = play(f"hex-tunnel:n={n}", TUNNEL)
    assert played.reached
    assert len(played.rounds) <= len(obvious_normal_form(played.path)) + (3 if n < 4 else 1)


@pytest.mark.slow
@pytest.mark.parametrize("hesitate", [0.0, 0.5])
@pytest.mark.parametrize("n", [3, *(pytest.param(n, marks=pytest.mark.thorough) for n in (4, 6))])
def test_the_goal_is_reached_from_every_state(n: int, hesitate: float) -> None:
    """Also from those past it, and where modules stand in one another's way."""
    scene = scene_from_spec(f"hex-tunnel:n={n}")
    explored = explore(scene, max_states=1000)
    for number in range(len(explored.states)):
        start = in_order(explored.state(number) - scene.system.filled)
        assert play(replace(scene, start=start), TUNNEL, hesitate=hesitate, seed=1).reached


@pytest.mark.slow
@pytest.mark.parametrize("scheduler", ["random", "unfair", "turns"])
def test_without_rounds_too(scheduler: str) -> None:
    """With views five commits old, and modules that forget."""
    played = play_free(
        "hex-tunnel:n=6", "tunnel", scheduler=scheduler, lag=5, restarts={20: [1], 50: [3]}
    )
    assert played.reached


def test_a_goal_in_two_rows_is_refused() -> None:
    """In one line, and no error proposes the rule for the scene."""
    scene = scene_from_spec("hex-tunnel:n=3")
    goals = (*scene.goals[0][:2], (4, 2))
    other = replace(scene, goal=frozenset(goals), goals=(goals,) * 3)
    with pytest.raises(InputError, match="needs a goal that is a straight part of one row"):
        rule_for("tunnel", other)
    with pytest.raises(InputError, match="not for this system: rule 'word', expected") as error:
        rule_for("word", other)
    assert "tunnel" not in str(error.value)
