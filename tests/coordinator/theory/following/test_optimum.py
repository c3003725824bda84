"""The fewest rounds in which vehicles may follow, against exhaustive search over joint states."""

import json
from contextlib import ExitStack
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.theory.following.files import fewest_rounds_proof, read_vehicle_plan
from cubepath.coordinator.theory.following.optimum import (
    AT,
    Schedule,
    VehicleClauses,
    VehicleTask,
    _at_most_one,
    clauses_of,
    fewest_rounds,
)
from cubepath.coordinator.theory.proof_checking.following import check_following
from cubepath.coordinator.theory.proof_checking.following_proof import check_fewest_rounds
from faces import ROOT
from oracles.following_tasks import FAR, draw_task, exhaustive, one_by_one, task_of
from oracles.vehicle_rounds import draw_plan, is_legal

pysat = pytest.importorskip("pysat.solvers")
AGV = ROOT / "tests" / "data" / "agv"


def solved(clauses: VehicleClauses) -> Schedule | None:
    """Ask a solver in this process."""
    with pysat.Solver(name="cadical195", bootstrap_with=one_by_one(clauses)) as solver:
        if not solver.solve():
            return None
        true = {literal for literal in solver.get_model() if literal > 0}
    return clauses.schedule(np.array([name in true for name in clauses.variables], dtype=np.bool_))


@pytest.mark.parametrize(
    "first", [0, *(pytest.param(k, marks=pytest.mark.nightly) for k in range(60, 960, 60))]
)
def test_the_clauses_agree_with_exhaustive_search(first: int) -> None:
    """One round fewer than the optimum is refuted, and the optimum is found and legal."""
    told = [0, 0]
    for seed in range(first, first + 60):
        task = draw_task(seed)
        way = exhaustive(task)
        least = None if way is None else len(way) - 1
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
    clauses = VehicleClauses(draw_task(0), 0)
    names = [clauses.new(AT, who, 0, 0) for who in range(count)]
    _at_most_one(clauses, dict(enumerate(names)), clauses.task.starts[0], 0)
    with pysat.Solver(name="cadical195", bootstrap_with=one_by_one(clauses)) as solver:
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


@pytest.mark.thorough
def test_random_plans_are_never_below_the_optimum() -> None:
    """The process of the solver says what the solver says here, and files hold."""
    shorter = 0
    for seed in range(40, 52):
        plan = draw_plan(seed).plan()
        within = plan.rounds or 0
        found = fewest_rounds(plan, "mapf", within=within, seconds=60)
        assert found.ended == "done"
        assert found.lower_bound <= found.rounds <= within
        task = VehicleTask(plan.starts, plan.ends, plan.edges(), "mapf")
        if found.rounds:
            assert solved(clauses_of(task, found.rounds - 1)) is None
        if found.timetable is not None:
            assert not any(check_following(found.timetable, plan).values())
            shorter += 1
        else:
            assert found.rounds == within
    assert shorter > 2


@pytest.mark.parametrize(
    ("rule", "told"), [("mapf", (12, 10, 10, None, True)), ("cgshop", (12, 11, 11, None, True))]
)
def test_grid8_by_the_command(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, rule: str, told: tuple[object, ...]
) -> None:
    """The optima of docs/schedules.md, written and checked."""
    given, output = AGV / "grid8-12agents.json", tmp_path / "best.jsonl"
    options = ["--following", rule, "--prove", "60", "-o", str(output), "--json"]
    assert main(["improve", str(given), *options]) == 0
    found = json.loads(capsys.readouterr().out)
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
    """What was refuted before it counts, and no process is left."""
    plan = read_vehicle_plan(AGV / "grid8-12agents.json")

    def interrupt(rounds: int) -> None:
        if rounds == 11:
            raise KeyboardInterrupt

    found = fewest_rounds(plan, "cgshop", within=12, seconds=60, tick=interrupt)
    assert (found.rounds, found.lower_bound, found.ended) == (12, 11, "interrupt")
    assert (found.agreed, found.optimal) == (None, None)


def test_where_the_log_is_too_long_two_solvers_agree() -> None:
    """Without a log that can be checked nothing more is proved, and what is said says so."""
    plan = read_vehicle_plan(AGV / "grid8-12agents.json")
    with ExitStack() as logs:
        found = fewest_rounds(plan, "cgshop", within=12, seconds=60, logs=logs, log_max=100)
        assert (found.rounds, found.lower_bound, found.agreed) == (11, 10, 11)
        assert (found.optimal, found.proved_by) == (None, "way of a vehicle")
        assert found.refuted is not None
        assert found.timetable is not None
        checked = check_fewest_rounds(fewest_rounds_proof(found.refuted, found.timetable))
    assert (checked.optimal, checked.refuted) == (False, 9)
