"""Policies as rules: they are given what PettingZoo gives, alone and in batches, here and there."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cubepath.agents.environments.free_environment import parallel_env
from cubepath.agents.environments.rollouts import play, play_in_python, play_many
from cubepath.agents.local.relative import Showing
from cubepath.agents.locality.check import check_rule
from cubepath.agents.rules.policy import policy_rule
from cubepath.coordinator.runs.edge_path import PathDigest
from cubepath.protocol.core.errors import InputError, RuleError
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.messages import Executed
from marked import some
from oracles.plain_steps import COMPILED, PLAIN, plain_steps
from oracles.stacked import Side
from processes.command_line import here
from samples.local_families import LOCAL_FAMILIES

SHOWINGS: list[Showing] = ["absolute", "relative"]


def weighed(observation: Any, mask: Any) -> int:
    """Return an action that depends on every number that is seen."""
    numbers = np.asarray(observation, np.float64).ravel()
    legal = mask.nonzero()[0]
    place = np.abs(numbers * 64).astype(np.int64) @ np.arange(1, len(numbers) + 1)
    return int(legal[place % len(legal)])


def weighed_rows(observation: Any, mask: Any) -> list[int]:
    """Choose for each row."""
    return [weighed(*row) for row in zip(observation, mask, strict=True)]


def drawn_rows(observation: Any, mask: Any, draws: Any) -> Any:
    """Choose for each row, by what is seen there and a number drawn for it."""
    assert draws.shape == mask.shape[:1]
    assert draws.dtype == np.float64
    legal = mask * (1 + np.abs(observation).sum(axis=1, keepdims=True) % 3)
    return (legal.cumsum(axis=1) <= draws[:, None] * legal.sum(axis=1)[:, None]).sum(axis=1)


@pytest.mark.parametrize("showing", SHOWINGS)
@pytest.mark.parametrize("spec", ["hex:n=5", "agv-labelled:graph=grid3x3,n=4", "arm:n=4"])
def test_a_policy_is_given_what_the_environment_gives_an_agent(spec: str, showing: Showing) -> None:
    """The very arrays, in every round; and its actions make the run of the environment."""
    given: list[tuple[Any, Any]] = []

    def noting(observation: Any, mask: Any) -> int:
        given.append((observation.copy(), mask.copy()))
        observation[:] = 0
        mask[:] = 1  # what a policy writes there changes nothing
        return weighed(*given[-1])

    scene = scene_from_spec(spec)
    rule = policy_rule("noting", noting, observation=showing)
    played = play_in_python(scene, rule, seed=3, hesitate=0.0, max_rounds=8)
    env = parallel_env(scene, observation=showing)
    observations, _ = env.reset(seed=3)
    for done in played.rounds:
        actions = {}
        for name in env.agents:
            seen, mask = given.pop(0)
            for found, key in ((seen, "observation"), (mask, "action_mask")):
                expected = observations[name][key]
                assert found.dtype == expected.dtype
                np.testing.assert_array_equal(found, expected)
            actions[name] = weighed(seen, mask)
        observations, *_ = env.step(actions)
        assert env.last_round == done
    assert not given


@pytest.mark.slow
@pytest.mark.parametrize("left", [PLAIN, COMPILED])
@pytest.mark.parametrize("showing", SHOWINGS)
@pytest.mark.parametrize("spec", some(LOCAL_FAMILIES, ["agv-labelled", "words"]))
def test_rows_side_by_side_are_modules_by_themselves(
    spec: str, showing: Showing, left: int
) -> None:
    """With their own draws and without, in every family."""
    scene = scene_from_spec(spec)
    for policy, random in ((weighed_rows, False), (drawn_rows, True)):
        rule = policy_rule("rows", policy, observation=showing, batched=True, random=random)
        with plain_steps(left):
            assert Side(scene, rule, [2, 5, 2**70], 0.2 if random else 0.0).play(4)


@given(st.lists(st.integers(0, 2**64), min_size=1, max_size=4), st.sampled_from(SHOWINGS))
def test_many_runs_of_a_batched_policy_are_its_single_runs(
    seeds: list[int], showing: Showing
) -> None:
    """Whatever the seeds, also when some runs are over before others."""
    scene = scene_from_spec("agv:graph=C4,n=2")
    rule = policy_rule("drawn", drawn_rows, observation=showing, batched=True, random=True)
    many = play_many(scene, rule, seeds, max_rounds=6, keep_rounds=True)
    assert many.played is not None
    for number, seed in enumerate(seeds):
        alone = play_in_python(scene, rule, seed=seed, hesitate=0.0, max_rounds=6)
        assert many.played[number] == alone.rounds
        assert many.sites[number] == alone.sites


def test_a_policy_draws_from_the_stream_of_its_module() -> None:
    """What a rule would draw: of many modules each its own, the same from the same seed."""

    def drawn(_observation: Any, mask: Any, random: np.random.Generator) -> Any:
        return random.choice(mask.nonzero()[0])

    scene = scene_from_spec("hex:n=4")
    rule = policy_rule("drawn", drawn, random=True)
    runs = [play(scene, rule, seed=seed, max_rounds=9).sites for seed in (1, 1, 2, 3)]
    assert runs[0] == runs[1]
    assert len(set(runs)) > 1


WRONG: list[tuple[Callable[..., Any], str]] = [
    (lambda *_: 99, r"chose action 99, legal were \[0, 1\]"),
    (lambda *_: -1, r"chose action -1, legal were"),
    (lambda *_: 0.0, "the policy returned float64 of shape (), expected one integer"),
    (lambda *_: None, "the policy returned NoneType of shape (), expected one integer"),
    (lambda _, mask: mask[:2], "the policy returned int8 of shape (2,), expected one integer"),
    (lambda seen, _: seen["observation"], "IndexError: "),
    (lambda _: 0, "TypeError: "),
]


@pytest.mark.parametrize(("policy", "why"), WRONG)
def test_what_is_wrong_with_a_policy_is_one_line(policy: Callable[..., Any], why: str) -> None:
    """It names the rule and the module, as for any other rule."""
    rule = policy_rule("wrong", policy)
    with pytest.raises(RuleError) as error:
        play(scene_from_spec("agv:graph=P2,n=1"), rule, max_rounds=1)
    (line,) = str(error.value).splitlines()
    assert line.startswith("rule 'wrong', module_0: ")
    assert why.replace("\\", "") in line


@pytest.mark.parametrize(
    ("policy", "why"),
    [
        (lambda _, mask: mask, "the policy returned int8 of shape {mask}, expected"),
        (lambda _, mask: np.zeros(len(mask)), "the policy returned float64 of shape {rows}, expe"),
        (lambda _, mask: [99] * len(mask), "chose action 99, legal were [0, 1]"),
        (lambda _, mask: [2**32] * len(mask), "legal were [0, 1]"),
        (lambda _, mask: [-(2**40)] * len(mask), "legal were [0, 1]"),
    ],
)
def test_what_is_wrong_with_a_batch_is_one_line(policy: Callable[..., Any], why: str) -> None:
    """Alone and side by side: a number that does not fit is never taken for another."""
    rule = policy_rule("wrong", policy, batched=True)
    scene = scene_from_spec("agv:graph=P2,n=1")
    for seeds, who in (([0], "module_0"), ([0, 1, 2], "vectorised")):
        with pytest.raises(RuleError) as error:
            if who == "module_0":
                play_in_python(scene, rule, seed=0, hesitate=0.0, max_rounds=1)
            else:
                play_many(scene, rule, seeds, max_rounds=1)
        (line,) = str(error.value).splitlines()
        assert line.startswith(f"rule 'wrong', {who}")
        rows = len(seeds)
        assert why.format(rows=f"({rows},)", mask=f"({rows}, 2)") in line


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("none", None), "policy 'none': found NoneType, expected a function of an observation"),
        (("odd", weighed, "relatve"), "observation='relatve': expected 'absolute' or 'relative'"),
    ],
)
def test_what_is_no_policy_is_refused_at_once(arguments: Any, why: str) -> None:
    """When the rule is made, not when it is asked."""
    name, policy, *observation = arguments
    with pytest.raises(InputError) as error:
        policy_rule(name, policy, observation=(observation or ["absolute"])[0])
    assert str(error.value).startswith(why)


def test_a_rule_says_where_its_policy_comes_from() -> None:
    """By its docstring and its module, unless it is told."""
    rule = policy_rule("weighed", weighed)
    assert rule.summary == "Return an action that depends on every number that is seen"
    assert rule.source == weighed.__module__
    told = policy_rule("told", weighed, summary="a", source="b", fits=lambda _: False)
    assert (told.summary, told.source) == ("a", "b")
    assert not told.fits(scene_from_spec("hex").system)


FILE = """
import numpy as np

from cubepath.agents import policy_rule


def drawn(observation, action_mask, draws):
    legal = action_mask * (1 + np.abs(observation).sum(axis=1, keepdims=True) % 3)
    return (legal.cumsum(axis=1) <= draws[:, None] * legal.sum(axis=1)[:, None]).sum(axis=1)


DRAWN = policy_rule("drawn", drawn, observation="relative", batched=True, random=True)
"""


@pytest.mark.thorough
def test_a_policy_of_a_file_runs_on_the_wire_as_in_the_environment(tmp_path: Path) -> None:
    """In two processes, with the moves of `play`, and is found to be local."""
    file = tmp_path / "policies.py"
    file.write_text(FILE)
    spec = "agv:graph=grid3x3,n=3"
    options = ["--rule", "policies.py:DRAWN", "--seed", "4", "--processes", "2", "--json"]
    done = here("run", spec, *options, "--max-rounds", "12", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    rule = policy_rule("drawn", drawn_rows, observation="relative", batched=True, random=True)
    digest = PathDigest()
    for each in play(scene_from_spec(spec), rule, seed=4, max_rounds=12).rounds:
        moves = each.moves.items()
        digest.add(each.number, [Executed(who, made.generator, made.at) for who, made in moves])
    assert document["path_digest"] == digest.text()
    assert document["moves"] > 0
    assert check_rule(f"{file}:DRAWN", ["agv:graph=C6,n=2"]).findings == ()
