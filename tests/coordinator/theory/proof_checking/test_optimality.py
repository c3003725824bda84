"""Proofs of optimality: those that hold are accepted, and whatever does not hold is refused.

All of it is asked of two checkers: that of `cubepath verify`, and one written from the page alone.
"""

import gc
from collections import Counter
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from cubepath.coordinator.theory.proof_checking.optimality import (
    ClaimedRefutation,
    ProofResult,
    check_optimality,
)
from cubepath.coordinator.theory.proof_checking.refutation_moves import Moves
from cubepath.coordinator.theory.search.exact import optimum
from cubepath.coordinator.theory.search.transitions import Transitions
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import GeneratorPlacement, Move
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.optimality_proofs import (
    Group,
    Ladder,
    OptimalityProof,
    write_proof,
)
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.scenes.toml import scene_from_toml, scene_to_toml
from oracles.minimal_checker import check
from oracles.minimal_systems import RefusedError
from oracles.obvious_refutations import Refutation as Obvious, claim_of, log_of, proof_of
from samples.listed_scenes import listed, listed_scenes, move
from samples.space import SPACE

State = frozenset[Site]
Cubes = list[list[Action]]


def best(scene: Scene, goal: State) -> Cubes | None:
    """Return a schedule with the fewest cubes, by exhaustive search."""
    steps = Transitions(scene.system)
    found = optimum(steps, steps.encode(scene.start_state), steps.encode(goal))
    if found.cubes is None:
        return None
    return [[steps.actions[number] for number in cube] for cube in found.cubes]


def walked(scene: Scene, steps: int, seed: int) -> State:
    """Return where a random walk leads."""
    moves = Transitions(scene.system)
    state, random = moves.encode(scene.start_state), Random(seed)  # noqa: S311
    for _ in range(steps):
        possible = moves.possible(state)
        state ^= moves.toggle[random.choice(possible)] if possible else 0
    return moves.decode(state)


def holding() -> Scene:
    """Seven moves hold one site in their trace and five read it: ladders of moves that stay."""
    moves = []
    for number in range(7):
        sites: list[Site] = [f"a{number}", f"b{number}", "h"]
        action = Action(sites, sites, [sites[0], "h"], [sites[1], "h"], label=f"hold{number}")
        motion = (sites[0], sites[1]), ("h", "h")
        moves.append(Move(action, f"hold{number}", sites[0], motion))
    moves += [move(f"r{n}", ["h"], f"c{n}", f"d{n}", reads=["h"]) for n in range(5)]
    start: list[Site] = [*(f"a{n}" for n in range(7)), *(f"c{n}" for n in range(5)), "h"]
    return listed(*moves, start=start)


KINDS = {
    "agv-labelled:graph=S8,n=3,seed=1": 17,
    "agv-labelled:graph=grid3x2,n=4,seed=2": 17,
    "hex-open:n=4": 0,
    "polygon:n=8": 9,
    "hex:n=4": 0,
    "sliding:p=2,q=2": 0,
    "sliding:p=2,q=2,n=3": 25,
    "arm:n=4": 0,
    "arm-free:n=4": 8,
    "arms:n=2,m=2": 8,
    "agv:graph=S9,n=4,seed=1": 9,
    "agv:graph=grid3x3,n=4,seed=1": 12,
    "triangulation:n=9,seed=2": 9,
    "words": 0,
    "assembly": 0,
    **dict.fromkeys(SPACE, 6),
}
"""A scene of each kind, with how long the walk to the goal is, 0 for its own goal."""


@cache
def proof(spec: str) -> OptimalityProof:
    """Return a proof for a scene of `KINDS`, with its goal."""
    scene = scene_from_spec(spec)
    goal = walked(scene, KINDS[spec], 5) if KINDS[spec] else scene.goal
    assert goal is not None
    cubes = best(scene, frozenset(goal) | scene.system.filled)
    assert cubes
    found = proof_of(scene, cubes, frozenset(goal) | scene.system.filled)
    assert found is not None
    return found


def file_of(told: OptimalityProof) -> bytes:
    with TemporaryDirectory() as folder:
        write_proof(Path(folder, "a.proof"), told)
        return Path(folder, "a.proof").read_bytes()


def accepted(told: OptimalityProof) -> ProofResult:
    """Return what both checkers find that a proof proves; CheckError or an error of the other."""
    found, second = check_optimality(told), check(file_of(told))
    assert second == (found.refuted, found.cubes, found.variables, found.clauses)
    return found


@pytest.mark.few(4)
@pytest.mark.parametrize("spec", KINDS)
def test_a_proof_holds(spec: str) -> None:
    """What is obviously a proof is accepted, for a system of each kind."""
    found = accepted(proof(spec))
    assert found.optimal
    assert found.cubes == found.refuted + 1 == len(proof(spec).schedule)


def clauses_of(found: ClaimedRefutation) -> Counter[frozenset[int]]:
    literals, ends = found.clauses
    signed = np.where(literals & 1, -(literals >> 1), literals >> 1).tolist()
    begins = [0, *ends.tolist()]
    return Counter(frozenset(signed[begin:end]) for begin, end in pairwise(begins))


@pytest.mark.thorough
def test_proofs_need_all_that_clauses_can_say() -> None:
    """Among these proofs are ladders of all kinds, groups, guards, and logs that are needed."""
    proofs = [*map(proof, KINDS), held()]
    assert {ladder.kind for each in proofs for ladder in each.ladders} == {"on", "off", "stay"}
    assert {group.kind for each in proofs for group in each.groups} == {
        "at most one",
        "exactly one",
    }
    assert sum(accepted(each).lemmas > 0 for each in proofs) > 2
    assert sum(check_optimality(each).clauses > 0 for each in proofs) > 6


@cache
def held() -> OptimalityProof:
    """Return a proof about moves that hold one site."""
    scene = holding()
    goal = frozenset([*(f"b{n}" for n in range(7)), *(f"d{n}" for n in range(5)), "h"])
    cubes = best(scene, goal)
    assert cubes is not None
    assert len(cubes) == 8
    found = proof_of(scene, cubes, goal)
    assert found is not None
    return found


@pytest.mark.few(6)
@pytest.mark.parametrize("spec", KINDS)
@pytest.mark.parametrize("more", [0, 1])
def test_clauses_are_those_of_the_definitions(spec: str, more: int) -> None:
    """The clauses are, one by one, those that the obvious way finds, refuted or not."""
    scene, told = scene_from_spec(spec), proof(spec)
    action = ClaimedRefutation(told).action
    cubes = [[action(number) for number in cube] for cube in told.schedule]
    same_clauses(*claim_of(scene, cubes, frozenset(told.goal), refuted=told.refuted + more))


def test_clauses_of_moves_that_hold_a_site() -> None:
    """The same where moves hold a site that others read."""
    same_clauses(*claim_of(holding(), [], frozenset(held().goal), refuted=8))


def same_clauses(told: OptimalityProof, ours: Obvious) -> None:
    expected = Counter(map(frozenset, ours.clauses))
    assert clauses_of(ClaimedRefutation(told)) == expected


@pytest.mark.thorough
@settings(max_examples=20)
@given(scene=listed_scenes(), seed=st.integers(0, 99), alone=st.booleans())
def test_proofs_of_random_systems(scene: Scene, seed: int, alone: bool) -> None:
    """A shortest schedule is proved optimal, and of its own length nothing is refuted.

    So it is with the system, and with its moves alone and no system.
    """
    goal = walked(scene, 6, seed)
    cubes = best(scene, goal)
    assert cubes is not None
    actions = [each.action for each in scene.system.listed] if alone else None  # type: ignore[attr-defined]
    if cubes:
        found = proof_of(scene, cubes, goal, listed=actions)
        assert found is not None
        assert accepted(found).optimal
    # One round more is not impossible: with any log that claim is refused.
    longer = [*cubes, []]
    assert proof_of(scene, longer, goal, listed=actions) is None
    false, _ = claim_of(scene, longer, goal, listed=actions)
    for log in (b"", b"a\x00", b"a\x02\x00a\x03\x00a\x00"):
        refusal(false, log=[log])


@settings(max_examples=20)
@given(scene=listed_scenes(), seed=st.integers(0, 99), data=st.data())
def test_no_group_that_is_accepted_refutes_what_is_possible(
    scene: Scene, seed: int, data: st.DataObject
) -> None:
    """A claim that is false is refused with any groups, though a solver refutes it with them."""
    goal = walked(scene, 6, seed)
    cubes = best(scene, goal)
    assert cubes is not None
    false, found = claim_of(scene, [*cubes, []], goal)
    numbers = st.lists(st.integers(0, len(found.sites) - 1), unique=True, min_size=1, max_size=4)
    for _ in range(data.draw(st.integers(1, 3))):
        kind = data.draw(st.sampled_from(["at most one", "exactly one"]))
        found.say_group(Group(kind, data.draw(numbers)))  # type: ignore[arg-type]
    log = log_of(len(found.variables), found.clauses) or b""
    refusal(false, groups=found.groups, log=[log])


STAR = "agv-labelled:graph=S8,n=3,seed=1"
LABELLED = "agv-labelled:graph=grid3x2,n=4,seed=2"


def refusal(told: OptimalityProof, **changed: Any) -> str:
    """Return why a changed proof is refused."""
    false = replace(told, **changed)
    with pytest.raises(RefusedError):
        check(file_of(false))
    with pytest.raises(CheckError) as caught:
        check_optimality(false)
    said = str(caught.value)
    assert "\n" not in said
    return said


@pytest.mark.parametrize("step", [19, pytest.param(4, marks=pytest.mark.thorough)])
def test_each_variable_must_be_there(step: int) -> None:
    """A variable left out, twice, or of a time that the windows leave out is refused by name."""
    told = proof(STAR)
    for number in range(0, len(told.variables), step):
        kind, index, time = told.variables[number].tolist()
        said = refusal(told, variables=np.delete(told.variables, number, axis=0))
        assert "missing" in said or "ladder" in said
        if kind == 0:
            assert f"at time {time}" in said
        rows = np.vstack((told.variables, [[kind, index, time]])).astype(np.int32)
        assert f"so is variable {number + 1}" in refusal(told, variables=rows)
    for row, why in (
        ((0, 0, 99), "at time 99"),
        ((1, 0, 0), "in round 0"),
        ((1, 99999, 1), "kind 1, index 99999"),
        ((0, -1, 1), "index -1"),
        ((7, 0, 1), "kind 7"),
        ((2, 0, 1), "kind 2"),
    ):
        rows = np.vstack((told.variables, [row])).astype(np.int32)
        assert why in refusal(told, variables=rows)


@settings(max_examples=15)
@given(data=st.data())
def test_other_meanings_are_refused_or_harmless(data: st.DataObject) -> None:
    """Two variables swapped, other rounds, moves and sites: a true claim, or none."""
    told = proof(data.draw(st.sampled_from([STAR, LABELLED, "hex-open:n=4"])))
    rows = told.variables.copy()
    one, other = (data.draw(st.integers(0, len(rows) - 1)) for _ in range(2))
    if data.draw(st.booleans()):
        rows[[one, other]] = rows[[other, one]]
        try:
            check_optimality(replace(told, variables=rows))
        except CheckError:
            refusal(told, variables=rows)
            return
        found = accepted(replace(told, variables=rows))
        assert found.refuted == told.refuted  # as exhaustive search says
        return
    rows[one, data.draw(st.integers(0, 2))] += data.draw(st.sampled_from([-1, 1]))
    refusal(told, variables=rows)


def test_what_the_schedule_must_be() -> None:
    """It is as long as said, longer than what is impossible, legal, and ends at the goal."""
    told = proof(STAR)
    cubes = [list(cube) for cube in told.schedule]
    assert "itself no more than" in refusal(told, refuted=told.cubes)
    assert "expected the" in refusal(told, schedule=cubes[:-1])
    assert "is not at the goal" in refusal(told, schedule=[*cubes[:-1], []])
    assert "do not commute" in refusal(told, schedule=[[*cubes[0], cubes[0][0]], *cubes[1:]])
    assert "less than" in refusal(told, schedule=[[99999], *cubes[1:]])
    refusal(told, schedule=[cubes[1], cubes[0], *cubes[2:]])
    # An idle round makes it no shortest one, but what is said is still true.
    longer = accepted(replace(told, schedule=[[], *cubes], cubes=told.cubes + 1))
    assert not longer.optimal


def test_another_start_or_goal_is_refused() -> None:
    """The windows, and the schedule, are about this start and this goal."""
    told = proof(STAR)
    for sites in (told.start, told.goal):
        for site in sites:
            left = [each for each in sites if each != site]
            changed: dict[str, Any] = {"start" if sites is told.start else "goal": left}
            refusal(told, **changed)
    assert "stands twice" in refusal(told, start=[*told.start, told.start[0]])
    refusal(told, start=told.goal)
    refusal(told, system="format = 1")
    refusal(told, system=None)


def test_groups_must_hold() -> None:
    """A group that some move breaks is refused, and so is one that the start breaks."""
    told = proof(LABELLED)
    assert told.groups
    for number, group in enumerate(told.groups):
        if group.kind == "at most one":
            groups = [*told.groups[:number], Group("exactly one", group.sites)]
            refusal(told, groups=groups)
    on = [told.sites.index(site) for site in told.start]
    assert "on at the start" in refusal(told, groups=[Group("at most one", on)])
    exact = next(group for group in told.groups if group.kind == "exactly one")
    assert "after" in refusal(told, groups=[Group("exactly one", exact.sites[:-1])])
    assert "twice" in refusal(told, groups=[Group("at most one", [0, 0])])
    assert "site number" in refusal(told, groups=[Group("at most one", [99999])])


def test_ladders_must_hold() -> None:
    """Members left out, twice, of another round or site, and ladders nobody needs are refused."""
    told = held()
    first = told.ladders[0]
    for changed in (
        first._replace(members=first.members[:-1]),
        first._replace(members=[*first.members[:-1], first.members[0]]),
        first._replace(members=[*first.members[:-1], 1]),
        first._replace(members=[*first.members[:-1], 99999]),
        first._replace(round=first.round + 1),
        first._replace(round=99),
        first._replace(site=first.site + 1),
        first._replace(site=99999),
        first._replace(kind="on"),
    ):
        refusal(told, ladders=[changed, *told.ladders[1:]])
    refusal(told, ladders=told.ladders[1:])
    refusal(told, ladders=[*told.ladders, first])
    extra = Ladder(told.sites.index("a0"), 1, "off", [1])
    assert "they are few" in refusal(told, ladders=[*told.ladders, extra])


def test_sites_and_moves_stand_once() -> None:
    """A site or a move twice is refused, and so is a name of no move."""
    told = proof(STAR)
    assert "twice" in refusal(told, sites=[*told.sites, told.sites[0]])
    assert "the same as move 0" in refusal(told, moves=[*told.moves, told.moves[0]])
    assert "move 0" in refusal(told, moves=other_moves(told))


def other_moves(told: OptimalityProof) -> list[Any]:
    return [GeneratorPlacement("no such generator", (0, 0)), *told.moves[1:]]


def actions_in_memory() -> int:
    gc.collect()
    return sum(type(each) is Action for each in gc.get_objects())


def test_the_moves_that_are_found_are_kept_as_numbers() -> None:
    """Of thousands of moves no action stays in memory, only rows of a table."""
    scene = scene_from_spec("triangulation:n=40,start=right,goal=up")
    goal = frozenset(scene.goal or ()) | scene.system.filled
    moves = Moves(scene.start_state, goal, [])
    before = actions_in_memory()
    moves.find(scene.system, 8)
    assert len(moves.table.starts) > 1000
    assert actions_in_memory() <= before


def test_a_proof_by_windows_alone_has_no_more_than_it_needs() -> None:
    """Variables, sites in groups, and a log that nothing asks for are refused."""
    told = proof("polygon:n=8")
    assert accepted(told).clauses == 0
    rows = np.array([[0, 0, 1]], dtype=np.int32)
    for name, told_too in (("variables", rows), ("ladders", [Ladder(0, 1, "on", [1])])):
        changed: dict[str, Any] = {name: told_too}
        assert f"there are {name}, and nothing" in refusal(told, sites=told.start, **changed)
    groups = [Group("at most one", [0])]
    assert "there are groups" in refusal(told, sites=told.start, groups=groups)
    assert "there is a log" in refusal(told, log=[b"a\x00"])


def test_moves_have_any_of_their_names() -> None:
    """A name that no search of the system gives is one all the same, and the same move twice."""
    told = proof("triangulation:n=9,seed=2")
    first = told.moves[0]
    assert isinstance(first, GeneratorPlacement)
    assert isinstance(first.at, tuple)
    turned = GeneratorPlacement(first.generator, first.at[::-1])
    assert accepted(replace(told, moves=[turned, *told.moves[1:]])).optimal
    assert "the same as move 0" in refusal(told, moves=[*told.moves, turned])


@pytest.mark.thorough
def test_lemmas_must_follow() -> None:
    """A log cut off anywhere, and one that begins with what does not follow, are refused."""
    told = proof(STAR)
    log = b"".join(told.log)
    assert check_optimality(told).lemmas > 0
    assert "the log ends, and nothing" in refusal(told, log=[])
    assert "within a lemma" in refusal(told, log=[b"a\x02"])
    wrong = 0
    for literal in range(2, 2 * len(told.variables) + 2, 11):
        changed = replace(told, log=[b"a%c\x00" % literal, log])
        try:
            assert check_optimality(changed).optimal
        except CheckError as error:
            refusal(changed)
            assert str(error) == "lemma 1 of the log does not follow by unit propagation"  # noqa: PT017
            wrong += 1
    assert wrong > 5
    assert "no variable" in refusal(told, log=[b"a\xff\xff\x7f\x00", log])
    assert "neither the addition" in refusal(told, log=[b"x\x02\x00", log])


@settings(max_examples=15)
@given(data=st.data())
def test_changed_logs_are_refused_or_harmless(data: st.DataObject) -> None:
    """Whatever the log becomes, what is accepted is true: never more than the claim it had."""
    told = proof(STAR)
    log = bytearray(b"".join(told.log))
    for _ in range(data.draw(st.integers(1, 3))):
        log[data.draw(st.integers(0, len(log) - 1))] = data.draw(st.integers(0, 255))
    changed = replace(told, log=[bytes(log)])
    try:
        assert check_optimality(changed).optimal
    except CheckError as error:
        assert "log" in str(error)  # noqa: PT017
    else:
        assert accepted(changed).optimal


def test_a_system_of_a_file_and_one_that_is_not_local() -> None:
    """A scene of a TOML file has a proof as others have; a rule for the aggregate has none."""
    scene = scene_from_toml(scene_to_toml(holding()), "a file")
    assert accepted(replace(held(), system=scene_to_toml(scene))).optimal
    connected = scene_to_toml(scene_from_spec("hex-connected:n=4"))
    assert "not local" in refusal(proof("hex:n=4"), system=connected)


def test_the_minimal_checker_refuses_changed_and_cut_files() -> None:
    """Any byte, as the page has it: the reader of `verify` has tests of its own."""
    data = file_of(proof("words"))
    assert check(data).cubes == check(data).refuted + 1
    for place in range(0, len(data), 9):
        changed = data[:place] + bytes([data[place] ^ 1 << place % 8]) + data[place + 1 :]
        for false in (changed, data[:place], data + b"\n"):
            with pytest.raises(RefusedError):
                check(false)


def test_a_proof_is_about_its_input() -> None:
    """Another start, goal, system or list of moves than that of an input is told by name."""
    told = proof(STAR)
    found = ClaimedRefutation(told)
    scene = scene_from_spec(STAR)
    start, goal = frozenset(told.start), frozenset(told.goal)
    assert found.other_task(scene.system, start, goal, []) is None
    assert "another start" in str(found.other_task(scene.system, goal, goal, []))
    assert "another goal" in str(found.other_task(scene.system, start, start, []))
    other = scene_from_spec("agv-labelled:graph=S9,n=3,seed=1").system
    assert "another system" in str(found.other_task(other, start, goal, []))
    assert "other moves" in str(found.other_task(None, start, goal, []))
