"""Groups of sites of which one at most is on: they hold on every path, or are not taken."""

from itertools import combinations
from random import Random

import numpy as np
import pytest

from cubepath.coordinator.theory.satisfiability.encoding import SITE, encode
from cubepath.coordinator.theory.satisfiability.met_moves import MetMoves, SiteGroup, windows_of
from cubepath.protocol.core.actions import Action
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles.complexes import states_of
from oracles.solved import Pair, check_pair, pairs_near, pairs_of, random_actions


class Proposing(MetMoves):
    """Moves, with groups of a test's own."""

    groups: tuple[frozenset[object], ...] = ()

    def proposed_groups(self) -> list[tuple[int, ...]]:
        """Return them, by number."""
        return [
            tuple(number for number, site in enumerate(self.sites) if site in group)
            for group in self.groups
        ]


def groups(pair: Pair, rounds: int, *proposed: frozenset[object]) -> tuple[SiteGroup, ...]:
    """Return the groups that the clauses of so many rounds use."""
    met = Proposing(pair.system, pair.listed, pair.start, pair.goal)
    met.groups = proposed
    return encode(met, rounds).groups


@pytest.mark.parametrize(
    "spec", ["agv-labelled:graph=grid3x2,n=3", "agv-labelled:graph=C5,n=2", "agv-labelled:n=2"]
)
def test_vehicles_are_at_one_vertex_each(spec: str) -> None:
    """Every label at exactly one place, every place with one label at most, in all states."""
    where = scene_from_spec(spec)
    labels = where.system.labels
    for pair in pairs_of(where, 3, seed=1):
        met = pair.met()
        found = encode(met, 6).groups
        assert sum(group.exactly for group in found) == labels
        assert len(found) > (labels or 0)
        for state in states_of(where, 300):
            for group in found:
                on = sum(met.sites[number] in state for number in group.sites)
                # Only what paths of so many rounds can use is known here.
                assert on <= 1


def test_sites_of_a_group_exclude_each_other_at_every_time() -> None:
    """Pair by pair as far as they are open; of those of a label one is on."""
    where = scene_from_spec("agv-labelled:graph=grid3x2,n=2")
    for pair in pairs_of(where, 3, seed=4):
        met = pair.met()
        problem = encode(met, 5)
        clauses = {
            frozenset(each.tolist()) for each in np.split(problem.literals, problem.ends[:-1])
        }
        possible = windows_of(met.arrays(), met.on(0), met.on(1), 5).value_possible()
        number = {
            (index, time): place
            for place, (kind, index, time) in enumerate(problem.variables.tolist(), start=1)
            if kind == SITE
        }
        seen = 0
        for group in problem.groups:
            for time in range(6):
                on = [site for site in group.sites if possible[site, 1, time]]
                if any(not possible[site, 0, time] for site in on):
                    continue
                seen += 1
                for one, other in combinations(on, 2):
                    assert frozenset((-number[one, time], -number[other, time])) in clauses
                if group.exactly:
                    assert frozenset(number[site, time] for site in on) in clauses
        assert seen


def test_systems_without_labels_propose_none() -> None:
    """Their modules are alike, and a site holds one by definition."""
    for pair in pairs_of(scene_from_spec("hex:n=4"), 2, seed=2):
        assert encode(pair.met(), 4).groups == ()


STEP = Action("ab", "ab", "a", "b")
GROUP = frozenset("ab")


@pytest.mark.parametrize(
    ("other", "start", "expected"),
    [
        ([], "a", [True]),
        ([], "ab", []),
        # Another that moves in from outside: nothing says that the group is empty.
        ([Action("cb", "cb", "c", "b")], "ac", []),
        # The same, but it reads the rest of the group.
        ([Action("abc", "bc", "c", "b")], "ac", [False]),
        # One that leaves the group may come back when the other is there.
        ([Action("cb", "cb", "c", "b"), Action("ad", "ad", "d", "a")], "a", []),
        # A move that does not say what it finds there.
        ([Action("acd", "cd", "c", "d", free="a")], "ac", []),
        # Both at one time.
        ([Action("abcd", "abcd", "ab", "cd")], "cd", []),
    ],
)
def test_which_groups_hold(other: list[Action], start: str, expected: list[bool]) -> None:
    """Told by the moves alone, and whether one of the sites is always on."""
    goal = frozenset(start) ^ {"x"}
    listed = (STEP, *other, Action("x", "x", "", "x"))
    found = groups(Pair(None, listed, frozenset(start), goal), 6, GROUP)
    assert [group.exactly for group in found] == expected


def test_groups_of_any_sites_change_no_answer() -> None:
    """Those that hold follow from the moves; those that do not are left out."""
    kept = left = 0
    for seed in range(60):
        random = Random(seed)  # noqa: S311 - nothing secret
        listed = random_actions(random, 6, 6, size=5)
        proposed = [frozenset(random.sample(range(6), random.randint(2, 3))) for _ in range(8)]
        for pair in pairs_near(frozenset(random.sample(range(6), 2)), listed, 3, seed=seed):
            met = Proposing(None, pair.listed, pair.start, pair.goal)
            met.groups = tuple(proposed)
            check_pair(pair, met=met)
            found = groups(pair, 3, *proposed)
            kept += len(found)
            left += len(proposed) - len(found)
    assert kept > 50
    assert left > 500
