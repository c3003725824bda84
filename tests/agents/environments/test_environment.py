"""The PettingZoo environments keep PettingZoo's contract, for every system."""

import gc
import pickle
import subprocess
import sys
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
from cubepath.agents import env, parallel_env
from cubepath.agents.environments.environment import CubepathEnv
from cubepath.agents.environments.wire_world import WireWorld
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.systems.graph import GraphSystem
from samples.local_families import LOCAL_FAMILIES

SPECS = [
    *LOCAL_FAMILIES,
    "agv:graph=K5,n=3",
    "agv-labelled:graph=C5,n=2",
    "arm:n=1",
    "hex:n=3,bend=0",
]


@pytest.fixture(autouse=True)
def _accept_advice() -> Any:
    # PettingZoo's tests warn where an observation is not one flat array; a mask makes it a dict.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        yield


@pytest.mark.few(4)
@pytest.mark.parametrize("spec", SPECS)
def test_api(spec: str) -> None:
    """PettingZoo's api_test passes on the environment in turns."""
    api_test(env(spec, max_cycles=30), num_cycles=60)


@pytest.mark.few(8)
@pytest.mark.parametrize("spec", SPECS)
def test_parallel_api(spec: str) -> None:
    """PettingZoo's parallel_api_test passes."""
    parallel_api_test(parallel_env(spec, max_cycles=30), num_cycles=60)


@pytest.mark.few(4)
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


@pytest.mark.few(3)
@pytest.mark.slow
@pytest.mark.parametrize("spec", [*LOCAL_FAMILIES, "agv:graph=K5,n=3"])
def test_render(spec: str, capsys: pytest.CaptureFixture[str]) -> None:
    """PettingZoo's render_test passes for human, ansi and rgb_array."""
    make: Any = partial(env, spec)  # the environment is PettingZoo's; its own hint says gymnasium's
    render_test(make)
    assert capsys.readouterr().out.strip()


@pytest.mark.few(4)
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


@pytest.mark.parametrize("transport", ["local", "zenoh"])
def test_too_many_moves_to_list_are_refused_at_once(transport: Any) -> None:
    """When the environment is made, not at its first reset; no process has started."""
    with pytest.raises(InputError, match="301 points have too many flips to list them all"):
        parallel_env("triangulation:n=301", transport=transport)


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
    rewards: list[float] = []
    done: dict[str, bool] = {}
    for action in (1, 2, 2):
        _, reward, done, late, _ = one.step({"module_0": action})
        rewards.append(reward["module_0"])
    assert rewards == [0.0, 0.0, 1.0]
    assert done == {"module_0": True}
    assert late == {"module_0": False}
    assert one.agents == []


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


@pytest.mark.slow
@pytest.mark.parametrize("transport", ["local", "zenoh"])
def test_actions_out_of_range_are_stay(transport: Any) -> None:
    """Negative and too great actions are illegal and change nothing, on the wire as well."""
    one = parallel_env("hex:n=3", transport=transport, processes=0)
    seed: Any = np.int64(1)  # numpy's numbers do as well as Python's
    negative: Any = np.int64(-2)
    try:
        one.reset(seed=seed)
        before = one.state()
        for action in (-1, -5, 13, 10**6):
            _, _, _, _, infos = one.step({"module_0": action, "module_2": negative})
            assert (one.state() == before).all()
            assert infos["module_0"]["illegal"]
            assert infos["module_2"]["illegal"]
    finally:
        one.close()


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"actions": {"module_9": 1}}, "'module_9' is no agent"),
        ({"actions": {}, "notes": {"module_0": (1,)}}, "a note of 1 numbers, expected 2"),
        ({"actions": {}, "notes": {"module_0": (1, 2**31)}}, "a note with 2147483648"),
        ({"actions": {}, "notes": {"module_0": (1, -(2**31))}}, "a note with -2147483648"),
    ],
)
def test_what_cannot_be_stepped_is_refused(keywords: dict[str, Any], message: str) -> None:
    """Unknown agents and notes that do not fit are named, before anything has changed."""
    one = CubepathEnv("hex:n=3", note_length=2)
    one.reset(seed=0)
    with pytest.raises(InputError, match=message):
        one.step(**keywords)
    assert one.world.round == 0


def test_stepping_after_the_end_changes_nothing() -> None:
    """When all agents are done, a step returns nothing and plays no round."""
    one = CubepathEnv("hex:n=3", max_cycles=1)
    one.reset(seed=0)
    one.step({})
    assert one.step({"module_0": 1}) == ({}, {}, {}, {}, {})
    assert one.world.round == 1


@pytest.mark.thorough
def test_an_interrupted_step_does_not_reach_into_the_next_episode(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """After an exception in the middle of a step, reset begins as if nothing had been."""
    here = parallel_env("hex:n=4")
    there = parallel_env("hex:n=4", transport="zenoh", processes=2)

    def interrupted(_: object) -> None:
        raise KeyboardInterrupt

    try:
        there.reset(seed=1)
        world = there.world
        assert isinstance(world, WireWorld)
        monkeypatch.setattr(world._running(), "act", interrupted)
        with pytest.raises(KeyboardInterrupt):
            there.step({})
        first, _ = here.reset(seed=2)
        again, _ = there.reset(seed=2)
        assert repr(again) == repr(first)
        actions = {name: int(seen["action_mask"].nonzero()[0][-1]) for name, seen in first.items()}
        assert repr(here.step(actions)) == repr(there.step(actions))
    finally:
        there.close()


@pytest.mark.slow
def test_a_dropped_environment_ends_its_processes() -> None:
    """Without close, collecting the environment ends its module processes."""
    one = parallel_env("hex:n=3", transport="zenoh", processes=2)
    one.reset(seed=0)
    world = one.world
    assert isinstance(world, WireWorld)
    children = list(world._running()._children.by_name.values())
    del one, world
    gc.collect()
    assert [child.returncode for child in children] == [0, 0]


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("processes", [0, 2])
def test_a_script_that_forgets_to_close_ends_well(processes: int) -> None:
    """The interpreter exits with 0 and leaves nothing behind."""
    code = (
        "from cubepath.agents import parallel_env\n"
        f"e = parallel_env('hex:n=4', transport='zenoh', processes={processes})\n"
        "e.reset(); e.step({})\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
