"""The environment in compiled code gives what the plain one gives, and takes over from it."""

import os
import pickle
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test

from cubepath.agents.arrays import batch
from cubepath.agents.environments import environment
from cubepath.agents.environments.array_world import ArrayWorld
from cubepath.agents.environments.environment import CubepathEnv
from cubepath.agents.environments.free_environment import parallel_env
from cubepath.agents.environments.world import World
from cubepath.protocol.compiled import Allowance
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.systems.graph import GraphSystem
from samples.space import SPACE
from samples.strategies import SCENES


def actions_of(env: CubepathEnv, seen: Mapping[str, Any], random: np.random.Generator) -> Any:
    """Return an action for most agents: legal ones, wrong ones, None, and numpy's integers."""
    found: dict[str, Any] = {}
    for name in env.agents:
        legal = np.flatnonzero(seen[name]["action_mask"])
        kind = random.integers(20)
        if kind < 16:
            found[name] = int(random.choice(legal))
        elif kind < 19:
            found[name] = (None, np.int8(random.choice(legal)), 10**30)[kind - 16]
    return found


def plain(value: Any) -> Any:
    """Return nested dicts with lists for arrays, as they are now."""
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    return value.tolist() if isinstance(value, np.ndarray) else value


@pytest.mark.few(7)
@pytest.mark.parametrize("spec", ["hex:n=4", "agv-labelled", "assembly:n=3", *SPACE])
@pytest.mark.parametrize("copy", [True, False])
def test_everything_that_is_returned_is_the_same(spec: str, *, copy: bool) -> None:
    """Over several episodes, with notes, for wrong actions and missing agents."""
    one = parallel_env(spec, max_cycles=25, note_length=2, world="plain")
    other = parallel_env(spec, max_cycles=25, note_length=2, world="compiled", copy=copy)
    random = np.random.default_rng(0)
    for seed in range(3):
        seen, infos = one.reset(seed=seed)
        assert plain((seen, infos)[0]) == plain(other.reset(seed=seed)[0])
        while one.agents:
            actions = actions_of(one, seen, random)
            notes = {name: (seed, 7) for name in one.agents if random.random() < 0.3}
            found = one.step(actions, notes)
            same = other.step(actions, notes)
            assert [plain(each) for each in found] == [plain(each) for each in same]
            assert one.agents == other.agents
            assert one.last_round == other.last_round
            assert one.sites == other.sites
            assert one.state().tolist() == other.state().tolist()
            assert np.dtype(one.state().dtype) == other.state().dtype
            seen = found[0]


def test_the_same_when_places_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    """Relative observations, and the moves of a round that is asked for later."""
    monkeypatch.setattr(batch, "PLACES_MAX", 4)
    monkeypatch.setattr(batch, "PLACES_GROWTH", 0)
    test_relative_observations_are_the_same_to_the_last_bit("hex-open:n=4", copy=False)
    test_everything_that_is_returned_is_the_same("hex:n=4", copy=True)


@pytest.mark.few(8)
@pytest.mark.parametrize(
    ("spec", "copy"), [*((spec, True) for spec in SCENES), ("agv-labelled", False)]
)
def test_relative_observations_are_the_same_to_the_last_bit(spec: str, *, copy: bool) -> None:
    """For every family, whether modules have goals of their own, common ones or none."""
    one = parallel_env(spec, observation="relative", world="plain")
    other = parallel_env(spec, observation="relative", world="compiled", copy=copy)
    random = np.random.default_rng(0)
    seen, _ = one.reset(seed=2)
    same, _ = other.reset(seed=2)
    for _ in range(6):
        assert plain(seen) == plain(same)
        assert other.observation_space("module_0").contains(same["module_0"])
        actions = actions_of(one, seen, random)
        seen, same = one.step(actions)[0], other.step(actions)[0]


def test_dicts_that_are_kept_are_the_same_each_time() -> None:
    """And hold what is true now; others are left as they were given."""
    kept, fresh = (
        parallel_env("agv:graph=P3,n=1", world="compiled", copy=copy) for copy in (False, True)
    )
    for env, same in ((kept, True), (fresh, False)):
        first, _ = env.reset(seed=0)
        before = plain(first)
        second, *_ = env.step({"module_0": 1})
        assert (first is second) == same
        assert (plain(first) == before) != same
        assert plain(second) != before


def test_actions_are_held_against_what_is_legal_whoever_wrote_into_the_mask() -> None:
    """The arrays that are shown are not read back."""
    env = parallel_env("hex:n=4", world="compiled", copy=False)
    seen, _ = env.reset(seed=0)
    illegal = int(np.flatnonzero(seen["module_0"]["action_mask"] == 0)[0])
    seen["module_0"]["action_mask"][:] = 1
    *_, infos = env.step({"module_0": illegal})
    assert infos["module_0"]["illegal"]
    assert not env.step({})[4]["module_0"]["illegal"]


def test_the_interface_is_that_of_pettingzoo() -> None:
    """As its own test has it; and the environment can be pickled."""
    env = parallel_env("hex:n=3", world="compiled")
    parallel_api_test(env, num_cycles=30)
    copied = pickle.loads(pickle.dumps(env))  # noqa: S301 - our own
    assert plain(copied.reset(seed=3)[0]) == plain(env.reset(seed=3)[0])
    assert isinstance(copied.world, ArrayWorld)


@pytest.fixture
def small_allowance(monkeypatch: pytest.MonkeyPatch) -> Allowance:
    """Return the allowance for plain Python, which ends after 40 agent-steps."""
    found = Allowance(40 * 25)
    monkeypatch.setattr(batch, "allowance", found)
    return found


@pytest.mark.usefixtures("small_allowance")
def test_compiled_code_goes_on_where_plain_python_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """As soon as it is ready, in the middle of an episode, and nobody can tell."""
    ready = [False]
    monkeypatch.setattr(batch, "_compiler", type("Later", (), {"ready": lambda _: ready[0]})())
    one = parallel_env("agv:graph=grid3x3,n=4", note_length=1, world="plain")
    other = parallel_env("agv:graph=grid3x3,n=4", note_length=1)
    random = np.random.default_rng(1)
    seen, _ = one.reset(seed=5)
    other.reset(seed=5)
    for step in range(40):
        ready[0] = step > 20
        actions = actions_of(one, seen, random)
        notes = {"module_1": (step,)} if step % 7 == 0 else {}
        seen, *rest = one.step(actions, notes)
        assert [plain(each) for each in (seen, *rest)] == [
            plain(each) for each in other.step(actions, notes)
        ]
        assert isinstance(other.world, ArrayWorld if step > 20 else World)


FIRST_CONTACT = """
import time

from cubepath.agents import parallel_env
from cubepath.agents.environments.array_world import ArrayWorld

env = parallel_env("hex:n=50", max_cycles=10**9)
env.reset(seed=0)
plain = 0
while not isinstance(env.world, ArrayWorld):
    env.step({name: 1 for name in env.agents})
    plain += 1
    time.sleep(0.02)  # leaves the processor to the compiler, which is nicer than this
print(plain, env.world.round)
"""


@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_the_plain_world_serves_until_everything_is_compiled(tmp_path: Path) -> None:
    """Where nothing was compiled before, it plays on while a process of its own compiles."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    steps = []
    for _ in range(2):
        found = subprocess.run(
            [sys.executable, "-c", FIRST_CONTACT],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        plain_steps, rounds = map(int, found.stdout.split())
        assert plain_steps == rounds
        steps.append(plain_steps)
    # The first went on for as long as the compiler took; the second has what was kept.
    assert steps[0] > steps[1]


class Blind(GraphSystem):
    """Vehicles that do not sense all that their moves read: it fits into no table."""

    def sensed(self, place: Site) -> tuple[Site | None, ...]:
        return (*super().sensed(place)[1:], None)

    def pattern(self, site: Site) -> None:
        del site


@pytest.mark.usefixtures("small_allowance")
def test_a_system_that_fits_into_no_table_stays_in_the_plain_world() -> None:
    """Unless the compiled one is asked for, which is refused in a line."""
    scene = Scene("blind", "", Blind([0, 1], [(0, 1)]), (0,))
    env = parallel_env(scene)
    env.reset(seed=0)
    for _ in range(100):
        env.step({})
    assert isinstance(env.world, World)
    with pytest.raises(InputError, match=r"blind: world='compiled': .* does not sense"):
        parallel_env(scene, world="compiled").reset(seed=0)


def test_worlds_that_there_are_not() -> None:
    """They are named."""
    with pytest.raises(InputError, match="world='fast': expected one of auto, plain, compiled"):
        parallel_env("hex:n=2", world="fast")
    assert set(environment.WORLDS) == {"auto", "plain", "compiled"}
