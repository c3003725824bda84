"""Learning with Stable-Baselines3: rows are the agents of PettingZoo, what is learned is a rule.

These take the extra ``learning``; without it none of them is collected. `.ci/run` has it.
"""

from __future__ import annotations

import contextlib
import doctest
import importlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cubepath.agents import (
    check_rule,
    parallel_env,
    play,
    play_many,
    sb3_env,
    sb3_rule,
    sb3_save,
    vector_env,
)
from cubepath.agents.local.relative import relative_layout
from cubepath.agents.rules.policy import read_network
from cubepath.coordinator import run
from cubepath.protocol import InputError, scene_from_spec
from pasted import blocks
from processes.command_line import ROOT, cubepath

sb3_contrib = pytest.importorskip("sb3_contrib")
torch = pytest.importorskip("torch")
pytestmark = [pytest.mark.thorough, pytest.mark.filterwarnings("ignore::DeprecationWarning")]

SPEC = "agv:graph=grid4x4,n=2"
CYCLES = 40


def test_the_example_holds() -> None:
    """Of the docstring, which `tests/test_examples.py` leaves out."""
    name = sb3_env.__module__
    known = {"sb3_env": sb3_env, "sb3_rule": sb3_rule}
    assert doctest.testmod(importlib.import_module(name), extraglobs=known) == (0, 4)


def legal(masks: Any, random: np.random.Generator) -> Any:
    """Return a legal action for each row."""
    return np.where(masks, random.random(masks.shape), -1).argmax(axis=1)


@pytest.mark.parametrize("showing", ["relative", "absolute"])
@pytest.mark.parametrize("spec", ["agv:graph=C4,n=2", "hex:n=3"])
def test_rows_are_the_agents_of_pettingzoo(spec: str, showing: Any) -> None:
    """With what each is given, over several episodes."""
    env = sb3_env(spec, num_envs=2, max_cycles=6, observation=showing)
    twins = [parallel_env(spec, max_cycles=6, observation=showing) for _ in range(2)]
    env.seed(7)
    rows: Any = env.reset()
    seen = [twin.reset(seed=7 + n)[0] for n, twin in enumerate(twins)]
    random, modules, ends = np.random.default_rng(0), len(twins[0].agents), 0
    names = twins[0].possible_agents
    try:
        for _ in range(20):
            expected = np.array([[each[name]["observation"] for name in names] for each in seen])
            np.testing.assert_array_equal(rows, expected.reshape(len(rows), -1))
            assert rows.dtype == env.observation_space.dtype
            masks = np.array([[each[name]["action_mask"] for name in names] for each in seen])
            np.testing.assert_array_equal(env.action_masks(), masks.reshape(len(rows), -1) != 0)
            actions = legal(env.action_masks(), random)
            before = rows.copy(), rows
            rows, rewards, dones, infos = env.step(actions)
            np.testing.assert_array_equal(*before)  # what was given stays as it was
            assert rewards.dtype == np.float32
            for number, twin in enumerate(twins):
                block = slice(number * modules, (number + 1) * modules)
                told = dict(zip(names, actions[block].tolist(), strict=True))
                seen[number], reward, done, late, _ = twin.step(told)
                assert rewards[block].tolist() == np.array([*reward.values()], np.float32).tolist()
                assert dones[block].tolist() == [done[names[0]] or late[names[0]]] * modules
                if not dones[block].any():
                    assert infos[block] == [{}] * modules
                    continue
                ends += 1
                for row, name in enumerate(names, block.start):
                    last = seen[number][name]["observation"]
                    np.testing.assert_array_equal(infos[row]["terminal_observation"], last)
                    assert infos[row]["TimeLimit.truncated"] == late[name]
                    assert infos[row]["is_success"] == done[name]
                seed = env.reset_infos[block.start]["seed"]
                seen[number], _ = twin.reset(seed=seed)
    finally:
        env.close()
    assert ends > 3


def test_episodes_have_the_seeds_of_vector_env() -> None:
    """The first and the later ones; without a seed they go on."""
    env = sb3_env("agv:graph=C4,n=2", num_envs=3, max_cycles=2)
    twin = vector_env("agv:graph=C4,n=2", num_envs=3, max_cycles=2)
    env.seed(5)
    env.reset()
    _, infos = twin.reset(seed=5)
    found, expected = [], [infos["seed"].tolist()]
    for _ in range(3):
        found.append([env.reset_infos[row]["seed"] for row in range(0, 6, 2)])
        for _ in range(2):
            env.step(np.zeros(6, np.int64))
        for _ in range(3):  # one round of these begins the next episode
            *_, infos = twin.step(np.zeros((3, 2), np.int64))
        expected.append(infos["seed"].tolist())
    assert found == expected[:3]


def test_progress_is_rewarded_by_module() -> None:
    """A move that is made counts by the entry ``nearer`` of its slot; nothing else does."""
    spec = "agv-labelled:graph=grid3x3,n=4,seed=2"
    env, plain = (sb3_env(spec, num_envs=8, max_cycles=5, progress=each) for each in (0.5, 0.0))
    before: Any = env.reset()
    plain.reset()
    nearer = relative_layout(scene_from_spec(spec).system).parts["nearer"]
    random, gained = np.random.default_rng(0), set[float]()
    for _ in range(20):
        actions: Any = random.integers(0, 5, env.num_envs)  # some of them are not legal
        rows: Any
        rows, rewards, over, infos = env.step(actions)
        _, shared, *_ = plain.step(actions)
        after = rows.copy()
        for row in np.flatnonzero(over).tolist():
            after[row] = infos[row]["terminal_observation"]
        for row, action in enumerate(actions.tolist()):
            way = slice(1, nearer.start)
            moved = bool((after[row, way] != before[row, way]).any())
            expected = 0.5 * before[row, nearer][action - 1] if moved else 0.0
            assert rewards[row] == np.float32(shared[row] + np.float32(expected))
            gained.add(float(expected))
        before = rows
    assert gained == {-0.5, 0.0, 0.5}


def test_it_is_what_the_library_takes() -> None:
    """Wrappers, masks and evaluation of the library go through it."""
    evaluation = importlib.import_module("sb3_contrib.common.maskable.evaluation")
    masking = importlib.import_module("sb3_contrib.common.maskable.utils")
    wrappers = importlib.import_module("stable_baselines3.common.vec_env")
    checked = wrappers.VecCheckNan(sb3_env(SPEC, num_envs=3, max_cycles=5), raise_exception=True)
    env: Any = wrappers.VecMonitor(checked)
    assert masking.is_masking_supported(env)
    env.reset()
    masks = masking.get_action_masks(env)
    assert masks.shape == (6, env.action_space.n)
    assert masks.dtype == np.bool_
    random = np.random.default_rng(1)
    for _ in range(4):
        env.step(legal(masking.get_action_masks(env), random))
    _, rewards, dones, infos = env.step(legal(masking.get_action_masks(env), random))
    assert dones.all()
    assert {info["episode"]["l"] for info in infos} == {5}
    assert np.isfinite(rewards).all()
    model = sb3_contrib.MaskablePPO("MlpPolicy", env, n_steps=8, batch_size=16, seed=0)
    mean: Any
    mean, _ = evaluation.evaluate_policy(model, env, n_eval_episodes=6, warn=False)
    assert -1 <= mean <= 1
    with pytest.raises(AttributeError, match="a module has no attribute 'goal'"):
        env.unwrapped.get_attr("goal")
    with pytest.raises(AttributeError, match="to be set"):
        env.unwrapped.set_attr("goal", 1)


def test_what_is_wrong_is_one_line(tmp_path: Path) -> None:
    """With what was found and what was expected."""
    env = sb3_env(SPEC)
    odd = {"policy_kwargs": {"activation_fn": torch.nn.ELU}, "n_steps": 8, "batch_size": 8}
    bad = sb3_contrib.MaskablePPO("MlpPolicy", env, **odd)
    good = sb3_contrib.MaskablePPO("MlpPolicy", env, n_steps=8, batch_size=8)
    (tmp_path / "there.npz").touch()
    for wrong, why in (
        (lambda: sb3_env(SPEC, num_envs=0), "num_envs=0: expected 1 or more"),
        (lambda: sb3_env(SPEC, observation="odd"), "observation='odd': expected"),  # type: ignore[arg-type]
        (lambda: sb3_env("hex:n=2", progress=1), "progress=1: expected relative observations"),
        (lambda: env.step(np.zeros(2)), "the environments have not been reset yet"),
        (lambda: env.seed(-1), "seed=-1: expected 0 or more"),
        (lambda: sb3_rule("bad", bad), "the policy has a part ELU, expected Linear, Tanh and"),
        (lambda: sb3_save(good, "model.zip"), "model.zip: expected a name that ends in .npz"),
        (lambda: sb3_save(good, tmp_path / "there.npz"), f"{tmp_path}/there.npz: exists already"),
    ):
        with pytest.raises(InputError) as error:
            wrong()
        (line,) = str(error.value).splitlines()
        assert line.startswith(why)


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Learn to lead vehicles to their goals, as the page shows it; return the file."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    (block,) = [
        block
        for block in blocks(ROOT / "docs" / "policies.md")
        if block.text.startswith("from sb3_contrib import MaskablePPO\n")
    ]
    folder = tmp_path_factory.mktemp("model")
    names: dict[str, Any] = {}
    with contextlib.chdir(folder):
        exec(block.text, names)  # noqa: S102 - our own documentation
    path: Path = folder / "learned.npz"
    names["model"].save(path.with_suffix(".zip"))
    yield path
    torch.set_num_threads(threads)


def test_what_is_learned_is_better_than_chance(learned: Path) -> None:
    """In a hundred runs each: more of them reach the goal, in fewer rounds."""
    seeds = range(100)
    chance = play_many(SPEC, "random", seeds, max_rounds=CYCLES)
    assert chance.reached.mean() < 0.3
    for deterministic in (False, True):
        rule = sb3_rule("learned", learned, deterministic=deterministic)
        runs = play_many(SPEC, rule, seeds, max_rounds=CYCLES)
        assert runs.reached.mean() > 0.95
        assert runs.rounds.mean() < chance.rounds.mean() / 2


def test_it_goes_on_learning(learned: Path) -> None:
    """A model may be trained further in other environments."""
    env = sb3_env(SPEC, max_cycles=10)
    try:
        model = sb3_contrib.MaskablePPO.load(
            learned.with_suffix(".zip"), env=env, n_steps=16, batch_size=32
        )
        before = model.num_timesteps
        model.learn(64, reset_num_timesteps=False)
        assert model.num_timesteps >= before + 64
    finally:
        env.close()


def test_it_decides_as_the_library_does(learned: Path) -> None:
    """The same probabilities as torch has them, up to rounding, for anything that may be seen."""
    model = sb3_contrib.MaskablePPO.load(learned.with_suffix(".zip"))
    random = np.random.default_rng(0)
    rows = random.uniform(-1, 1, (200, *model.observation_space.shape)).astype(np.float32)
    with torch.no_grad():
        seen, _ = model.policy.obs_to_tensor(rows)
        theirs = model.policy.get_distribution(seen).distribution.probs.numpy()
    found = np.exp(read_network(learned).logits(rows))
    np.testing.assert_allclose(found / found.sum(axis=1, keepdims=True), theirs, atol=1e-5)


FILE = """
from pathlib import Path

from cubepath.agents import sb3_rule

LEARNED = sb3_rule("learned", Path(__file__).with_name("learned.npz"))
"""


def test_it_runs_on_the_wire_and_is_local(learned: Path) -> None:
    """In two processes, with the moves that it makes here; and it passes check-rule."""
    file = learned.with_name("learned.py")
    file.write_text(FILE)
    name = f"{file}:LEARNED"
    outcome = run(SPEC, name, seed=3, processes=2, log=learned.with_name("learned.mcap"))
    assert outcome.goal_reached
    played = play(SPEC, sb3_rule("learned", learned), seed=3)
    assert list(outcome.path) == list(played.path)
    assert outcome.rounds == len(played.rounds)
    assert check_rule(name, ["agv:graph=grid3x3,n=2"]).findings == ()
    done = cubepath("run", "hex:n=3", "--rule", name, "--processes", "0", "--json")
    assert done.returncode == 2
    assert "not for this system: rule" in done.stderr
    assert not done.stdout
    again = cubepath("run", SPEC, "--rule", name, "--seed", "3", "--json", cwd=file.parent)
    assert json.loads(again.stdout)["path_digest"] == outcome.path_digest
