"""Clauses have a model exactly where exhaustive search finds a path, in every kind of system."""

from random import Random

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray

from cubepath.coordinator.theory.satisfiability import encoding
from cubepath.coordinator.theory.satisfiability.encoding import (
    ClauseBuffer,
    EncodingProblem,
    TooLargeError,
    encode,
)
from cubepath.coordinator.theory.satisfiability.met_moves import MetMoves
from cubepath.coordinator.theory.search.budget import Budget, SpentError
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.registry import all_families
from cubepath.protocol.scenes.specs import scene_from_spec
from oracles.solved import Pair, check_pair, model, pairs_near, pairs_of, random_actions
from samples.listed_scenes import listed_scenes
from samples.local_families import LOCAL_FAMILIES
from samples.space import STICKS
from samples.switches import Ring

SPECS = (
    "hex:n=4",
    "hex:n=4,base=1",
    "hex:n=6,bend=60",
    "hex-open:n=4",
    "hex-tunnel:n=5",
    "hex-tunnel:n=4,catalogue=2",
    "hex-shapes:n=5,density=0.2",
    "sliding:p=2,q=1,n=3",
    "sliding:p=2,q=2,n=5",
    "sliding-shapes:n=5,density=0.1",
    "agv:graph=grid3x3,n=3",
    "agv:graph=K5,n=2",
    "agv:graph=S9,n=4",
    "agv-labelled:graph=grid3x3,n=3",
    "agv-labelled:graph=C6,n=3",
    "agv-labelled:graph=grid3x2,n=4",
    "arm:n=6",
    "arm-free:n=4",
    "arms:n=1",
    "arms:n=2",
    "polygon:n=9",
    "triangulation:n=7",
    "words",
    "words:presentation=raag",
    "assembly:n=3",
    "assembly:kind=wall,n=4",
    "compression:n=2",
    "sliding-cubes:n=3",
    "pivoting-cubes:n=3",
    "rolling-dodecahedra:n=3",
    f"{STICKS}:n=3",
)


def test_every_local_family_is_among_them() -> None:
    """A family that is added is cross-checked too."""
    here = {spec.partition(":")[0] for spec in SPECS}
    assert set(LOCAL_FAMILIES) <= here
    assert {name for name in all_families() if scene_from_spec(name).system.local} <= here


@pytest.mark.few(6)
@pytest.mark.parametrize("spec", SPECS)
def test_clauses_agree_with_exhaustive_search(spec: str) -> None:
    """A model that is a path at the optimum, none with a round less; on random pairs."""
    found = [check_pair(pair) for pair in pairs_of(scene_from_spec(spec), 12, seed=1)]
    assert len({best for best in found if best is not None}) > 1


@pytest.mark.nightly
@pytest.mark.parametrize("spec", SPECS)
def test_clauses_agree_with_exhaustive_search_on_many_pairs(spec: str) -> None:
    """The same on far more, and farther, pairs."""
    pairs = pairs_of(scene_from_spec(spec), 200, seed=2, rounds=14)
    found = [check_pair(pair, max_states=10_000) for pair in pairs]
    assert sum(best is not None for best in found) > 40


def pairs_of_actions(
    seed: int, count: int, *, actions: int, sites: int, size: int
) -> list[int | None]:
    """Return the optima of random pairs, with new actions for every three of them."""
    found: list[int | None] = []
    for each in range(count // 3):
        random = Random(1000 * seed + each)  # noqa: S311 - nothing secret
        listed = random_actions(random, actions, sites, size=size)
        on = frozenset(random.sample(range(sites), random.randint(0, sites)))
        found += map(check_pair, pairs_near(on, listed, 3, seed=each))
    return found


FORMS = [(6, 7, 4), (12, 6, 4), (20, 9, 5)]
"""Numbers of actions and sites, and the greatest sizes of supports."""


@pytest.mark.parametrize(("actions", "sites", "size"), FORMS)
def test_actions_of_any_form(actions: int, sites: int, size: int) -> None:
    """Those of files may do what no system does: begin from nothing, hold what they write."""
    found = pairs_of_actions(1, 90, actions=actions, sites=sites, size=size)
    assert max(best for best in found if best is not None) > 1


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(2, 6))
@pytest.mark.parametrize(("actions", "sites", "size"), [*FORMS, (8, 7, 5), (40, 6, 3)])
def test_many_actions_of_any_form(seed: int, actions: int, sites: int, size: int) -> None:
    """The same on thousands of pairs."""
    pairs_of_actions(seed, 600, actions=actions, sites=sites, size=size)


@pytest.mark.parametrize("holders", [1, 2, 6, 7])
@pytest.mark.parametrize("readers", [0, 1, 7])
def test_moves_that_take_turns_at_a_site(holders: int, readers: int) -> None:
    """Those that hold a site in their trace exclude each other, and those that only read it.

    Few are excluded pair by pair, many by a ladder; the rounds needed are known.
    """
    listed = [Action(["hub", n], ["hub", n], ["hub"], ["hub", n]) for n in range(holders)]
    for n in range(1, readers + 1):
        on, free = (["hub"], []) if n % 2 else ([], ["hub"])
        listed.append(Action(["hub", -n], [-n], on, [*on, -n], free=free))
    goal = frozenset(["hub", *range(holders), *range(-readers, 0)])
    pair = Pair(None, tuple(listed), frozenset({"hub"}), goal)
    assert check_pair(pair, max_states=100_000) == holders + (readers > 0)


@pytest.mark.parametrize("count", [2, 6, 7, 9])
def test_moves_that_toggle_one_site(count: int) -> None:
    """One at a time switches it on, one at a time off: pair by pair or by ladders."""
    listed = [
        Action(["hub", n], ["hub", n], before, after)
        for n in range(count)
        for before, after in (([], ["hub", n]), (["hub"], [n]))
    ]
    goal = frozenset([*range(count), *["hub"] * (count % 2)])
    assert check_pair(Pair(None, tuple(listed), frozenset(), goal), max_states=100_000) == count


@given(listed_scenes(), st.integers(0, 999))
def test_drawn_scenes_with_obstacles(where: Scene, seed: int) -> None:
    """Listed moves of a system: sites that are read or free, guards, obstacles that are on."""
    for pair in pairs_of(where, 2, seed=seed):
        check_pair(pair)


def test_a_system_of_another_distribution() -> None:
    """From the formal core alone: switches that need a quiet neighbour."""
    ring = Ring(5)
    where = Scene("ring", "", ring, tuple((place, "off") for place in range(5)))
    found = [check_pair(pair) for pair in pairs_of(where, 30, seed=3)]
    assert {1, 2, 3} <= set(found)


@pytest.mark.parametrize("spec", ["hex:n=4", "agv:graph=grid3x3,n=3", "words", "sliding:n=3"])
def test_a_length_above_the_optimum_has_a_path_too(spec: str) -> None:
    """Rounds may be idle, so one refutation speaks for all shorter paths."""
    for pair in pairs_of(scene_from_spec(spec), 4, seed=5):
        best = pair.optimum()
        assert best is not None
        met = pair.met()
        for rounds in range(best + 4):
            assert (model(encode(met, rounds)) is not None) == (rounds >= best)


def test_what_cannot_be_reached() -> None:
    """Two labelled vehicles on a path cannot pass each other, however many rounds there are."""
    system = scene_from_spec("agv-labelled:graph=P3,n=2").system
    start, goal = frozenset({(0, 0), (2, 1)}), frozenset({(2, 0), (0, 1)})
    met = MetMoves(system, (), start, goal)
    assert all(model(encode(met, rounds)) is None for rounds in range(12))
    nothing = MetMoves(None, (), frozenset("a"), frozenset("b"))
    assert all(encode(nothing, rounds).impossible for rounds in range(3))


@pytest.mark.parametrize("spec", ["hex:n=3", "agv-labelled:graph=C5,n=2", "words"])
def test_a_path_to_where_it_begins(spec: str) -> None:
    """No round is needed, and more may be idle."""
    where = scene_from_spec(spec)
    pair = Pair(where.system, (), where.start_state, where.start_state)
    assert check_pair(pair) == 0
    assert model(encode(pair.met(), 3)) is not None
    assert model(encode(Pair(None, (), frozenset(), frozenset()).met(), 0)) is not None


def test_clauses_that_are_too_many_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before they are written, with how many they would be."""
    where = scene_from_spec("hex:n=4")
    met = MetMoves(where.system, (), where.start_state, where.goal or frozenset())
    encode(met, 9)
    monkeypatch.setattr(encoding, "LITERALS_MAX", 100)
    with pytest.raises(TooLargeError, match=r"^clauses for 9 rounds have [\d,]+ literals, 100 at"):
        encode(met, 9)
    monkeypatch.setattr(encoding, "VALUES_MAX", 10 * len(met.sites))
    with pytest.raises(TooLargeError, match="literals"):
        encode(met, 9)
    monkeypatch.setattr(encoding, "VALUES_MAX", 10 * len(met.sites) - 1)
    with pytest.raises(TooLargeError, match=r"^clauses for 9 rounds have [\d,]+ values of sites"):
        encode(met, 9)


def test_a_budget_that_is_spent_ends_the_building_of_clauses(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Between two parts of the work: nothing is counted, and nothing written."""
    where = scene_from_spec("hex:n=4")
    met = MetMoves(where.system, (), where.start_state, where.goal or frozenset())
    met.reach(9)
    written: list[bool] = []
    write = encoding.write

    def counted(
        problem: EncodingProblem, out: ClauseBuffer, variables: int, fill: bool
    ) -> NDArray[np.int64]:
        written.append(fill)
        return write(problem, out, variables, fill)

    monkeypatch.setattr(encoding, "write", counted)
    met.spend = Budget(steps=-1).spend
    with pytest.raises(SpentError):
        encode(met, 9)
    assert not written
    met.spend = Budget(steps=0).spend
    encode(met, 9)
    assert written == [False, True]


@pytest.mark.parametrize("most", [0, 3])
def test_large_groups_are_not_excluded_pair_by_pair(
    most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They say only what follows anyway, so the answers stay."""
    monkeypatch.setattr(encoding, "GROUP_MAX", most)
    for pair in pairs_of(scene_from_spec("agv-labelled:graph=grid3x3,n=3"), 12, seed=6):
        check_pair(pair)
