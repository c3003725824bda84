"""The rules crossing and geodesic: every move brings its module nearer, and the goal is reached."""

from dataclasses import replace
from itertools import islice, product

import pytest

from cubepath.agents.environments.rollouts import play
from cubepath.agents.rules.descent import CROSSING, GEODESIC
from cubepath.agents.rules.registry import own_rule
from cubepath.coordinator.theory.complexes.exploration import explore
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.ideals import step_needs
from cubepath.protocol.core.sites import in_order
from cubepath.protocol.scenes.families.assembly import PLANS, assembly_moves
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.systems.listed import TabledSystem
from oracles.obvious import obvious_normal_form


@pytest.mark.slow
@pytest.mark.parametrize("hesitate", [0.0, 0.5])
@pytest.mark.parametrize(
    "points", [6, 9, 14, *(pytest.param(n, marks=pytest.mark.nightly) for n in (30, 45, 60))]
)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_triangulation_becomes_another_by_flips_that_lower_the_crossings(
    points: int, seed: int, hesitate: float
) -> None:
    """From random to random, each flip fewer crossings, hesitation or not."""
    scene = scene_from_spec(f"triangulation:n={points},seed={seed},start=random,goal=random")
    assert scene.goal is not None
    potential = scene.system.potential(scene.goal)
    assert potential is not None
    played = play(scene, CROSSING, seed=seed, hesitate=hesitate)
    assert played.reached
    for each in played.rounds:
        assert all(potential(m.target) < potential(m.source) for m in each.moves.values())


@pytest.mark.slow
@pytest.mark.parametrize(
    "spec",
    [
        "assembly:n=2",
        "assembly:n=3,until=placed",
        "assembly:kind=tree,n=2",
        "assembly:kind=wall,n=2,until=placed",
    ],
)
def test_between_any_two_states_no_claim_is_lost_and_the_rounds_are_the_least(spec: str) -> None:
    """All pairs: as many rounds as the normal cube path, which is the only class, has cubes."""
    scene = scene_from_spec(spec)
    explored = explore(scene, max_states=10_000)
    states = [explored.state(number) for number in range(len(explored.states))]
    for start, goal in islice(product(states, states), 0, None, 1 + len(states) ** 2 // 1000):
        sites = in_order(goal)
        pair = replace(
            scene, start=in_order(start), goal=frozenset(goal), goals=tuple((s,) for s in sites)
        )
        played = play(pair, GEODESIC)
        assert played.reached
        assert not any(each.lost for each in played.rounds)
        assert len(played.rounds) == len(obvious_normal_form(played.path))


@pytest.mark.slow
@pytest.mark.parametrize("kind", PLANS)
@pytest.mark.parametrize("weld", [False, True])
def test_structures_are_systems_of_ideals(kind: str, weld: bool) -> None:
    """And are none if one move forgets what it needs, or what needs it."""
    moves = assembly_moves(PLANS[kind][0](3), weld=weld)
    letters = ("open", "placed", "welded")[: 2 + weld]

    def system(listed: list[Move]) -> TabledSystem:
        return TabledSystem(listed, letters=letters, drawing="letters")

    assert step_needs(system(list(moves))) is not None
    for number, move in enumerate(moves):
        action = move.action
        if not action.reads:
            continue
        left_out = in_order(action.reads)[0]
        ends = [end - {left_out} for end in action.ends]
        short = Action(action.support - {left_out}, action.trace, *ends, label=action.label)
        others = [*moves[:number], *moves[number + 1 :]]
        assert step_needs(system([*others, replace(move, action=short)])) is None


@pytest.mark.parametrize("spec", ["polygon", "triangulation", "assembly"])
def test_they_are_the_rules_of_their_families(spec: str) -> None:
    """So a run without a rule reaches its goal."""
    assert own_rule(scene_from_spec(spec)) in {"crossing", "geodesic"}
    assert play(spec).reached
