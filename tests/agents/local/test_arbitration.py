"""Arbitration: what one module finds out of claims and verdicts, and what all of them find out."""

import ast
import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

import cubepath.agents
from cubepath.agents.environments.world import World
from cubepath.agents.local.arbitration import (
    contest,
    outcome,
    priority,
    site_after,
    taking_along,
    verdict,
    waiting_for,
)
from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.uniform import RANDOM
from cubepath.protocol.core.actions import Action, commute
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles.obvious_rounds import maximal, rank, settled

SPECS = [
    "hex:n=7",
    "hex-open:n=7",
    "arm:n=7",
    "agv:graph=grid4x4,n=9",
    "agv:graph=C7,n=4",
    "agv-labelled:graph=grid3x3,n=6",
    "sliding:p=2,q=2,n=5",
    "arms:n=2",
]


def random_rounds(
    spec: str, seed: int, rounds: int
) -> Iterator[tuple[World, dict[int, Move], dict[int, int]]]:
    """Yield the world, its claims and the actions that make them, each round of a random run."""
    scene = scene_from_spec(spec)
    world = World(scene, seed=seed)
    actors = actors_for(scene, RANDOM, seed=seed, hesitate=0.0)
    for _ in range(rounds):
        actions = {m: actor.act(world.observe(m)).action for m, actor in actors.items()}
        claims = {}
        for module, action in actions.items():
            move = scene.system.moves(world.sites[module])[action - 1] if action else None
            if move is not None:
                claims[module] = move
        yield world, claims, actions


@pytest.mark.parametrize("spec", SPECS)
def test_what_is_executed_commutes_and_nothing_could_be_added(spec: str) -> None:
    """What is executed commutes pairwise, is maximal, and holds every locally highest claim."""
    lost = 0
    for world, claims, actions in random_rounds(spec, seed=1, rounds=60):
        played = world.step(actions)
        number, winners = played.number, list(played.moves)
        assert winners == settled(claims, 1, number)
        assert sorted([*winners, *played.lost]) == sorted(claims)
        lost += len(played.lost)
        for module, move in claims.items():
            rivals = [
                m for m in claims if m != module and not commute(claims[m].action, move.action)
            ]
            if module in winners:
                assert not set(rivals) & set(winners)
            else:
                assert set(rivals) & set(winners)
            if all(rank(1, number, module) > rank(1, number, m) for m in rivals):
                assert module in winners
    assert lost > 0


def test_what_is_executed_is_nearly_as_much_as_any_maximal_choice() -> None:
    """Over random runs of all systems, at least 99% of what a maximal choice executes."""
    executed = best = 0
    shuffle = random.Random(0)  # noqa: S311 - a test's own order
    for spec in SPECS:
        for world, claims, actions in random_rounds(spec, seed=2, rounds=80):
            executed += len(world.step(actions).moves)
            order = list(claims)
            shuffle.shuffle(order)
            best += len(maximal(claims, order))
    assert executed >= 0.99 * best


def test_rank_is_a_fixed_function() -> None:
    """Ranks are the same in every process and differ between rounds, modules and seeds."""
    assert priority(0, 1, 0) == (3536880612023947064, 0)
    values = {priority(seed, number, m)[0] for seed in (0, 1) for number in (1, 2) for m in (0, 1)}
    assert len(values) == 8


def claims_of(parts: list[tuple[set[int], set[int], int]]) -> dict[int, Move]:
    """Return claims of abstract moves: what each writes, what it reads too, and how many go."""
    found = {}
    for module, (trace, reads, along) in enumerate(parts):
        action = Action(trace | reads, trace, trace, ())
        motion = tuple((site, -1 - site) for site in sorted(trace)[: 1 + along])
        found[module] = Move(action, "g", module, motion)
    return found


parts = st.lists(
    st.tuples(st.sets(st.integers(0, 9), min_size=1), st.sets(st.integers(0, 9)), st.integers(0, 2))
)


@given(parts)
def test_each_pair_that_conflicts_knows_who_goes_before(
    drawn: list[tuple[set[int], set[int], int]],
) -> None:
    """Of two claims that conflict one goes before the other, which waits for it; else neither."""
    claims = claims_of(drawn)
    contests = {}
    for module, claim in claims.items():
        others = {other: move for other, move in claims.items() if other != module}
        contests[module] = contest(module, claim, others, seed=0, round_number=1)
    for one, mine in claims.items():
        before, after = contests[one].before, contests[one].after
        assert before | after == {
            other
            for other, theirs in claims.items()
            if other != one and not commute(mine.action, theirs.action)
        }
        assert before == {other for other in before | after if rank(0, 1, other) > rank(0, 1, one)}
        assert not before & after
        for other in before:
            assert one in contests[other].after
        waiting = waiting_for(mine, [claims[other] for other in after])
        assert waiting == {claims[other].source for other in after} | {
            source for source, _ in mine.motion[1:]
        }


@given(parts)
def test_who_is_taken_along_waits_and_is_taken(drawn: list[tuple[set[int], set[int], int]]) -> None:
    """Whom a claim takes along is told its verdict, and goes where its motion says."""
    for module, claim in claims_of(drawn).items():
        (source, target), *along = claim.motion
        assert site_after(source, [claim]) == target
        assert not taking_along(source, {module: claim})
        for site, there in along:
            assert taking_along(site, {module: claim}) == {module}
            assert site in waiting_for(claim, [])
            assert site_after(site, [claim]) == there
        assert site_after("elsewhere", [claim]) == "elsewhere"
        assert site_after(source, []) == source


def test_a_verdict_is_open_until_it_follows() -> None:
    """Granted when all that go before are lost, lost as soon as one of them is granted."""
    assert verdict([], {}) is True
    assert verdict([1, 2], {}) is None
    assert verdict([1, 2], {1: False}) is None
    assert verdict([1, 2], {1: False, 2: False, 3: True}) is True
    assert verdict([1, 2], {2: True}) is False
    assert verdict([1, 2], {1: False, 2: True}) is False
    assert [outcome(granted) for granted in (None, True, False)] == ["none", "granted", "lost"]


def names_in(path: Path) -> set[str]:
    """Return every name that a file calls, imports or reads."""
    tree = ast.parse(path.read_text())
    found = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    found |= {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    return found | {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


@pytest.mark.parametrize(
    ("name", "home"),
    [
        ("commute", "local/arbitration.py"),
        ("RANK", "local/arbitration.py"),
        ("possible", "local/observation.py"),
        ("apply_in_place", None),
    ],
)
def test_there_is_one_place_that_decides(name: str, home: str | None) -> None:
    """Where rounds are played, conflict, rank and admissible are asked in one file each.

    And nothing executes an action beside them.
    """
    root = Path(cubepath.agents.__file__).parent
    where = {
        path.relative_to(root).as_posix()
        for room in ("local", "environments", "processes")
        for path in (root / room).rglob("*.py")
        if name in names_in(path)
    }
    assert where == ({home} if home else set())
