"""The windows of values and moves, against their definition in plain Python, and against paths."""

from collections.abc import Iterable
from itertools import count
from math import inf
from random import Random

import numpy as np
import pytest

from cubepath.coordinator.normal_form.definitions import end_state
from cubepath.coordinator.theory.satisfiability.met_moves import (
    NEVER,
    LiteralWindows,
    MetMoves,
    window_bound,
    windows_of,
)
from cubepath.coordinator.theory.search.budget import Budget, SpentError
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles.complexes import actions_at, commuting_sets, states_of
from oracles.solved import Pair, pairs_near, pairs_of, random_actions

Literal = tuple[Site, bool]
Directed = tuple[Action, int]
SPECS = (
    "hex:n=3",
    "sliding:p=2,q=1,n=3",
    "agv:graph=grid3x2,n=2",
    "agv-labelled:graph=C5,n=2",
    "arm:n=4",
    "arms:n=1",
    "polygon:n=7",
    "triangulation:n=6",
    "words",
    "assembly:n=2",
)


def needs(move: Directed, *, after: bool = False) -> list[Literal]:
    """Return the values that a move needs before it, or gives after it."""
    action, way = move
    on = action.ends[way ^ after]
    return [(site, site in on) for site in action.support - action.free]


def spread(moves: Iterable[Directed], on: frozenset[Site], *, back: bool) -> dict[Literal, float]:
    """Return when each value is possible, counted from one end: the least solution, by rounds."""
    moves = list(moves)
    found: dict[Literal, float] = {}
    for action, _ in moves:
        for site in action.support:
            found |= {(site, value): 0 if value == (site in on) else inf for value in (False, True)}
    changed = True
    while changed:
        changed = False
        for move in moves:
            time = 1 + latest(move, found, after=back)
            for literal in needs(move, after=not back):
                if time < found[literal]:
                    found[literal] = time
                    changed = True
    return found


def latest(move: Directed, found: dict[Literal, float], *, after: bool) -> float:
    """Return when the values that a move needs, or gives, and its guards, are all possible."""
    times = [found[literal] for literal in needs(move, after=after)]
    times += [min(found[one, False], found[other, True]) for one, other in move[0].guards]
    return max(times, default=0)


def obvious_windows(
    actions: Iterable[Action], start: frozenset[Site], goal: frozenset[Site], rounds: int
) -> tuple[dict[Literal, float], dict[Literal, float], dict[Directed, tuple[float, float]]]:
    """Return the times of values from both ends, and the windows of the moves that survive."""
    left = {(action, way): (0.0, 0.0) for action in actions for way in (0, 1)}
    while True:
        ahead, behind = spread(left, start, back=False), spread(left, goal, back=True)
        windows = {
            move: (1 + latest(move, ahead, after=False), rounds - latest(move, behind, after=True))
            for move in left
        }
        kept = {move: (lo, hi) for move, (lo, hi) in windows.items() if lo <= hi}
        if len(kept) == len(left):
            return ahead, behind, kept
        left = kept


def survivors(met: MetMoves, found: LiteralWindows) -> dict[Directed, tuple[float, float]]:
    """Return the windows of the moves that can be made."""
    return {
        (met.actions[number // 2], number % 2): (first, last)
        for number, (first, last) in enumerate(
            zip(found.first.tolist(), found.last.tolist(), strict=True)
        )
        if first <= last
    }


def check_windows(pair: Pair, rounds: int, universe: Iterable[Action] | None) -> int:
    """Check the windows against their definition, on the moves that were met or on more."""
    met = pair.met()
    met.reach(rounds)
    found = windows_of(met.arrays(), met.on(0), met.on(1), rounds)
    actions = met.actions if universe is None else universe
    ahead, behind, moves = obvious_windows(actions, pair.start, pair.goal, rounds)
    assert survivors(met, found) == moves
    for times, numbers in ((ahead, found.after), (behind, found.before)):
        for number, site in enumerate(met.sites):
            for value in (False, True):
                at_end = 0 if value == (site in (pair.start, pair.goal)[times is behind]) else inf
                expected = times.get((site, value), at_end)
                assert min(int(numbers[number, int(value)]), rounds + 1) == min(
                    expected, rounds + 1
                )
    return len(moves)


@pytest.mark.few(4)
@pytest.mark.parametrize("spec", [*SPECS, "hex-open:n=3", "arm-free:n=4", "sliding:p=2,q=2,n=5"])
def test_windows_are_what_their_definition_says(spec: str) -> None:
    """Computed anew after each move that is left out, from sets of sites."""
    sizes = {
        check_windows(pair, rounds, None)
        for pair in pairs_of(scene_from_spec(spec), 4, seed=1)
        for rounds in (0, 1, 2, 3, 5)
    }
    assert len(sizes) > 2


@pytest.mark.parametrize("seed", range(8))
def test_windows_of_actions_of_any_form(seed: int) -> None:
    """With guards, free sites, and sites that are held in a trace."""
    random = Random(seed)  # noqa: S311 - nothing secret
    listed = random_actions(random, 10, 7, size=4)
    for pair in pairs_near(frozenset(random.sample(range(7), 3)), listed, 4, seed=seed):
        for rounds in (1, 2, 4):
            check_windows(pair, rounds, None)


@pytest.mark.few(3)
@pytest.mark.parametrize("spec", SPECS)
def test_moves_met_from_both_ends_are_enough(spec: str) -> None:
    """The same as from many more: those of all states, and those met within many more rounds."""
    where = scene_from_spec(spec)
    everywhere = {action for state in states_of(where, 400) for action in actions_at(where, state)}
    for pair in pairs_of(where, 3, seed=2, rounds=4):
        far = pair.met()
        far.reach(12)
        for rounds in (1, 2, 3):
            check_windows(pair, rounds, everywhere.union(far.actions))


def distances(where: Scene, state: frozenset[Site], most: int) -> dict[frozenset[Site], int]:
    """Return the rounds to each state within `most` of them, by sets of commuting moves."""
    found, layer = {state: 0}, [state]
    for distance in range(1, most + 1):
        following: list[frozenset[Site]] = []
        for here in layer:
            for cube in commuting_sets(actions_at(where, here)):
                there = end_state([cube], here)
                if there not in found:
                    found[there] = distance
                    following.append(there)
        layer = following
    return found


@pytest.mark.few(5)
@pytest.mark.parametrize("spec", SPECS)
@pytest.mark.parametrize("idle", [1, 0])
def test_no_path_leaves_the_windows(spec: str, idle: int) -> None:
    """Every move of every path of so many rounds lies in its window, and every value in its own."""
    where = scene_from_spec(spec)
    seen = 0
    for pair in pairs_of(where, 4, seed=7, rounds=3):
        best = pair.optimum()
        assert best is not None
        rounds = best + idle
        met = pair.met()
        met.reach(rounds)
        found = windows_of(met.arrays(), met.on(0), met.on(1), rounds)
        moves, possible = survivors(met, found), found.value_possible()
        ahead = distances(where, pair.start, rounds)
        behind = distances(where, pair.goal, rounds)
        for here, passed in ahead.items():
            for time in range(passed, rounds - behind.get(here, rounds + 1) + 1):
                for number, site in enumerate(met.sites):
                    assert possible[number, int(site in here), time]
            for cube in commuting_sets(actions_at(where, here)):
                left = behind.get(end_state([cube], here), rounds)
                for turn in range(passed + 1, rounds - left + 1):
                    for action in cube:
                        first, last = moves[action, int(here >= action.ends[1])]
                        assert first <= turn <= last
                        seen += 1
    assert seen


def test_moves_are_looked_for_within_half_of_the_rounds() -> None:
    """On an infinite lattice, too; more rounds meet more moves, and keep what was met."""
    where = scene_from_spec("hex:n=5")
    assert not where.system.bounded
    met = MetMoves(where.system, (), where.start_state, where.goal or frozenset())
    sizes = []
    for rounds in (0, 1, 2, 3, 4, 7, 8, 3):
        before = list(met.actions)
        met.reach(rounds)
        assert met.actions[: len(before)] == before
        sizes.append(len(met.actions))
    assert sizes == sorted(sizes)
    assert sizes[0] == 0
    assert sizes[1] == sizes[2] < sizes[3] == sizes[4] < sizes[5] == sizes[6] == sizes[7]


def test_windows_are_refuted_where_a_site_is_left_without_a_value() -> None:
    """Told by when values begin and end, as by looking at every time."""
    random = np.random.default_rng(5)
    seen: set[bool] = set()
    nothing = np.empty(0, dtype=np.int32)
    for _ in range(500):
        rounds = int(random.integers(0, 6))
        after, before = (random.integers(0, 7, (2, 2)).astype(np.int32) for _ in range(2))
        after[random.random((2, 2)) < 0.2] = NEVER
        for times in (after, before):
            times[:, random.integers(0, 2)] = 0
        found = LiteralWindows(rounds, after, before, nothing, nothing)
        obvious = not bool(found.value_possible().any(axis=1).all())
        assert found.refuted() == obvious
        seen.add(obvious)
    assert seen == {False, True}


@pytest.mark.parametrize("seed", range(5))
def test_the_bound_by_halving_is_that_of_one_round_after_another(seed: int) -> None:
    """Where all moves are known; what is refuted is told in ascending order."""
    random = Random(seed)  # noqa: S311 - nothing secret
    length = random.randrange(3, 40)
    line = [Action({at, at + 1}, {at, at + 1}, {at}, {at + 1}) for at in range(length)]
    listed = [*line, *random_actions(random, 10, 7, size=4)]
    goal = frozenset({random.randrange(length + 1)})
    met = MetMoves(None, listed, frozenset({0}), goal)
    most = length + 2
    open_ = [
        rounds
        for rounds in range(most)
        if not windows_of(met.arrays(), met.on(0), met.on(1), rounds).refuted()
    ]
    expected = open_[0] if open_ else most
    told: list[int] = []
    assert window_bound(met, 0, most, raised=told.append) == expected
    assert open_ == list(range(expected, most))
    assert told == sorted(set(told))
    assert (told[-1] if told else -1) == expected - 1
    assert len(told) <= 2 * most.bit_length()


def test_windows_can_be_given_up_whenever_all_moves_were_looked_at() -> None:
    """A clock that ticks at each look stops it at any of them."""
    line = [Action({at, at + 1}, {at, at + 1}, {at}, {at + 1}) for at in range(30)]
    met = MetMoves(None, line, frozenset({0}), frozenset({10}))
    arrays, ends = met.arrays(), (met.on(0), met.on(1))

    def until(looks: float) -> Budget:
        clock = count()
        return Budget(looks, clock=lambda: float(next(clock)))

    for looks in range(1, 5):
        with pytest.raises(SpentError):
            windows_of(arrays, *ends, 12, until(looks).spend)
    assert windows_of(arrays, *ends, 12, until(5).spend).rounds == 12
    met.spend = until(3).spend
    with pytest.raises(SpentError):
        window_bound(met, 0, 20)
