"""Proofs about vehicles that follow: what holds is accepted, and whatever does not is refused."""

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from random import Random

import numpy as np
import pytest

from cubepath.coordinator.theory.following.optimum import VehicleTask, cell_of, clauses_of
from cubepath.coordinator.theory.following.timetable import RULES, Rule
from cubepath.coordinator.theory.proof_checking.following_proof import (
    AT,
    GOES,
    UP_TO,
    FollowingRefutation,
    check_fewest_rounds,
)
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.path_files.following import (
    FollowingProof,
    read_following_proof,
    write_following_proof,
)
from oracles.following_tasks import draw_task, exhaustive, one_by_one, task_of
from oracles.obvious_refutations import log_of
from oracles.vehicle_rounds import Cell, draw_plan

pytest.importorskip("pysat.solvers")
Way = list[tuple[Cell, ...]]


def proof_of(task: VehicleTask, refuted: int, way: Way) -> FollowingProof:
    """Return the proof of a claim, with a log where one is found; it need not hold."""
    encoded = clauses_of(task, refuted)
    log = log_of(len(encoded.variables), one_by_one(encoded)) if task.least <= refuted else None
    return FollowingProof(
        rule=task.rule,
        starts=task.starts,
        ends=task.ends,
        vertices=[cell_of(site) for site in task.places],
        edges=[(task.places[one], task.places[other]) for one, other in task.edges],
        refuted=refuted,
        variables=encoded.meanings if task.least <= refuted else np.zeros((0, 4), np.int32),
        log=[] if log is None else [log],
        schedule=[
            [
                (who, task.places[there])
                for who, (here, there) in enumerate(zip(before, after, strict=True))
                if here != there
            ]
            for before, after in pairwise(way)
        ],
    )


@cache
def crossing(rule: Rule = "cgshop") -> tuple[VehicleTask, Way]:
    """Return four vehicles that cross where two roads do, and a shortest timetable."""
    free = [(x, 0) for x in range(-2, 4)] + [(0, y) for y in range(-2, 4) if y]
    starts = ((-1, 0), (-2, 0), (0, -1), (0, -2))
    ends = ((3, 0), (2, 0), (0, 3), (0, 2))
    task = task_of(starts, ends, sorted(free), rule)
    way = exhaustive(task)
    assert way is not None
    return task, way


@cache
def crossed() -> FollowingProof:
    task, way = crossing()
    return proof_of(task, len(way) - 2, way)


def refused(proof: FollowingProof) -> str:
    with pytest.raises(CheckError) as caught:
        check_fewest_rounds(proof)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_proof_holds_where_a_log_is_needed() -> None:
    """Longer than every way, so refuted by clauses; the log is followed."""
    found = check_fewest_rounds(crossed())
    assert found.optimal
    assert found.lemmas > 0
    assert found.refuted > crossing()[0].least


@pytest.mark.parametrize(
    ("first", "count"), [(0, 15), pytest.param(15, 585, marks=pytest.mark.nightly)]
)
def test_what_exhaustive_search_finds_is_proved_and_no_more(first: int, count: int) -> None:
    """One round below the optimum is proved; at the optimum nothing can be."""
    by_log = 0
    for seed in range(first, first + count):
        task = draw_task(seed)
        way = exhaustive(task)
        if way is None or len(way) == 1:
            continue
        least = len(way) - 1
        found = check_fewest_rounds(proof_of(task, least - 1, way))
        assert (found.optimal, found.rounds) == (True, least), seed
        by_log += found.clauses > 0
        said = refused(proof_of(task, least, [*way, way[-1]]))
        assert "nothing is refuted yet" in said, seed
    assert by_log > 0


def same(task: VehicleTask, rounds: int) -> int:
    """Compare the clauses, literal by literal, with those that solvers are asked."""
    encoded = clauses_of(task, rounds)
    proof = proof_of(task, rounds, [task.starts])
    literals, ends = FollowingRefutation(proof).clauses
    derived = np.where(literals & 1, -(literals >> 1), literals >> 1).tolist()
    begins = [0, *ends.tolist()]
    found = Counter(frozenset(derived[begin:end]) for begin, end in pairwise(begins))
    assert found == Counter(map(frozenset, one_by_one(encoded)))
    return len(found)


def test_the_clauses_are_those_of_the_solver() -> None:
    """Two ways to them, which share nothing: also for ladders, of more than five at a vertex."""
    tasks = [draw_task(seed) for seed in range(30)]
    assert sum(same(task, task.least + 1) for task in tasks if task.least < 9) > 700
    for rule in RULES:
        many = task_of(
            tuple((x, 0) for x in range(7)),
            tuple((x, 1) for x in range(7)),
            [(x, y) for x in range(7) for y in range(2)],
            rule,
        )
        same(many, 7)
        assert (clauses_of(many, 7).meanings[:, 0] == UP_TO).any()


@pytest.mark.parametrize("rule", RULES)
def test_every_legal_timetable_satisfies_the_clauses(rule: Rule) -> None:
    """By what the variables mean: so nothing that can be done is ever refuted."""
    checked = 0
    for seed in range(25):
        drawn = draw_plan(seed, rule)
        way: Way = [tuple(drawn.starts)]
        for moves in drawn.rounds:
            at = list(way[-1])
            for who, _, target in moves:
                at[who] = target
            way.append(tuple(at))
        if len(way) > 9:
            continue
        free = [(x, y) for x in range(drawn.size[0]) for y in range(drawn.size[1])]
        task = task_of(way[0], way[-1], free, rule)
        rounds = len(way) - 1
        meanings = clauses_of(task, rounds).meanings.tolist()
        proof = replace(proof_of(task, 0, way), refuted=rounds, variables=np.array(meanings))
        true = [holds(kind, one, other, time, way, task) for kind, one, other, time in meanings]
        literals, ends = FollowingRefutation(proof).clauses
        begin = 0
        for end in ends.tolist():
            clause = literals[begin:end].tolist()
            assert any(true[each // 2 - 1] != bool(each & 1) for each in clause), (seed, clause)
            begin = end
        checked += len(ends)
    assert checked > 4_000


def holds(kind: int, one: int, other: int, time: int, way: Way, task: VehicleTask) -> bool:  # noqa: PLR0917
    """Return whether a variable is true of where the vehicles are after each round."""
    cells = [cell_of(site) for site in task.places]
    if kind == AT:
        return way[time][one] == cells[other]
    if kind == UP_TO:
        return cells[other] in way[time][: one + 1]
    assert kind == GOES
    return (cells[one], cells[other]) in zip(way[time], way[time + 1], strict=True)


def meant(change: Callable[[list[list[int]]], object]) -> FollowingProof:
    rows = crossed().variables.tolist()
    change(rows)
    return replace(crossed(), variables=np.array(rows, dtype=np.int32))


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda rows: rows.pop(), "no variable means that"),
        (lambda rows: rows.append(rows[0]), "means the same as variable 1"),
        (lambda rows: rows.append([AT, 0, 0, 99]), "nothing needs it"),
        (lambda rows: rows.append([7, 0, 0, 0]), "nothing needs it"),
        (lambda rows: rows.append([AT, -1, 0, 0]), "nothing needs it"),
        (lambda rows: rows[0].__setitem__(3, 5), "no variable means that vehicle 0 is at"),
    ],
)
def test_changed_meanings_are_refused(
    change: Callable[[list[list[int]]], object], why: str
) -> None:
    """A variable that is missing, there twice, or that means something else."""
    assert why in refused(meant(change))


def test_swapped_meanings_are_refused() -> None:
    """The variables are all there, but the log is about others."""
    random = Random(3)  # noqa: S311 - to be repeated
    for _ in range(10):
        assert "lemma" in refused(meant(random.shuffle)) or "refuted" in refused(
            meant(random.shuffle)
        )


def test_unsound_lemmas_are_refused() -> None:
    """A lemma that does not follow, first of all: it is named."""
    variables = len(crossed().variables)
    unsound = 0
    for variable in range(1, min(variables, 60), 3):
        lemma = b"a" + varint(2 * variable) + b"\0"
        log = [lemma, *crossed().log]
        why = ""
        try:
            check_fewest_rounds(replace(crossed(), log=log))
        except CheckError as error:
            why = str(error)
        unsound += "lemma 1 of the log does not follow" in why
    assert unsound > 6
    assert "nothing is refuted" in refused(replace(crossed(), log=[]))
    assert "neither the addition" in refused(replace(crossed(), log=[b"zzz"]))


def varint(value: int) -> bytes:
    found = bytearray()
    while value > 127:
        found.append(value & 127 | 128)
        value >>= 7
    return bytes([*found, value])


def changed_schedule(change: Callable[[list[list[tuple[int, int]]]], object]) -> FollowingProof:
    rounds = [list(moves) for moves in crossed().schedule]
    change(rounds)
    return replace(crossed(), schedule=rounds)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda rounds: rounds.pop(), "itself no more than"),
        (lambda rounds: rounds[0].clear(), "the timetable"),
        (lambda rounds: rounds[0].append((9, 0)), "vehicle 9"),
        (lambda rounds: rounds[0].append((0, 99)), "vertex 99"),
        (lambda rounds: rounds[-1].pop(), "after the timetable vehicle"),
        (lambda rounds: rounds[0].append((0, rounds[1][0][1])), "moves twice|no edge"),
        (lambda rounds: rounds.__setitem__(0, rounds[-1]), "no edge"),
    ],
)
def test_changed_timetables_are_refused(
    change: Callable[[list[list[tuple[int, int]]]], object], why: str
) -> None:
    """Too short, not legal, or it ends elsewhere."""
    assert re.search(why, refused(changed_schedule(change)))


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"rule": "mapf"}, "variable|lemma|refuted"),
        ({"refuted": 3}, "variable"),
        ({"starts": [(-2, 0), (-1, 0), (0, -1), (0, -2)]}, "variable|edge"),
        ({"starts": [(9, 9)] * 4}, "no vertex"),
        ({"starts": [(-1, 0)] * 4}, "two vehicles start at one vertex"),
        ({"ends": []}, "4 vehicles start, 0 end"),
        ({"edges": [(0, 99)]}, "ends at vertex 99"),
        ({"edges": [(1, 1)]}, "joins vertex 1 with itself"),
        ({"edges": []}, "no edge"),
        ({"vertices": [(0, 0), (0, 0)]}, "stands twice"),
    ],
)
def test_changed_claims_are_refused(changes: dict[str, object], why: str) -> None:
    """Another rule, task or workspace than the log is about."""
    assert re.search(why, refused(replace(crossed(), **changes)))  # type: ignore[arg-type]


def test_a_claim_of_many_rounds_is_refused_before_anything_is_derived() -> None:
    """What would be derived grows with the rounds, which a small file can hold by the million."""
    rounds = 10**6
    schedule = [*crossed().schedule, *([[]] * rounds)][: rounds + 1]
    why = refused(replace(crossed(), refuted=rounds, schedule=schedule))
    assert re.fullmatch(r"\d+ variables, expected \d+ or more for 1000000 rounds", why)


def test_more_edges_change_the_clauses() -> None:
    """A proof on a smaller workspace is none on a larger one."""
    places = list(crossed().vertices)
    more = (places.index((-1, 0)), places.index((0, -1)))
    assert "variable" in refused(replace(crossed(), edges=[*crossed().edges, more]))


def test_a_file_proves_the_same(tmp_path: Path) -> None:
    """Written and read, the proof is what it was."""
    write_following_proof(tmp_path / "a.proof", crossed())
    read = read_following_proof(tmp_path / "a.proof")
    assert check_fewest_rounds(read) == check_fewest_rounds(crossed())
