"""The environment without rounds: PettingZoo's contract, who acts when, and what is seen late."""

from functools import partial
from itertools import groupby
from typing import Any

import numpy as np
import pytest
from pettingzoo.test import api_test, seed_test

from cubepath.agents import Choice, env
from cubepath.agents.environments.environment import CubepathEnv
from cubepath.agents.environments.free_environment import FreeEnv, UnfairOrder, scheduler_named
from cubepath.agents.environments.free_world import FreeWorld
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.specs import scene_from_spec
from samples.space import SPACE

pytestmark = pytest.mark.filterwarnings(
    "ignore:Observation:UserWarning", "ignore:.*observation:UserWarning"
)

PATH = "agv:graph=P7,n=3"


def free(spec: str = PATH, **arguments: Any) -> FreeEnv:
    """Return an environment without wrappers, reset."""
    found = env(spec, clock="free", **arguments).unwrapped
    assert isinstance(found, FreeEnv)
    found.reset(seed=1)
    return found


@pytest.mark.few(4)
@pytest.mark.slow
@pytest.mark.parametrize("scheduler", ["random", "unfair", "turns"])
@pytest.mark.parametrize("spec", ["hex:n=4", "agv-labelled:graph=K5,n=3", "sliding", *SPACE])
def test_api(spec: str, scheduler: str) -> None:
    """PettingZoo's api_test passes, with notes and late views and without."""
    make = partial(env, spec, clock="free", scheduler=scheduler, max_cycles=20)
    api_test(make(), num_cycles=100)
    api_test(make(note_length=2, lag=3), num_cycles=100)


@pytest.mark.slow
def test_seeds() -> None:
    """PettingZoo's seed test passes."""
    seed_test(partial(env, "hex:n=4", clock="free", max_cycles=20, lag=2), num_cycles=60)


def trace(seed: int, **arguments: Any) -> list[tuple[object, ...]]:
    """Return who acted and what came of it, where all take their last legal action."""
    found = free("hex-open:n=5", max_cycles=30, **arguments)
    found.reset(seed=seed)
    happened: list[tuple[object, ...]] = []
    while not any(found.truncations.values()):
        name = found.agent_selection
        action = int(found.observe(name)["action_mask"].nonzero()[0][-1])
        found.step(action)
        happened.append((name, action, found.infos[name]["committed"], tuple(found.sites)))
    return happened


@pytest.mark.parametrize("scheduler", ["random", "unfair", "turns"])
def test_what_is_attempted_follows_from_seed_and_actions(scheduler: str) -> None:
    """Twice the same with a seed; another seed is another run, where anything is drawn."""
    one = trace(4, scheduler=scheduler, lag=2)
    assert one == trace(4, scheduler=scheduler, lag=2)
    assert one != trace(5, scheduler=scheduler, lag=2)


def test_to_observe_more_often_changes_nothing() -> None:
    """What the selected agent was shown stays as it is until it has acted."""
    found = free("hex-open:n=5", lag=5, note_length=1)
    for _ in range(40):
        name = found.agent_selection
        seen = found.observe(name)
        for other in found.agents:
            found.observe(other)
        again = found.observe(name)
        assert all(np.array_equal(seen[key], again[key]) for key in seen)
        again["observation"][:] = -1
        assert (found.observe(name)["observation"] == seen["observation"]).all()
        found.act(Choice(int(seen["action_mask"].nonzero()[0][-1]), (found.world.turns,)))


def test_a_step_is_committed_at_once_and_says_so() -> None:
    """The module stands at its target, and the infos tell; a number that is no action stays."""
    found = free(scheduler="turns")
    start = list(found.sites)
    name = found.agent_selection
    action = int(found.observe(name)["action_mask"].nonzero()[0][-1])
    found.step(action)
    assert found.infos[name]["committed"] is (action != 0)
    assert (list(found.sites) != start) is (action != 0)
    other = found.agent_selection
    found.step(99)
    assert found.infos[other]["illegal"]
    assert not found.infos[other]["committed"]


def test_a_note_is_a_register_that_others_hear_and_exchange() -> None:
    """Both contents go at one instant, and each hears of it in its next turn."""
    found = free("agv:graph=P7,n=3", scheduler="turns", note_length=1)
    system = found.scene.system
    near = {
        (one, other)
        for one, site in enumerate(found.sites)
        for other, there in enumerate(found.sites)
        if there in system.reach(site)
    }
    one, other = min(near)
    for module in range(3):
        assert found.agent_selection == f"module_{module}"
        found.act(Choice(note=(10 + module,)))
    while found.agent_selection != f"module_{one}":
        found.step(0)
    assert found.observe(f"module_{one}")["register"].tolist() == [10 + one]
    done = found.act(Choice(note=(10 + other,), exchanges={found.sites[other]: (10 + one,)}))
    assert done.moved is not None
    while found.agent_selection != f"module_{other}":
        found.step(0)
    assert found.observe(f"module_{other}")["register"].tolist() == [10 + one]


def test_who_sees_late_fails_at_the_commit() -> None:
    """And says why; without a lag nothing is ever refused."""
    refused = {}
    for lag in (0, 5):
        found = free("hex-open:n=6", lag=lag, max_cycles=80)
        whys = []
        while not any(found.truncations.values()):
            name = found.agent_selection
            legal = found.observe(name)["action_mask"].nonzero()[0]
            found.step(int(legal[found.world.turns % len(legal)]))
            whys.append(found.infos[name]["refused"])
        refused[lag] = [why for why in whys if why is not None]
    assert refused[0] == []
    assert refused[5]
    assert all("was sensed" in why for why in refused[5])


def test_views_are_no_older_than_the_lag_and_never_go_back() -> None:
    """What a module is shown of a place was there at most so many commits ago."""
    scene = scene_from_spec("agv:graph=P7,n=3")
    lag = 3
    world = FreeWorld(scene, seed=2, note_length=1, lag=lag)
    heard: dict[tuple[int, object], int] = {}
    for turn in range(200):
        module = turn % 3
        world.look(module)
        world.act(module, Choice(note=(world.commits,)))  # commit number, less one
        seen = world._modules[module].seen
        assert seen is not None
        for place, (number,) in seen.notes.items():
            assert number >= heard.get((module, place), -1)
            heard[module, place] = number
            newest = world._notes[place][0]
            assert newest - number <= 3 * (lag + 1)
    assert heard


def test_a_module_that_starts_again_is_in_a_new_epoch() -> None:
    """It stands where it stood, its register holds, and it may act."""
    world = FreeWorld(scene_from_spec("agv:graph=P7,n=3"), seed=0, note_length=1)
    world.look(1)
    world.act(1, Choice(note=(7,)))
    world.restart(1)
    assert world.look(1)["register"].tolist() == [7]
    again = world.act(1, Choice(note=(8,)))
    assert again.moved is not None
    assert (again.moved.epoch, again.moved.number) == (1, 1)


def test_the_episode_ends_at_the_goal_for_all() -> None:
    """With the share of goals as reward, as with rounds."""
    found = free("arm:n=1", scheduler="turns")
    total = 0.0
    while not any(found.terminations.values()):
        seen = found.observe("module_0")
        found.step(int(seen["action_mask"].nonzero()[0][-1]))
        total += found.rewards["module_0"]
    assert total == 1.0
    assert not any(found.truncations.values())


@pytest.mark.parametrize("mode", ["ansi", "rgb_array"])
def test_it_draws_as_with_rounds(mode: str) -> None:
    """The same picture of the same sites; the state alike."""
    one, other = free("hex:n=4", render_mode=mode), env("hex:n=4", render_mode=mode)
    other.reset(seed=1)
    rounds = CubepathEnv("hex:n=4", render_mode=mode)
    rounds.reset(seed=1)
    assert np.array_equal(np.asarray(one.render()), np.asarray(rounds.render()))
    assert np.array_equal(one.state(), rounds.state())
    assert one.state_space == rounds.state_space


def test_schedulers_let_everybody_act() -> None:
    """A slow module so much more rarely; an unfair scheduler after a while, whatever comes."""
    slow = scheduler_named("random", modules=3, seed=0, speeds={1: 100}, jitter=0.5)
    acts = [slow.next(committed=True) for _ in range(20000)]
    assert 60 <= acts.count(0) / acts.count(1) <= 150
    for committed in (False, True):
        unfair = UnfairOrder(4)
        acts = [unfair.next(committed=committed) for _ in range(2000)]
        assert {acts.count(module) > 0 for module in range(4)} == {True}
    bursts = [len(list(same)) for _, same in groupby(acts)]
    assert sum(bursts) / len(bursts) > 20


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"clock": "wall"}, "clock='wall': expected 'lockstep' or 'free'"),
        ({"lag": 2}, "lag=2: expected clock='free'"),
        ({"clock": "free", "scheduler": "fair"}, "scheduler='fair': expected 'random', 'unfair'"),
        ({"clock": "free", "lag": -1}, "lag=-1: expected 0 or more"),
        ({"clock": "free", "jitter": 2}, "jitter=2: expected 0 to 1"),
        ({"clock": "free", "speeds": {9: 2}}, "speeds: module 9 with 2, expected modules 0 to 2"),
        ({"clock": "free", "speeds": {0: 0}}, "speeds: module 0 with 0"),
        ({"clock": "free", "scheduler": "turns", "speeds": {0: 2}}, "expected scheduler='random'"),
        ({"clock": "free", "render_mode": "film"}, "render_mode='film'"),
    ],
)
def test_what_is_wrong_is_one_line(arguments: dict[str, Any], message: str) -> None:
    """Before anything begins."""
    with pytest.raises(InputError, match=message):
        env(PATH, **arguments)


def test_a_step_before_reset_is_one_line() -> None:
    """As with rounds; so is a negative seed."""
    with pytest.raises(InputError, match="call reset first"):
        FreeEnv(PATH).observe("module_0")
    with pytest.raises(InputError, match="seed=-1"):
        FreeEnv(PATH).reset(seed=-1)


def test_one_can_pickle_it() -> None:
    """Wrappers do; the copy has the same arguments."""
    import pickle

    copy = pickle.loads(pickle.dumps(FreeEnv(PATH, lag=2, scheduler="unfair")))  # noqa: S301 - our own
    assert (copy.lag, copy._scheduling[0]) == (2, "unfair")
