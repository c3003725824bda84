"""Vector environments are as many environments side by side, and end as Gymnasium has it."""

from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from cubepath.agents.environments.free_environment import parallel_env
from cubepath.agents.environments.vector_environment import CubepathVectorEnv, vector_env
from cubepath.protocol.core.errors import InputError


def drawn(seen: dict[str, NDArray[Any]], random: np.random.Generator) -> NDArray[np.int64]:
    mask = seen["action_mask"]
    found: NDArray[np.int64] = np.where(mask, random.random(mask.shape), -1.0).argmax(2)
    return found


def arrays(seen: dict[str, dict[str, NDArray[Any]]]) -> dict[str, Any]:
    """Return what all agents of one environment observe, stacked."""
    return {key: [one[key].tolist() for one in seen.values()] for key in seen["module_0"]}


@pytest.mark.few(3)
@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("copy", [True, False])
def test_each_environment_is_one_of_pettingzoo(mode: AutoresetMode, *, copy: bool) -> None:
    """Observations, rewards and ends, through several episodes, with each way to begin anew."""
    spec, count, cycles = "hex:n=3", 4, 12
    many = vector_env(
        spec, num_envs=count, max_cycles=cycles, note_length=1, autoreset_mode=mode, copy=copy
    )
    single = [parallel_env(spec, max_cycles=cycles, note_length=1) for _ in range(count)]
    random = np.random.default_rng(2)
    seen, infos = many.reset(seed=7)
    assert infos["seed"].tolist() == [7, 8, 9, 10]
    for env, seed in zip(single, infos["seed"].tolist(), strict=True):
        env.reset(seed=seed)
    episodes = 0
    for _ in range(40):
        assert many.observation_space.contains(seen)
        actions = drawn(seen, random)
        notes = random.integers(0, 5, (count, 3, 1), dtype=np.int32)
        seen, rewards, done, late, infos = many.step(actions, notes)
        for number, env in enumerate(single):
            expected: tuple[float, bool, bool] = 0.0, False, False
            if env.agents:
                told = {f"module_{m}": tuple(notes[number, m].tolist()) for m in range(3)}
                chosen = {f"module_{m}": int(actions[number, m]) for m in range(3)}
                shown, gained, ended, cut, _ = env.step(chosen, told)
                expected = gained["module_0"], ended["module_0"], cut["module_0"]
            else:  # NEXT_STEP: whatever was chosen, a new episode begins
                shown, _ = env.reset(seed=int(infos["seed"][number]))
            assert (rewards[number], done[number], late[number]) == expected
            if not env.agents and mode is AutoresetMode.SAME_STEP:
                last = {key: array[number].tolist() for key, array in infos["final_obs"].items()}
                assert last == arrays(shown)
                shown, _ = env.reset(seed=int(infos["seed"][number]))
            assert arrays(shown) == {key: array[number].tolist() for key, array in seen.items()}
        over = done | late
        episodes += int(over.sum())
        if over.any() and mode is AutoresetMode.DISABLED:
            with pytest.raises(InputError, match=r"environment \d is over: reset it"):
                many.step(actions)
            seen, infos = many.reset(options={"reset_mask": over})
            for number in np.flatnonzero(over).tolist():
                single[number].reset(seed=int(infos["seed"][number]))
    assert episodes > count


def test_relative_observations_are_those_of_pettingzoo() -> None:
    """In each of the environments, and within the space."""
    many = vector_env("agv:graph=grid3x3,n=4", num_envs=2, observation="relative")
    single = [parallel_env("agv:graph=grid3x3,n=4", observation="relative") for _ in range(2)]
    random = np.random.default_rng(0)
    seen, _ = many.reset(seed=3)
    expected = [env.reset(seed=3 + number)[0] for number, env in enumerate(single)]
    for _ in range(10):
        assert many.observation_space.contains(seen)
        for number, each in enumerate(expected):
            assert arrays(each) == {key: array[number].tolist() for key, array in seen.items()}
        actions = drawn(seen, random)
        seen, *_ = many.step(actions)
        expected = [
            env.step(dict(zip(env.possible_agents, row, strict=True)))[0]
            for env, row in zip(single, actions.tolist(), strict=True)
        ]


def test_the_same_seeds_give_the_same_episodes() -> None:
    """Later ones too, and each environment has others."""
    found = []
    for _ in range(2):
        env = vector_env("agv:graph=P3,n=1", num_envs=3, max_cycles=2)
        env.reset(seed=[5, 6, 7])
        seeds = [env.step(np.zeros((3, 1), np.int64))[4]["seed"].tolist() for _ in range(9)]
        found.append(seeds)
    assert found[0] == found[1]
    assert len({seed for seeds in found[0] for seed in seeds}) == 3 * 4


def test_arrays_are_overwritten_if_asked_for() -> None:
    """By default they are left as they were given."""
    for copy in (True, False):
        env = vector_env("agv:graph=P3,n=1", num_envs=2, copy=copy)
        first, _ = env.reset(seed=0)
        second = env.step(np.ones((2, 1), np.int64))[0]
        assert (first["observation"] is second["observation"]) == (not copy)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"num_envs": 0}, "num_envs=0: expected 1 or more"),
        ({"autoreset_mode": "never"}, "autoreset_mode='never': expected one of 'NextStep'"),
    ],
)
def test_environments_that_are_refused(keywords: dict[str, Any], message: str) -> None:
    """In one line, with what is expected."""
    with pytest.raises(InputError, match=message):
        CubepathVectorEnv("hex:n=2", **keywords)


def test_steps_that_are_refused() -> None:
    """Before a reset, with other shapes, and with notes where there are none."""
    env = vector_env("hex:n=2", num_envs=2)
    with pytest.raises(InputError, match="call reset first"):
        env.step(np.zeros((2, 2), np.int64))
    for seed in (-1, [1], [0, -2]):
        with pytest.raises(InputError, match=r"seed=-\d: expected 0|1 seeds, expected 2"):
            env.reset(seed=seed)
    with pytest.raises(InputError, match="reset_mask: expected a boolean array"):
        env.reset(options={"reset_mask": [True, False]})
    env.reset(seed=0)
    for wrong in (np.zeros(2, np.int64), np.zeros((2, 2))):
        with pytest.raises(InputError, match=r"actions: expected integers of shape \(2, 2\)"):
            env.step(wrong)
    with pytest.raises(InputError, match=r"notes: expected int32 of shape \(2, 2, 0\)"):
        env.step(np.zeros((2, 2), np.int64), np.zeros((2, 2, 1), np.int32))
