"""The world in one process: what it makes of actions, and what it holds."""

import pytest

from cubepath.agents.environments.world import World
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.uniform import RANDOM
from cubepath.protocol.core.actions import apply_in_place
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec


@pytest.mark.parametrize(
    "spec",
    ["hex:n=7", "hex-open:n=7", "arm:n=7", "agv-labelled", "sliding:p=2,q=2,n=5", "arms:n=2"],
)
def test_the_state_of_the_world_follows_its_actions(spec: str) -> None:
    """Where modules are is what applying the executed actions to the state gives."""
    scene = scene_from_spec(spec)
    world = World(scene, seed=0)
    actors = actors_for(scene, RANDOM, seed=0, hesitate=0.0)
    state = set(scene.start_state)
    executed = 0
    for _ in range(30):
        played = world.step({m: a.act(world.observe(m)).action for m, a in actors.items()})
        for move in reversed(list(played.moves.values())):
            apply_in_place(move.action, state)
        executed += len(played.moves)
        assert state == set(world.sites) | scene.system.filled
    assert executed > 0


@pytest.mark.parametrize("observed", [False, True])
def test_an_action_that_is_not_in_the_mask_claims_nothing(observed: bool) -> None:
    """Whatever integer it is, unobserved too, and whoever wrote into the mask that was shown."""
    scene = scene_from_spec("hex:n=4")
    legal = World(scene, seed=0).observe(0)["action_mask"].tolist()
    for action in range(-2, len(legal) + 2):
        world = World(scene, seed=0)
        if observed:
            world.observe(0)["action_mask"][:] = 1
        played = world.step({0: action})
        allowed = 0 < action < len(legal) and legal[action] == 1
        assert list(played.moves) == ([0] if allowed else [])
        assert played.lost == ()
        assert (world.sites[0] != scene.start[0]) == allowed


def test_a_mask_is_of_the_round_in_which_it_was_observed() -> None:
    """What was legal a round ago claims nothing when somebody has come in between."""
    system = scene_from_spec("agv:graph=P3,n=1").system
    world = World(Scene("test", "", system, (0, 2)), seed=0)
    assert world.observe(0)["action_mask"][1]
    assert list(world.step({1: 1}).moves) == [1]
    assert not world.step({0: 1}).moves
    world.reset(0)
    assert list(world.step({0: 1}).moves) == [0]


def test_going_back_to_the_start_forgets_what_was_said() -> None:
    """After a reset nothing is heard until modules have chosen again."""
    world = World(scene_from_spec("agv:graph=P3,n=2"), seed=0, note_length=1)
    first = repr(world.observe(0))
    world.step({}, {0: (5,), 1: (6,)})
    assert 6 in world.observe(0)["notes"]
    world.step({})
    assert 6 in world.observe(0)["notes"]
    world.reset(0)
    assert repr(world.observe(0)) == first
    assert 6 not in world.observe(0)["notes"]
