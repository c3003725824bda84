"""What holds of all rules without rounds, and the rules random and word."""

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.agents.environments.free_world import ActionResult, FreeWorld
from cubepath.agents.environments.rollouts import play_free
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.registry import BUILT_IN, rule_named
from cubepath.agents.rules.rule import FreeRule
from cubepath.agents.rules.uniform import RANDOM
from cubepath.agents.rules.word import WORD
from cubepath.protocol.core.actions import apply
from cubepath.protocol.core.errors import InputError, RuleError
from cubepath.protocol.scenes.specs import scene_from_spec
from samples.free_plays import Pace, paces
from samples.local_families import LOCAL_FAMILIES

SCENES = {
    "random": "sliding:p=3,q=2,n=4",
    "chain": "hex:n=5",
    "chains": "hex:n=4,bend=0,aside=1",
    "word": "arm:n=5",
    "crossing": "polygon:n=7",
    "geodesic": "assembly:kind=wall,n=3",
    "tunnel": "hex-tunnel:n=4",
    "metropolis": "sliding:p=3,q=2,n=4",
    "leader": "sliding-shapes:n=6,walk=60",
    "tswap": "agv:graph=grid4x4,n=6",
    "pibt": "agv-labelled:graph=grid4x4,n=5",
    "compression": "compression:n=4",
}
TO_GOAL = [name for name, rule in BUILT_IN.items() if rule.to_goal]


@pytest.mark.slow
@pytest.mark.parametrize("name", BUILT_IN)
def test_our_own_rules_say_why_they_hold_without_rounds(name: str) -> None:
    """All of them do, and are offered by name."""
    scene = scene_from_spec(SCENES[name])
    rule = rule_named(name, scene.system, "free")
    assert rule.clocks == ("lockstep", "free")
    assert rule.free is not None
    assert rule.free.why


@pytest.mark.few(2)
@pytest.mark.slow
@pytest.mark.parametrize("name", BUILT_IN)
def test_the_same_seed_gives_the_same_run(name: str) -> None:
    """To the last commit, also with late views and modules that start again."""
    scene = scene_from_spec(SCENES[name])
    pace = Pace("random", seed=7, lag=3, hesitate=0.3, slow=10, restarts=((9, 1), (30, 2)))
    runs = [pace.play(scene, BUILT_IN[name], max_cycles=150) for _ in range(2)]
    assert runs[0] == runs[1]
    assert runs[0].commits


@pytest.mark.slow
@pytest.mark.parametrize("name", TO_GOAL)
def test_at_the_goal_nobody_asks_for_anything(name: str) -> None:
    """However often it is called, and also if it has just lost its memory."""
    scene = scene_from_spec(SCENES[name])
    worlds: list[FreeWorld] = []
    played = play_free(scene, BUILT_IN[name], seed=2, watch=lambda world, _: worlds.append(world))
    assert played.reached
    world = worlds[-1]
    asked = []
    for _ in range(12):
        actors = actors_for(
            scene,
            BUILT_IN[name],
            seed=2,
            hesitate=0.0,
            sites=dict(enumerate(world.sites)),
            clock="free",
        )
        turns = [world.act(each, actors[each].act(world.look(each))) for each in actors]
        assert not any(acted.move for acted in turns)
        asked.append(any(acted.asked for acted in turns))
    assert not any(asked[-6:])


def test_a_rule_without_an_argument_is_for_rounds_alone() -> None:
    """It is refused by name, with those that are for it."""
    from dataclasses import replace

    assert replace(WORD, free=None).clocks == ("lockstep",)
    with pytest.raises(InputError, match="rule 'chain', expected one of random, metropolis, word"):
        rule_named("chain", scene_from_spec("arm:n=3").system, "free")


def legal_moves(spec: str, **played: Any) -> int:
    """Return the number of moves of a play, each admissible where the ones before led."""
    scene = scene_from_spec(spec)
    state = set(scene.start_state)
    count = 0

    def watch(world: FreeWorld, acted: ActionResult) -> None:
        nonlocal state, count
        if acted.move is not None and acted.moved is not None:
            assert acted.move.possible(state)
            state = set(apply(acted.move.action, frozenset(state)))
            assert set(world.sites) | scene.system.filled == state
            count += 1

    play_free(scene, RANDOM, seed=1, watch=watch, **played)
    return count


@pytest.mark.few(5)
@pytest.mark.slow
@pytest.mark.parametrize("spec", LOCAL_FAMILIES)
def test_random_makes_legal_moves_alone(spec: str) -> None:
    """From every family's default scene, each commit is admissible where the ones before led."""
    assert legal_moves(spec, lag=4, max_cycles=60)


@pytest.mark.parametrize("length", [2, lambda _: "2", lambda _: 1 // 0])
def test_a_rule_that_cannot_tell_how_long_its_notes_are_is_named(length: Any) -> None:
    """Whoever writes one may give the number itself; nobody's processes end by a traceback."""
    free = FreeRule("it relies on nothing", note_length=length)
    rule = replace(RANDOM, name="odd", note_length=length, free=free)
    for clock in ("lockstep", "free"):
        with pytest.raises(
            RuleError, match=r"rule 'odd': its note_length: .* expected a function of"
        ):
            rule.length(3, clock)


@pytest.mark.nightly
def test_random_makes_ten_thousand_legal_moves() -> None:
    """With views up to five commits old, and one vehicle a hundred times slower."""
    spec = "agv-labelled:graph=grid8x8,n=20"
    assert legal_moves(spec, lag=5, max_cycles=800, speeds={0: 100}) > 10_000


@pytest.mark.slow
@settings(max_examples=40, derandomize=True)
@given(st.integers(1, 9), paces())
def test_every_word_is_spelt(n: int, pace: Pace) -> None:
    """Under every scheduler, with late views, hesitation and segments that lose their memory."""
    scene = scene_from_spec(f"arm:n={n}")
    played = pace.play(scene, WORD)
    assert played.reached


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("factor", [1, 10, 100])
def test_a_slow_module_is_waited_for(factor: int) -> None:
    """It acts that much more rarely, and the goal is reached all the same."""
    scene = scene_from_spec("hex:n=6")
    turns = [0] * 6

    def watch(world: FreeWorld, acted: ActionResult) -> None:
        del world
        turns[acted.module] += 1

    rule = rule_named("chain", scene.system, "free")
    played = play_free(scene, rule, seed=3, speeds={3: factor}, max_cycles=20000, watch=watch)
    assert played.reached
    assert turns[3] * factor <= 2 * max(turns) + 2 * factor
