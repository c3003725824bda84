"""The fewest rounds in which vehicles may follow, against exhaustive search over joint states."""

from __future__ import annotations

import json
from itertools import combinations, product
from pathlib import Path
from random import Random

import numpy as np
import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.following.encoding import (
    Clauses,
    Schedule,
    Task,
    _at_most_one,
    clauses_of,
)
from cubepath.coordinator.following.optimum import fewest_rounds
from cubepath.coordinator.following.reading import read_vehicle_plan
from cubepath.coordinator.following.rules import RULES, Rule
from cubepath.coordinator.verification.following import check_following
from cubepath.protocol.core.sites import Site
from faces import ROOT
from vehicle_rounds import Cell, draw_plan, first_wrong, is_legal

pysat = pytest.importorskip("pysat.solvers")
AGV = ROOT / "tests" / "data" / "agv"
FAR = 9


def draw_task(seed: int) -> Task:
    """Draw a few vehicles on a small grid with obstacles."""
    random = Random(seed)  # noqa: S311 - to be repeated
    cells = list(product(range(random.randint(2, 3)), range(random.randint(1, 3))))
    free = random.sample(cells, random.randint(max(2, len(cells) - 2), len(cells)))
    free.sort()
    count = random.randint(1, min(4, len(free)))
    starts, ends = random.sample(free, count), random.sample(free, count)
    return task_of(tuple(starts), tuple(ends), free, RULES[seed % 2])


def task_of(starts: tuple[Cell, ...], ends: tuple[Cell, ...], free: list[Cell], rule: Rule) -> Task:
    edges = [
        ((x, y), there) for x, y in free for there in ((x + 1, y), (x, y + 1)) if there in free
    ]
    return Task(starts, ends, edges, rule)


def cells_of(edge: tuple[Site, Site]) -> list[Cell]:
    return [(site[0], site[1]) for site in edge if isinstance(site, tuple)]


def solved(clauses: Clauses) -> Schedule | None:
    """Ask a solver in this process."""
    with pysat.Solver(name="cadical195", bootstrap_with=list(clauses.each())) as solver:
        if not solver.solve():
            return None
        true = {literal for literal in solver.get_model() if literal > 0}
    return clauses.schedule(np.array([name in true for name in clauses.variables], dtype=np.bool_))


def exhaustive(task: Task) -> int | None:
    """Return the fewest rounds by breadth-first search over where all vehicles are together."""
    front, seen = {task.starts}, {task.starts}
    beside: dict[Cell, list[Cell]] = {}
    for x, y in (*task.starts, *(cell for edge in task.edges for cell in cells_of(edge))):
        near = [(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)]
        beside[x, y] = [there for there in near if there in task.beside[x, y]]
    for rounds in range(FAR):
        if task.ends in front:
            return rounds
        found: set[tuple[Cell, ...]] = set()
        for at in front:
            for joint in product(*([cell, *beside[cell]] for cell in at)):
                moves = [
                    (who, here, there)
                    for who, (here, there) in enumerate(zip(at, joint, strict=True))
                    if here != there
                ]
                if joint not in seen and first_wrong(list(at), moves, task.rule) is None:
                    found.add(joint)
        seen |= found
        front = found
    return None


@pytest.mark.parametrize(
    "first", [0, *(pytest.param(k, marks=pytest.mark.thorough) for k in range(60, 960, 60))]
)
def test_the_clauses_agree_with_exhaustive_search(first: int) -> None:
    """One round fewer than the optimum is refuted, and the optimum is found and legal."""
    told = [0, 0]
    for seed in range(first, first + 60):
        task = draw_task(seed)
        least = exhaustive(task)
        told[least is not None] += 1
        most = FAR - 1 if least is None else least - 1
        if most >= 0:
            assert solved(clauses_of(task, most)) is None, seed
        if least is None:
            continue
        for rounds in (least, least + 1):
            schedule = solved(clauses_of(task, rounds))
            assert schedule is not None, seed
            legal = is_legal(list(task.starts), dict(enumerate(schedule)), task.rule)
            assert legal, (seed, schedule)
            at = list(task.starts)
            for moves in schedule:
                for who, _, target in moves:
                    at[who] = target
            assert tuple(at) == task.ends, seed
    assert min(told) > 5


@pytest.mark.parametrize("count", range(1, 10))
def test_at_most_one_holds_by_pairs_or_by_a_ladder(count: int) -> None:
    """Of any number of variables each may hold alone, and no two together."""
    clauses = Clauses(draw_task(0), 0)
    names = [clauses.new() for _ in range(count)]
    _at_most_one(clauses, names)
    with pysat.Solver(name="cadical195", bootstrap_with=list(clauses.each())) as solver:
        assert all(solver.solve(assumptions=[name]) for name in names)
        assert not any(solver.solve(assumptions=pair) for pair in combinations(names, 2))


def test_many_that_meet_at_one_vertex() -> None:
    """Six vehicles cross where two roads do: a legal timetable, longer than every way."""
    free = [(x, 0) for x in range(-3, 4)] + [(0, y) for y in range(-3, 4) if y]
    west, south = [(x, 0) for x in (-3, -2, -1)], [(0, y) for y in (-3, -2, -1)]
    starts = (*west, *south)
    ends = (*((x + 4, 0) for x, _ in west), *((0, y + 4) for _, y in south))
    task = task_of(starts, ends, sorted(free), "cgshop")
    least = next(k for k in range(task.least, 20) if solved(clauses_of(task, k)) is not None)
    schedule = solved(clauses_of(task, least))
    assert schedule is not None
    assert is_legal(list(starts), dict(enumerate(schedule)), "cgshop")
    assert least > task.least


def test_random_plans_are_never_below_the_optimum() -> None:
    """The process of the solver says what the solver says here, and files hold."""
    shorter = 0
    for seed in range(40, 52):
        plan = draw_plan(seed).plan()
        within = plan.rounds or 0
        found = fewest_rounds(plan, "mapf", within=within, seconds=60)
        assert found.ended == "done"
        assert found.lower_bound <= found.rounds <= within
        task = Task(plan.starts, plan.ends, plan.edges(), "mapf")
        if found.rounds:
            assert solved(clauses_of(task, found.rounds - 1)) is None
        if found.timetable is not None:
            assert not any(check_following(found.timetable, plan).values())
            shorter += 1
        else:
            assert found.rounds == within
    assert shorter > 2


@pytest.mark.parametrize(
    ("rule", "told"), [("mapf", (12, 10, 10, None, True)), ("cgshop", (12, 11, 10, 11, None))]
)
def test_grid8_by_the_command(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    rule: str,
    told: tuple[object, ...],
) -> None:
    """The optima of docs/following.md, written and checked."""
    given, output = AGV / "grid8-12agents.json", tmp_path / "best.jsonl"
    options = ["--following", rule, "--prove", "60", "-o", str(output), "--json"]
    assert main(["shorten", str(given), *options]) == 0
    found = json.loads(capsys.readouterr().out)["following"]
    keys = ("rounds", "improved", "lower_bound", "agreed", "optimal")
    assert tuple(found[key] for key in keys) == told
    assert main(["verify", str(output), "--of", str(given), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rounds"] == told[1]


def test_no_time_leaves_what_is_known() -> None:
    """The bound by the longest way, and the plan's own timetable."""
    plan = read_vehicle_plan(AGV / "grid8-12agents.json")
    found = fewest_rounds(plan, "cgshop", within=12, seconds=0)
    assert (found.rounds, found.lower_bound, found.agreed, found.ended) == (12, 10, None, "time")
    assert found.timetable is None


def test_an_interrupt_leaves_what_is_known() -> None:
    """What two solvers agreed on before it counts, and no process is left."""
    plan = read_vehicle_plan(AGV / "grid8-12agents.json")

    def interrupt(rounds: int) -> None:
        if rounds == 11:
            raise KeyboardInterrupt

    found = fewest_rounds(plan, "cgshop", within=12, seconds=60, tick=interrupt)
    assert (found.rounds, found.agreed, found.ended) == (12, 11, "interrupt")
