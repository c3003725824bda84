"""The PettingZoo environments keep PettingZoo's contract, for every system."""

from __future__ import annotations

import pickle
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from pettingzoo.test import (
    api_test,
    max_cycles_test,
    parallel_api_test,
    parallel_seed_test,
    render_test,
    seed_test,
)

import cubepath.agents
from cubepath.agents import CubepathEnv, env, parallel_env
from cubepath.protocol.errors import InputError
from cubepath.protocol.graph_system import GraphSystem
from cubepath.protocol.scenes import FAMILIES
from cubepath.protocol.systems import Scene

SPECS = [*FAMILIES, "agv:graph=K5,n=3", "agv-labelled:graph=C5,n=2", "arm:n=1", "hex:n=3,bend=0"]


@pytest.fixture(autouse=True)
def _accept_advice() -> Any:
    # PettingZoo's tests warn where an observation is not one flat array; a mask makes it a dict.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        yield


@pytest.mark.parametrize("spec", SPECS)
def test_api(spec: str) -> None:
    """PettingZoo's api_test passes on the environment in turns."""
    api_test(env(spec, max_cycles=30), num_cycles=60)


@pytest.mark.parametrize("spec", SPECS)
def test_parallel_api(spec: str) -> None:
    """PettingZoo's parallel_api_test passes."""
    parallel_api_test(parallel_env(spec, max_cycles=30), num_cycles=60)


@pytest.mark.parametrize("spec", SPECS)
def test_seeds(spec: str) -> None:
    """PettingZoo's seed tests pass."""
    seed_test(partial(env, spec, max_cycles=20), num_cycles=10)
    parallel_seed_test(partial(parallel_env, spec, max_cycles=20), num_cycles=10)


class Module:
    """What max_cycles_test takes for a module: a system's two constructors."""

    def __init__(self, spec: str) -> None:
        self.parallel_env: Callable[..., Any] = partial(parallel_env, spec)
        self.env: Callable[..., Any] = partial(env, spec)


@pytest.mark.parametrize("spec", ["hex", "hex-open", "agv", "agv-labelled", "arm:n=9"])
def test_max_cycles(spec: str) -> None:
    """PettingZoo's max_cycles_test passes."""
    max_cycles_test(Module(spec))


def test_the_package_itself_has_both_constructors() -> None:
    """`cubepath.agents` is what PettingZoo's tools take for an environment's module."""
    max_cycles_test(cubepath.agents)


@pytest.mark.slow
@pytest.mark.parametrize("spec", [*FAMILIES, "agv:graph=K5,n=3"])
def test_render(spec: str, capsys: pytest.CaptureFixture[str]) -> None:
    """PettingZoo's render_test passes for human, ansi and rgb_array."""
    render_test(lambda **keywords: env(spec, **keywords))
    assert capsys.readouterr().out.strip()


@pytest.mark.parametrize("spec", SPECS)
def test_a_seed_decides_the_whole_episode(spec: str) -> None:
    """The same seed and actions give the same episode; parallel_seed_test stops after a step."""
    runs = []
    for _ in range(2):
        trace = []
        one = parallel_env(spec, max_cycles=25)
        observations, _ = one.reset(seed=11)
        random = np.random.default_rng(5)
        while one.agents:
            actions = {
                name: int(random.choice(observations[name]["action_mask"].nonzero()[0]))
                for name in one.agents
            }
            observations, rewards, done, late, _ = one.step(actions)
            trace.append((repr(observations), rewards, done, late, repr(one.state())))
        runs.append(trace)
    assert runs[0] == runs[1]


def test_seeds_matter_where_claims_collide() -> None:
    """With claims that collide, another seed gives another episode."""
    star = GraphSystem(range(4), [(0, 1), (0, 2), (0, 3)])
    ends = set()
    for seed in range(8):
        one = parallel_env(Scene("star", "", star, start=(1, 2, 3)), max_cycles=1)
        one.reset(seed=seed)
        one.step(dict.fromkeys(one.agents, 1))
        ends.add(repr(one.state()))
    assert len(ends) == 3


def test_an_inadmissible_action_is_stay() -> None:
    """A masked-out action is no error: the module stays, and the infos say that it was illegal."""
    one = parallel_env("hex:n=3")
    observations, _ = one.reset(seed=0)
    before = one.state()
    illegal = int((observations["module_1"]["action_mask"] == 0).nonzero()[0][0])
    _, _, _, _, infos = one.step({"module_1": illegal})
    assert (one.state() == before).all()
    assert infos["module_1"]["illegal"]
    assert not infos["module_0"]["illegal"]


def test_reward_is_shared_progress_and_the_goal_ends_the_episode() -> None:
    """Rewards add up to the fraction of goal places gained; reaching the goal terminates."""
    one = parallel_env("agv:graph=P4,n=1")
    one.reset(seed=0)
    rewards, done = [], {}
    for action in (1, 2, 2):
        _, reward, done, late, _ = one.step({"module_0": action})
        rewards.append(reward["module_0"])
    assert rewards == [0.0, 0.0, 1.0]
    assert done == {"module_0": True}
    assert late == {"module_0": False}
    assert one.agents == []


def test_truncation_after_max_cycles() -> None:
    """An episode that does not reach the goal is truncated, not terminated."""
    one = parallel_env("hex:n=3", max_cycles=2)
    one.reset(seed=0)
    one.step({})
    _, _, done, late, _ = one.step({})
    assert not any(done.values())
    assert all(late.values())


def test_environments_can_be_pickled() -> None:
    """A copy that went through pickle plays the same (vector wrappers need it)."""
    one = CubepathEnv("hex:n=4", max_cycles=7)
    again = pickle.loads(pickle.dumps(one))  # noqa: S301 - our own bytes
    assert again.max_cycles == 7
    first, _ = one.reset(seed=1)
    second, _ = again.reset(seed=1)
    assert repr(first) == repr(second)


@pytest.mark.parametrize(
    "keywords", [{"render_mode": "vr"}, {"transport": "pigeon"}, {"system": "hexx"}]
)
def test_bad_arguments_are_refused(keywords: dict[str, Any]) -> None:
    """An unknown render mode, transport or system is named."""
    with pytest.raises(InputError, match="expected"):
        parallel_env(**keywords)


def test_step_before_reset_is_refused() -> None:
    """Stepping before the first reset says what to do."""
    with pytest.raises(InputError, match="call reset first"):
        parallel_env("hex").step({})
