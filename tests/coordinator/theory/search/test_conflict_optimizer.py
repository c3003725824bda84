"""The conflict optimizer: cheapest routes, drafts without conflicts, legal plans, same seeds."""

from heapq import heappop, heappush
from itertools import pairwise
from pathlib import Path
from random import Random

import numpy as np
import pytest

from cubepath.coordinator.normal_form.definitions import end_state, is_cube
from cubepath.coordinator.normal_form.heap import normal_cube_path
from cubepath.coordinator.shortening.normal_path import shorten
from cubepath.coordinator.theory.optimality.tasks import task_of
from cubepath.coordinator.theory.search import conflict_optimizer as kernel
from cubepath.coordinator.theory.search.anytime import Improvement, improve
from cubepath.coordinator.theory.search.conflict_optimizer import ConflictOptimizer, VehicleEnds
from cubepath.coordinator.theory.search.own_ends import ends_of
from cubepath.coordinator.theory.search.space_time_routes import FREE, Numbers
from cubepath.coordinator.theory.search.vehicle_lns import Replanner
from samples.strategies import random_walk, scene

DATA = Path(__file__).parents[3] / "data" / "agv"
SPECS = (
    "agv:graph=grid4x4,n=5",
    "agv:graph=grid6x6,n=5",
    "agv:graph=grid5x3,n=7",
    "agv:graph=K5,n=3",
)


def seeded(seed: int) -> Random:
    """Return a stream of random numbers."""
    return Random(seed)  # noqa: S311 - nothing secret


def replanner(spec: str, seed: int, moves: int = 80, *, labelled_goals: bool = True) -> Replanner:
    """Return the plan of a random walk."""
    where = scene(spec)
    assert where.system.graph is not None
    cubes = normal_cube_path(random_walk(spec, moves, seed))
    return Replanner(
        where.system, where.system.graph, where.start_state, cubes, labelled_goals=labelled_goals
    )


def drafted(
    spec: str, seed: int, *, exchanged: bool = False
) -> tuple[kernel.Draft, kernel.RouteWindow] | None:
    """Return a draft of one round less, some routes into its repair; None if there is none."""
    plan = replanner(spec, seed)
    starts = plan._plan[:, 0].copy()
    optimizer = ConflictOptimizer(plan._near, starts, exchanged=exchanged)
    begun = optimizer._begun(plan._plan, VehicleEnds(plan._ends, plan._away), seeded(seed))
    if begun is not None:
        kernel.repair(*begun, seed % 7, exchanged=exchanged)
    return begun


def stays(row: list[int]) -> list[tuple[int, int, int]]:
    """Return where a route stays, and its first and last time there."""
    found: list[tuple[int, int, int]] = []
    for time, place in enumerate(row):
        if found and found[-1][0] == place:
            found[-1] = place, found[-1][1], time
        else:
            found.append((place, time, time))
    return found


def obvious_prices(draft: kernel.Draft) -> Numbers:
    """Return the prices as they are defined: weights of stays that come within one round."""
    prices = np.zeros_like(draft.price)
    for row, weight in zip(draft.plan.tolist(), draft.weights.tolist(), strict=True):
        for place, first, last in stays(row):
            for time in range(len(prices)):
                if first - 1 <= time <= last + 1:
                    prices[time, place] += weight
    return prices


def obvious_cost(draft: kernel.Draft, vehicle: int, prices: Numbers) -> int | None:
    """Return the cost of a cheapest route by Dijkstra's algorithm over all places and times."""
    last = draft.plan.shape[1] - 1
    others = [other for other in range(len(draft.starts)) if other != vehicle]
    starts = {int(draft.starts[other]) for other in others}
    ends = {int(draft.ends[draft.goals[other]]) for other in others}
    goal = int(draft.ends[draft.goals[vehicle]])
    queue = [(0, 0, int(draft.starts[vehicle]))]
    known: set[tuple[int, int]] = set()
    while queue:
        cost, time, here = heappop(queue)
        if (time, here) in known:
            continue
        known.add((time, here))
        if time == last:
            if here == goal:
                return cost
            continue
        time += 1
        for there in (here, *draft.near[here].tolist()):
            if there == FREE or (time <= 1 and there in starts):
                continue
            if time >= last - 1 and there in ends:
                continue
            price = int(prices[time, there]) + (kernel.MOVE if there != here else 0)
            heappush(queue, (cost + price, time, there))
    return None


def cost_of(row: list[int], prices: Numbers) -> int:
    """Return the cost of a route."""
    moves = sum(here != there for here, there in pairwise(row))
    return kernel.MOVE * moves + sum(int(prices[time, row[time]]) for time in range(1, len(row)))


def apart(one: list[int], other: list[int]) -> bool:
    """Return whether two routes are never at one vertex at times that differ by one at most."""
    held = [{*pair} for pair in pairwise(one)]
    held_too = [{*pair} for pair in pairwise(other)]
    return all(mine.isdisjoint(its) for mine, its in zip(held, held_too, strict=True))


def is_route(near: Numbers, row: list[int]) -> bool:
    """Return whether each step stays or goes along an edge."""
    return all(here == there or there in near[here].tolist() for here, there in pairwise(row))


@pytest.mark.few(1)
@pytest.mark.parametrize("spec", SPECS)
def test_a_route_costs_what_a_plain_search_finds(spec: str) -> None:
    """By dynamic programming in windows or by Dijkstra's algorithm: one cost, and its route."""
    compared = 0
    for seed in range(12):
        begun = drafted(spec, seed)
        if begun is None:
            continue
        draft, window = begun
        for vehicle in range(len(draft.starts)):
            if draft.weights[vehicle] > 0:
                kernel.throw_out.plain(draft, vehicle)
            prices = obvious_prices(draft)
            expected = obvious_cost(draft, vehicle, prices)
            cost = kernel.route(draft, window, vehicle)
            if expected is None:
                assert cost == kernel.NEVER
                continue
            compared += 1
            row = draft.plan[vehicle].tolist()
            assert cost == expected == cost_of(row, prices)
            assert is_route(draft.near, row)
            assert row[0] == draft.starts[vehicle]
            assert row[-1] == draft.ends[draft.goals[vehicle]]
    assert compared > 5


@pytest.mark.parametrize("spec", SPECS)
@pytest.mark.parametrize("exchanged", [False, True])
def test_a_draft_has_no_conflict_and_true_tables(spec: str, exchanged: bool) -> None:
    """After any number of routes: who waits has no entry, all others are apart, goals go round."""
    for seed in range(12):
        begun = drafted(spec, seed, exchanged=exchanged)
        if begun is None:
            continue
        draft, window = begun
        vehicles = range(len(draft.starts))
        waiting = draft.waiting[: draft.state[0]].tolist()
        assert len(set(waiting)) == len(waiting)
        assert sorted(draft.goals.tolist()) == [*vehicles]
        routed = [vehicle for vehicle in vehicles if vehicle not in waiting]
        assert [vehicle for vehicle in vehicles if draft.weights[vehicle] > 0] == routed
        rows = draft.plan.tolist()
        for vehicle in routed:
            assert is_route(draft.near, rows[vehicle])
            assert all(apart(rows[vehicle], rows[other]) for other in routed if other < vehicle)
            assert window.ending[rows[vehicle][-1]] == vehicle
        at = np.full_like(draft.at, FREE)
        for vehicle in routed:
            at[np.arange(len(at)), rows[vehicle]] = vehicle
        assert (at == draft.at).all()
        assert (obvious_prices(draft) == draft.price).all()


@pytest.mark.parametrize("spec", SPECS)
@pytest.mark.parametrize("exchanged", [False, True])
def test_what_is_repaired_is_a_shorter_plan(spec: str, exchanged: bool) -> None:
    """Fewer rounds, everyone from its start to the goal that is told, and nobody in the way."""
    repaired = 0
    for seed in range(6):
        plan = replanner(spec, seed)
        rows, ends = plan._plan, VehicleEnds(plan._ends, plan._away)
        optimizer = ConflictOptimizer(plan._near, rows[:, 0].copy(), exchanged=exchanged)
        random = seeded(seed)
        for _ in range(20):
            found = optimizer.step(rows, ends, random)
            if found is None:
                continue
            repaired += 1
            new = found.plan.tolist()
            assert len(new[0]) < rows.shape[1]
            assert [row[0] for row in new] == rows[:, 0].tolist()
            assert [row[-1] for row in new] == ends.places[found.goals].tolist()
            assert exchanged or found.goals.tolist() == [*range(len(new))]
            assert all(is_route(plan._near, row) for row in new)
            assert all(apart(one, new[other]) for one in new for other in range(new.index(one)))
            break
    assert repaired


@pytest.mark.parametrize("labelled", [False, True])
def test_repairs_are_cubes_of_the_system(labelled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the definitions: legal cubes to the same end, with labelled goals each to its own."""
    monkeypatch.setattr("cubepath.coordinator.theory.search.vehicle_lns.REPAIRS", 1.0)
    where = scene(SPECS[0])
    walk = random_walk(SPECS[0], 80, seed=3)
    plan = replanner(SPECS[0], 3, labelled_goals=labelled)
    before = plan.rounds
    random = seeded(1)
    for _ in range(30):
        rounds = plan.rounds
        assert plan.step(random) == (plan.rounds < rounds)
        cubes = normal_cube_path(plan.actions())
        assert len(cubes) <= plan.rounds  # fewer if a vehicle went there and back in vain
        assert all(map(is_cube, cubes))
        assert end_state(cubes, where.start_state) == end_state(walk, where.start_state)
        if labelled:
            moves = [move for cube in cubes for move in cube]
            assert ends_of(moves, where.start_state) == ends_of(walk, where.start_state)
    assert plan.rounds < before


def test_the_same_seed_repairs_alike() -> None:
    """Nothing but the plan and the seed decides the routes."""
    one, other = (drafted("agv:graph=grid5x3,n=7", 6, exchanged=True) for _ in range(2))
    assert one is not None
    assert other is not None
    for mine, its in zip(one[0], other[0], strict=True):
        if mine is not one[0].waiting:
            assert (mine == its).all()


def test_plain_python_repairs_alike() -> None:
    """Compiled or not, the repair is the same, up to its last random number."""
    begun = [drafted("agv:graph=grid4x4,n=5", 5) for _ in range(2)]
    assert begun[0] is not None
    assert begun[1] is not None
    assert kernel.repair(*begun[0], 9, exchanged=True) == kernel.repair.plain(
        *begun[1], 9, exchanged=True
    )
    one, other = begun[0][0], begun[1][0]
    assert (one.state == other.state).all()
    assert (one.price == other.price).all()
    assert (one.plan == other.plan).all()


def test_a_plan_at_its_bound_is_left_alone() -> None:
    """One vehicle on its shortest way: no round can be cut."""
    near = np.array([[1, FREE], [0, 2], [1, FREE]], dtype=np.int32)
    ends = VehicleEnds(np.array([2], dtype=np.int32), np.array([[2, 1, 0]], dtype=np.int32))
    optimizer = ConflictOptimizer(near, np.zeros(1, dtype=np.int32), exchanged=False)
    assert optimizer.step(np.array([[0, 1, 2]], dtype=np.int32), ends, seeded(1)) is None
    late = optimizer.step(np.array([[0, 0, 0, 1, 2]], dtype=np.int32), ends, seeded(1))
    assert late is not None
    assert late.plan.shape[1] == 4


def test_an_interrupt_loses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever was found until then is built and told, also if it waited to be built."""
    monkeypatch.setattr("cubepath.coordinator.theory.search.anytime._MOVES_A_STEP", 1)
    where = scene(SPECS[0])
    walk = random_walk(SPECS[0], 1500, seed=2)
    start = where.start_state
    for stop in (5, 9, 20):
        told: list[Improvement] = []

        def interrupt(steps: int, stop: int = stop) -> None:
            if steps == stop:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            improve(walk, start, where.system, iterations=99, watch=told.append, tick=interrupt)
        before = improve(walk, start, where.system, iterations=stop - 1)
        after = improve(walk, start, where.system, iterations=stop)
        assert len(told) == 1
        assert after.cubes <= told[0].cubes <= before.cubes < len(normal_cube_path(walk))


@pytest.mark.nightly
def test_a_crowd_gets_below_what_neighbourhoods_find() -> None:
    """160 vehicles of CG:SHOP 2021 in fewer than 37 rounds; their bound is 29."""
    task = task_of(shorten(DATA / "cgshop2021-algae.json"))
    found = improve(
        task.path, task.start, task.system, iterations=4000, labelled_goals=True, enough=36
    )
    assert 29 <= found.cubes <= 36
    assert end_state(found.cube_path, task.start) == end_state(task.path, task.start)
