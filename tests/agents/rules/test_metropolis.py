"""The rule metropolis: any legal move, but one away from the goal only now and then."""

from dataclasses import replace
from math import exp

import pytest

from cubepath.agents.environments.rollouts import play
from cubepath.agents.local.observation import STAY, observe
from cubepath.agents.local.random_streams import RandomStream
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.potential import OwnPotential, SiteDistances
from cubepath.agents.rules.registry import find_rule, is_built_in
from cubepath.agents.rules.rule import InitialKnowledge, RuleType
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.scenes.specs import scene_from_spec
from samples.local_families import LOCAL_FAMILIES


def rule_of(name: str) -> RuleType:
    """Return the rule of a name that there is."""
    found = find_rule(name)
    assert found is not None
    return found


@pytest.mark.slow
@pytest.mark.parametrize("family", LOCAL_FAMILIES)
def test_it_reaches_the_default_goal_of_every_family(family: str) -> None:
    """Unless the scene has none."""
    scene = scene_from_spec("hex:n=4" if family == "hex" else family)
    assert play(scene, "metropolis", seed=3, max_rounds=20_000).reached or scene.goal is None


@pytest.mark.parametrize(
    ("values", "share"),
    [("temperature=0.5", exp(-2)), ("temperature=2", exp(-0.5)), ("temperature=5,cooling=0.1", 0)],
)
def test_a_move_away_has_the_probability_of_its_temperature(values: str, share: float) -> None:
    """A vehicle at its goal draws to stay or to leave, and then leaves with that probability."""
    scene = scene_from_spec("agv:graph=P2,n=1")
    home = replace(scene, goal=scene.start_state, goals=(scene.start,))
    (actor,) = actors_for(home, rule_of(f"metropolis:{values}"), seed=1, hesitate=0.0).values()
    seen = observe(home.system, home.start[0], {}, goals=frozenset(home.start))
    left = sum(actor.act(seen).action != STAY for _ in range(4000))
    assert left / 4000 == pytest.approx(share / 2, abs=0.03)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("metropolis:temperature=x", "temperature=x: expected a number, more than 0"),
        ("metropolis:temperature=0", "temperature=0: expected more than 0"),
        ("metropolis:cooling=2", "cooling=2: expected more than 0 and at most 1"),
        ("metropolis:heat=1", "rule 'metropolis': cannot read 'heat=1', expected KEY=VALUE"),
        ("random:heat=1", "rule 'random': cannot read 'heat=1', expected KEY=VALUE"),
    ],
)
def test_a_wrong_value_is_refused(name: str, why: str) -> None:
    """In one line, with what was expected."""
    with pytest.raises(InputError, match=why):
        find_rule(name)


def test_a_rule_with_values_is_the_project_s_own() -> None:
    """Its name has the values in the order of the keys."""
    rule = rule_of("metropolis:cooling=0.5,temperature=2")
    assert rule.name == "metropolis:temperature=2,cooling=0.5"
    assert is_built_in(rule)
    assert not is_built_in(RuleType("metropolis", "", "", rule.fits, rule.make))


@pytest.mark.parametrize(
    ("spec", "goal", "site", "far"),
    [
        ("hex:n=3", (5, 2), (5, -1), 3),
        ("arm:n=3", (0, 0, 0), (0, 0, 1), 1),
        ("agv:graph=grid3x3,n=2", (0, 0), (2, 2), 4),
        ("assembly", ((0, 0), "welded"), ((0, 0), "open"), 2),
    ],
)
def test_how_far_a_site_is(spec: str, goal: Site, site: Site, far: int) -> None:
    """Along the ways of the system, from a search that is shared or not."""
    system = scene_from_spec(spec).system
    known = InitialKnowledge(system, 0, 1, site, (goal,), RandomStream(0))
    assert OwnPotential(known).of(site) == far
    assert SiteDistances(system, goal).of(site) == far


def test_a_goal_that_another_module_has_taken_does_not_count() -> None:
    """Unless all are taken."""
    scene = scene_from_spec("hex:n=3")
    goals = scene.goals[0]
    known = InitialKnowledge(scene.system, 0, 3, (0, 0), goals, RandomStream(0))
    potential = OwnPotential(known)
    assert potential.of(goals[0]) == 0
    assert potential.of(goals[0], {goals[0]}) == 1
    assert potential.of(goals[0], set(goals)) == 0
