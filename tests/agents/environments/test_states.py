"""States of an environment: what is put back, or copied, continues bit for bit."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest

from cubepath.agents.environments.environment import CubepathEnv, WireEnv
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
