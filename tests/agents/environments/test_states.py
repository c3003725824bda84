"""States of an environment: what is put back, or copied, continues bit for bit."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest

from cubepath.agents import env as in_turns
from cubepath.agents.environments.environment import CubepathEnv, WireEnv
from cubepath.agents.environments.free_environment import FreeEnv
from cubepath.agents.environments.vector_environment import CubepathVectorEnv
from cubepath.protocol.core.errors import InputError

SPECS = ("agv-labelled:graph=grid4x4,n=5,seed=1", "hex:n=5", "triangulation:n=8")


def stepped(env: CubepathEnv, rounds: int, seed: int) -> list[Any]:
    """Return all that some rounds of random actions and notes give, as text and bytes."""
    random, found = np.random.default_rng(seed), list[Any]()
    for _ in range(rounds):
        drawn = random.integers(0, 5, (len(env.possible_agents), 2)).tolist()
        actions = {name: each[0] for name, each in zip(env.possible_agents, drawn, strict=True)}
        notes = {name: (each[1],) for name, each in zip(env.agents, drawn, strict=False)}
        seen, *rest, infos = env.step(actions, notes)
        told = [
            (name, key, array.tobytes()) for name, of in seen.items() for key, array in of.items()
        ]
        masks = [(name, of["action_mask"].tobytes(), of["illegal"]) for name, of in infos.items()]
        found.append((told, masks, rest, list(env.agents), env.state().tobytes()))
    return found


@pytest.mark.parametrize("spec", SPECS)
@pytest.mark.parametrize(("first", "then"), [("plain", "compiled"), ("compiled", "plain")])
def test_an_episode_continues_bit_for_bit(spec: str, first: str, then: str) -> None:
    """In a copy, and from its state in an environment with another world and another past."""
    env = CubepathEnv(spec, world=first, note_length=1, max_cycles=12)
    env.reset(seed=7)
    stepped(env, 5, seed=1)
    state = env.get_state()
    twin = copy.deepcopy(env)
    other = CubepathEnv(spec, world=then, note_length=1, max_cycles=12)
    other.reset(seed=3)
    stepped(other, 2, seed=9)
    other.set_state(pickle.loads(pickle.dumps(state)))  # noqa: S301 - made here
    assert other.get_state() == twin.get_state() == state
    after = stepped(env, 9, seed=2)
    assert env.get_state() != state
    assert stepped(twin, 9, seed=2) == after
    assert stepped(other, 9, seed=2) == after
    assert after[-1][3] == []  # the limit of cycles is counted from the start
    env.set_state(state)
    assert stepped(env, 9, seed=2) == after


def test_a_copy_before_the_first_reset_is_fresh() -> None:
    """It has the same arguments, and what was set since; no state is there yet."""
    env = CubepathEnv("hex:n=3", max_cycles=9)
    env.max_cycles = 4
    twin = copy.deepcopy(env)
    assert (twin.max_cycles, twin.scene.spec, twin.agents) == (4, "hex:n=3", [])
    with pytest.raises(InputError, match="has not been reset yet"):
        twin.get_state()


@pytest.mark.parametrize("world", ["plain", "compiled"])
@pytest.mark.parametrize("showing", ["absolute", "relative"])
def test_a_state_is_put_back_with_what_was_seen_there(world: str, showing: Any) -> None:
    """A search asks its policy for the observations of a node before it steps from there."""
    env = CubepathEnv("agv-labelled:graph=grid4x4,n=5", world=world, observation=showing)
    env.reset(seed=2)
    for action in (1, 2):
        seen, *_, infos = env.step(dict.fromkeys(env.agents, action))
    state = env.get_state()
    env.step(dict.fromkeys(env.agents, 3))
    again, marks = env.set_state(state)
    assert repr(again) == repr(seen)
    assert all((marks[name]["action_mask"] == infos[name]["action_mask"]).all() for name in seen)
    assert copy.deepcopy(env).scene is env.scene


def played(env: CubepathVectorEnv, rounds: int, seed: int) -> list[str]:
    """Return all that some rounds of random actions and notes give."""
    random, found = np.random.default_rng(seed), list[str]()
    for _ in range(rounds):
        shape = env.num_envs, env.batch.modules
        notes = random.integers(0, 9, (*shape, env.note_length)).astype(np.int32)
        found.append(repr(env.step(random.integers(0, 5, shape), notes)))
    return found


@pytest.mark.few(4)
@pytest.mark.parametrize("spec", SPECS)
@pytest.mark.parametrize("showing", ["absolute", "relative"])
def test_many_environments_continue_bit_for_bit(spec: str, showing: Any) -> None:
    """In a copy to the end of all, from their states to the end of their episodes."""

    def made() -> CubepathVectorEnv:
        given: Any = {"max_cycles": 12, "note_length": 1, "observation": showing}
        return CubepathVectorEnv(spec, num_envs=3, **given)

    env, other = made(), made()
    env.reset(seed=7)
    played(env, 5, seed=1)
    states = env.get_state()
    twin = copy.deepcopy(env)
    other.reset(seed=3)
    played(other, 2, seed=9)
    seen, _ = other.set_state(pickle.loads(pickle.dumps(states)))  # noqa: S301 - made here
    assert repr(seen) == repr(env._observations())
    assert other.get_state() == states
    after = played(env, 30, seed=2)
    assert played(twin, 30, seed=2) == after
    assert played(other, 7, seed=2) == after[:7]
    assert all(state.agents == () for state in other.get_state())


def test_one_state_begins_many_environments() -> None:
    """A search in parallel: states of `parallel_env` are those of `vector_env`."""
    spec, actions = "agv-labelled:graph=grid4x4,n=3,seed=2", np.array([[1, 0, 2], [3, 4, 1]])
    one, many = CubepathEnv(spec), CubepathVectorEnv(spec, num_envs=2)
    one.reset(seed=4)
    one.step({"module_0": 2, "module_2": 1})
    state = one.get_state()
    many.set_state([state] * 2)
    many.step(actions)
    for number, chosen in enumerate(actions.tolist()):
        one.set_state(state)
        one.step(dict(zip(one.agents, chosen, strict=True)))
        assert many.get_state()[number] == one.get_state()
    with pytest.raises(InputError, match="1 seeds, expected 2"):
        many.set_state([state])


def turns(env: Any, count: int, seed: int) -> list[str]:
    """Return what some turns of random legal actions give."""
    random, found = np.random.default_rng(seed), list[str]()
    for _ in range(count):
        if env.agents:
            seen, reward, ended, cut, info = env.last()
            found.append(repr((env.agent_selection, seen, reward, ended, cut, info)))
            legal = np.flatnonzero(seen["action_mask"])
            env.step(None if ended or cut else int(random.choice(legal)))
    return found


@pytest.mark.parametrize("scheduler", ["random", "unfair", "turns"])
def test_a_copy_in_turns_continues_bit_for_bit(scheduler: str) -> None:
    """Under both clocks, in the middle of a round, with what is shown late."""
    given: Any = {"scheduler": scheduler, "lag": 2, "note_length": 1}
    env: Any
    for env in (
        in_turns(SPECS[0], max_cycles=9),
        in_turns(SPECS[0], max_cycles=9, clock="free", **given),
        FreeEnv(SPECS[0], max_cycles=9, **given),
    ):
        env.reset(seed=1)
        turns(env, 13, seed=1)
        twin, third = copy.deepcopy(env), copy.deepcopy(env)
        after = turns(env, 60, seed=2)
        assert not env.agents
        assert turns(twin, 60, seed=2) == after
        assert turns(copy.deepcopy(third), 60, seed=2) == after
        assert twin.unwrapped.scene is env.unwrapped.scene


@pytest.mark.slow
def test_states_over_zenoh_are_refused() -> None:
    """The modules there hold what they know themselves."""
    env = WireEnv("hex:n=3", processes=0)
    try:
        env.reset(seed=1)
        with pytest.raises(InputError, match="state: modules over zenoh keep it, expected a world"):
            env.get_state()
    finally:
        env.close()
