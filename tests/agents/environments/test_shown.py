"""Relative observations are the same in every environment and for rules; PettingZoo takes them."""

import pickle
import warnings
from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test

from cubepath.agents import Choice, InitialKnowledge, Rule, RuleType, View, env as in_turns
from cubepath.agents.environments.environment import CubepathEnv
from cubepath.agents.environments.free_environment import FreeEnv, parallel_env
from cubepath.agents.environments.rollouts import play
from cubepath.agents.local.random_streams import RandomStream
from cubepath.agents.local.relative import Showing
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.specs import scene_from_spec
from samples.local_families import LOCAL_FAMILIES

SPECS = [*LOCAL_FAMILIES, "agv:graph=K5,n=3"]

Arrays = dict[tuple[int, int], NDArray[np.float32]]


@pytest.fixture(autouse=True)
def _accept_advice() -> Any:
    # PettingZoo's tests warn where an observation is not one flat array; a mask makes it a dict.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        yield


@pytest.mark.parametrize("spec", ["hex", "agv-labelled", "arm", "words", "assembly"])
def test_parallel_api(spec: str) -> None:
    """PettingZoo's parallel tests pass, and the spaces hold what is shown."""
    make = partial(parallel_env, spec, max_cycles=20, observation="relative")
    parallel_api_test(make(), num_cycles=30)
    parallel_seed_test(make, num_cycles=5)


@pytest.mark.parametrize("spec", SPECS)
def test_the_spaces_hold_what_is_shown(spec: str) -> None:
    """Floats in the place of integers, and all else beside them."""
    one = parallel_env(spec, observation="relative", note_length=2)
    seen, _ = one.reset(seed=0)
    for name, each in seen.items():
        assert one.observation_space(name).contains(each)
        assert each["observation"].dtype == np.float32
        assert list(each) == ["observation", "action_mask", "notes"]


@pytest.mark.parametrize("spec", ["hex:n=4", "agv-labelled:graph=K5,n=3"])
def test_api(spec: str) -> None:
    """PettingZoo's api_test passes on the environment in turns, under both clocks."""
    api_test(in_turns(spec, observation="relative", max_cycles=20), num_cycles=40)
    free = in_turns(spec, observation="relative", max_cycles=20, clock="free", note_length=2, lag=3)
    api_test(free, num_cycles=40)


def looking(found: Arrays) -> RuleType:
    """Return a rule that notes what its modules see relatively, and takes the last legal action."""

    def make(knowledge: InitialKnowledge) -> Rule:
        observer = knowledge.relative()
        rounds = iter(range(1000))

        def choose(view: View) -> int:
            found[next(rounds), knowledge.module] = observer.of(view.numbers)
            return int(view.mask.nonzero()[0][-1])

        return choose

    return RuleType("looking", "looks", "this test", lambda _: True, make)


@pytest.mark.parametrize("spec", SPECS)
def test_a_rule_sees_what_the_environment_shows(spec: str) -> None:
    """Round by round, to the last bit; masks and all else are those of the absolute one."""
    scene = scene_from_spec(spec)
    found: Arrays = {}
    played = play(scene, looking(found), max_rounds=6)
    one, plain = CubepathEnv(scene, observation="relative"), CubepathEnv(scene)
    seen, _ = one.reset(seed=0)
    was, _ = plain.reset(seed=0)
    for number in range(len(played.rounds)):
        actions = {}
        for module, name in enumerate(one.possible_agents):
            expected = found[number, module]
            assert seen[name]["observation"].tobytes() == expected.tobytes()
            assert seen[name]["action_mask"].tobytes() == was[name]["action_mask"].tobytes()
            actions[name] = int(seen[name]["action_mask"].nonzero()[0][-1])
        (seen, *rest), (was, *before) = one.step(actions), plain.step(actions)
        assert repr(rest) == repr(before)
    assert len(found) == len(played.rounds) * len(scene.start) > 0


def free(spec: str, observation: Showing, lag: int) -> FreeEnv:
    """Return an environment without rounds and wrappers, reset."""
    made = in_turns(spec, clock="free", lag=lag, note_length=1, observation=observation).unwrapped
    assert isinstance(made, FreeEnv)
    made.reset(seed=3)
    return made


@pytest.mark.few(6)
@pytest.mark.parametrize("lag", [0, 3])
@pytest.mark.parametrize("spec", SPECS)
def test_without_rounds_a_module_sees_what_it_was_shown(spec: str, lag: int) -> None:
    """The relative observation is that of the absolute one, which may be out of date."""
    plain, one = free(spec, "absolute", lag), free(spec, "relative", lag)
    scene = one.scene
    turns = 0
    while turns < 2 * len(scene.start) and not any(one.terminations.values()):
        turns += 1
        name = one.agent_selection
        assert name == plain.agent_selection
        seen, was = one.observe(name), plain.observe(name)
        assert one.observation_space(name).contains(seen)
        module = one.possible_agents.index(name)
        start, goals, stream = scene.start[module], scene.goals[module], RandomStream(0)
        knowledge = InitialKnowledge(scene.system, module, len(scene.start), start, goals, stream)
        expected = knowledge.relative().of(was["observation"].astype(np.int32))
        assert seen["observation"].tobytes() == expected.tobytes()
        assert list(seen) == list(was) == ["observation", "action_mask", "notes", "register"]
        assert all(seen[key].tolist() == was[key].tolist() for key in list(seen)[1:])
        choice = Choice(int(seen["action_mask"].nonzero()[0][-1]), (7,))
        assert one.act(choice) == plain.act(choice)
    assert turns > 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "spec", ["agv-labelled:graph=grid3x3,n=4", pytest.param("arms", marks=pytest.mark.thorough)]
)
def test_over_zenoh_modules_show_the_same(spec: str) -> None:
    """`transport="zenoh"` gives the same relative observations, rewards, ends and infos."""
    here = parallel_env(spec, max_cycles=8, observation="relative")
    there = parallel_env(spec, max_cycles=8, observation="relative", transport="zenoh", processes=0)
    try:
        seen, _ = here.reset(seed=9)
        told, _ = there.reset(seed=9)
        assert repr(seen) == repr(told)
        name = here.possible_agents[0]
        assert there.observation_space(name) == here.observation_space(name)
        while here.agents:
            actions = {
                name: int(seen[name]["action_mask"].nonzero()[0][-1]) for name in here.agents
            }
            one, other = here.step(actions), there.step(actions)
            assert repr(one) == repr(other)
            seen = one[0]
            for each in seen:
                assert (
                    seen[each]["observation"].tobytes() == other[0][each]["observation"].tobytes()
                )
    finally:
        there.close()


def test_copies_that_went_through_pickle_show_the_same() -> None:
    """In every environment: vector wrappers make theirs that way."""
    for one in (
        parallel_env("agv:n=3", observation="relative"),
        in_turns("agv:n=3", observation="relative", clock="free").unwrapped,
    ):
        again = pickle.loads(pickle.dumps(one))  # noqa: S301 - our own bytes
        name = one.possible_agents[0]
        assert again.observation_space(name) == one.observation_space(name)
        assert again.observation_space(name)["observation"].dtype == np.float32
    wire = parallel_env("agv:n=3", observation="relative", transport="zenoh", processes=0)
    again = pickle.loads(pickle.dumps(wire))  # noqa: S301 - our own bytes
    assert again.observation_space("module_0") == wire.observation_space("module_0")


@pytest.mark.parametrize(
    "make",
    [
        parallel_env,
        partial(parallel_env, transport="zenoh"),
        in_turns,
        partial(in_turns, clock="free"),
    ],
)
def test_other_observations_are_refused(make: Any) -> None:
    """What was found and what is expected, in one line; the default is the absolute one."""
    with pytest.raises(
        InputError, match=r"^observation='near': expected 'absolute' or 'relative'$"
    ):
        make("agv", observation="near")
    assert make("agv").observation_space("module_0")["observation"].dtype == np.int32
