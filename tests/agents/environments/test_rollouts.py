"""Many runs side by side are those of one after another."""

from dataclasses import replace
from typing import Any

import pytest

from cubepath.agents.arrays import batch
from cubepath.agents.environments.rollouts import play, play_free, play_in_python, play_many
from cubepath.agents.rules.chain import CHAIN
from cubepath.agents.rules.pibt import PIBT
from cubepath.agents.rules.rule import RuleType
from cubepath.agents.rules.uniform import RANDOM
from cubepath.agents.rules.word import WORD
from cubepath.protocol.compiled import Allowance
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.scenes.specs import scene_from_spec

RUNS = [
    ("hex:n=6", CHAIN, 0.0),
    ("hex:n=6", CHAIN, 0.3),
    ("arm:n=5", WORD, 0.2),
    ("assembly:n=3", RANDOM, 0.1),
    ("agv-labelled", RANDOM, 0.0),
    ("agv:graph=grid3x3,n=3", PIBT, 0.1),
]


@pytest.mark.parametrize(("spec", "rule", "hesitate"), RUNS)
def test_each_run_is_that_of_its_seed(spec: str, rule: RuleType, hesitate: float) -> None:
    """Rounds with their moves and lost claims, ends, and why a rule gave up."""
    scene, seeds = scene_from_spec(spec), [3, 4, 9]
    many = play_many(scene, rule, seeds, hesitate=hesitate, max_rounds=25, keep_rounds=True)
    for run, seed in enumerate(seeds):
        one = play_in_python(scene, rule, seed=seed, hesitate=hesitate, max_rounds=25)
        assert many.played is not None
        assert many.played[run] == one.rounds
        assert many.sites[run] == one.sites
        assert (many.rounds[run], many.reached[run]) == (len(one.rounds), one.reached)
        assert many.moves[run] == sum(len(each.moves) for each in one.rounds)
        assert many.lost[run] == sum(len(each.lost) for each in one.rounds)
        assert many.failed.get(run) == one.failed


@pytest.mark.parametrize(("spec", "rule", "hesitate"), RUNS)
def test_moves_as_arrays_are_those_of_the_rounds(
    spec: str, rule: RuleType, hesitate: float
) -> None:
    """By run, round and module, each with its move; and the lost claims of each round."""
    scene, seeds = scene_from_spec(spec), [3, 4, 9]
    asked: dict[str, Any] = {"hesitate": hesitate, "max_rounds": 25, "keep_moves": True}
    many = play_many(scene, rule, seeds, keep_rounds=True, **asked)
    plain = play_many(scene, replace(rule, vectorised=None), seeds, **asked)
    assert many.played is not None
    rows = [
        (run, each.number, module, move)
        for run, rounds in enumerate(many.played)
        for each in rounds
        for module, move in each.moves.items()
    ]
    for found in (many, plain):
        made = found.made
        assert made is not None
        assert len(set(made.moves)) == len(made.moves)
        moves = [made.moves[number] for number in made.move]
        assert list(zip(made.run, made.round, made.module, moves, strict=True)) == rows
        lost = [[len(each.lost) for each in rounds] for rounds in many.played]
        assert [each.tolist() for each in made.lost] == lost


def test_moves_are_named_by_the_tables_that_they_were_made_with(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A batch that forgets places on its way, and numbers others anew, keeps the same moves."""
    scene = scene_from_spec("hex-open:n=6")
    expected = play_many(scene, RANDOM, [1, 2], max_rounds=40, keep_moves=True).made
    monkeypatch.setattr(batch, "PLACES_MAX", 0)
    monkeypatch.setattr(batch, "PLACES_GROWTH", 1)
    forgotten: list[int] = []
    forget = batch.Batch._forget

    def noted(self: batch.Batch) -> None:
        forgotten.append(int(self.round.max()))
        forget(self)

    monkeypatch.setattr(batch.Batch, "_forget", noted)
    forgetful = play_many(scene, RANDOM, [1, 2], max_rounds=40, keep_moves=True).made
    assert forgotten
    assert expected is not None
    assert forgetful is not None
    assert [expected.moves[n] for n in expected.move] == [
        forgetful.moves[n] for n in forgetful.move
    ]


def test_a_rule_without_a_vectorised_form_is_played_all_the_same() -> None:
    """One run after another."""
    scene = scene_from_spec("hex:n=4")
    plain = play_many(scene, replace(CHAIN, vectorised=None), [1, 2])
    fast = play_many(scene, CHAIN, [1, 2])
    assert plain.rounds.tolist() == fast.rounds.tolist()
    assert plain.reached.all()
    assert plain.played is None


@pytest.mark.parametrize("rule", [CHAIN, replace(CHAIN, vectorised=None)])
def test_without_rounds_nothing_is_played(rule: RuleType) -> None:
    """Nobody moves in no round, one run or many, and fewer are refused."""
    scene = scene_from_spec("hex:n=4")
    played = play(scene, rule, max_rounds=0)
    many = play_many(scene, rule, [0], max_rounds=0, keep_rounds=True, keep_moves=True)
    assert (played.rounds, played.sites, played.reached) == ((), scene.start, False)
    assert (many.played, many.sites) == (((),), (scene.start,))
    assert (many.rounds.tolist(), many.reached.tolist()) == ([0], [False])
    assert many.made is not None
    assert [lost.tolist() for lost in many.made.lost] == [[]]
    with pytest.raises(InputError, match="max_rounds=-1: expected 0 or more"):
        play(scene, rule, max_rounds=-1)
    with pytest.raises(InputError, match="max_rounds=-1: expected 0 or more"):
        play_many(scene, rule, [0], max_rounds=-1)
    assert play_free(scene, rule, max_cycles=0).turns == 0
    with pytest.raises(InputError, match="max_cycles=-1: expected 0 or more"):
        play_free(scene, rule, max_cycles=-1)


def test_no_runs_are_none() -> None:
    """There is nothing to play."""
    assert not len(play_many(scene_from_spec("hex:n=4"), CHAIN, []).rounds)


def test_a_run_in_compiled_code_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """When enough has been played before."""
    scene = scene_from_spec("hex:n=5")
    expected = play_in_python(scene, CHAIN, seed=2, hesitate=0.2, max_rounds=1000)
    monkeypatch.setattr(batch, "allowance", Allowance(0))
    monkeypatch.setattr(batch, "_compiler", type("Ready", (), {"ready": lambda _: True})())
    assert play(scene, CHAIN, seed=2, hesitate=0.2) == expected
