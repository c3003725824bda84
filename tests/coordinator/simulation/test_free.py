"""Runs without rounds under faults: what they come to, what happens in them, and what is found."""

from collections import Counter
from pathlib import Path

import pytest

from cubepath.coordinator.simulation.faults import (
    FREE_KINDS,
    ROUTER,
    SECOND_US,
    STARTS,
    Fault,
    ListedFaults,
)
from cubepath.coordinator.simulation.free_simulated import FreeSimulatedRun, free_simulate
from cubepath.coordinator.simulation.network import Trace
from cubepath.coordinator.simulation.scenarios import (
    FreeScenario,
    ScenarioOptions,
    free_scenario_of,
)
from cubepath.coordinator.simulation.swarm import (
    WITHOUT_ROUNDS,
    FreeSwarm,
    SeedTally,
    simulate_seeds,
)
from exploration.planted_keepers import PLANTED
from marked import some

RESTLESS = f"{Path(__file__).parents[2] / 'samples' / 'restless.py'}:RESTLESS"
GRID = FreeScenario("agv:graph=grid2x9,n=6", "random", 4, 3, 0.0, (0.0, 3.0), 30, 20 * SECOND_US, 7)
HEX = FreeScenario("hex:n=4", "chain", 4, 2, 0.0, (0.0,), 30, 20 * SECOND_US, 7)


def held(scenario: FreeScenario, *faults: Fault, trace: Trace | None = None) -> FreeSimulatedRun:
    """Return a run with these faults, which holds, and in which they all come to pass."""
    found = free_simulate(scenario, ListedFaults(faults), trace=trace)
    assert found.failure is None
    assert sorted(found.fired) == sorted(faults)
    return found


def test_without_faults_there_are_moves_enough() -> None:
    """A rule without a goal goes on after its last fault as before."""
    found = held(GRID)
    assert found.outcome == "moves"
    assert found.moves >= 50


def test_without_faults_the_goal_is_reached() -> None:
    """In fewer moves than end the faults."""
    assert held(HEX).outcome == "goal"


@pytest.mark.slow
def test_a_rule_need_not_reach_what_it_does_not_reach_in_rounds() -> None:
    """The orders of a leader lead some modules away from the others, which wait for more."""
    leader = FreeScenario("hex-open:n=8,bend=60", "leader", 6, 4, 0.0, (0.0,), 22, SECOND_US, 7)
    assert held(leader).outcome == "blocked"


@pytest.mark.slow
def test_who_stays_by_choice_is_not_stuck() -> None:
    """Modules around one that has died are as near to their goal as they come."""
    factors = (10.0, 3.0, 0.0, 0.0, 0.0)
    arm = FreeScenario("arm-free:n=5", "metropolis", 5, 3, 0.5, factors, 39, 10_604_183, 28356)
    assert held(arm, Fault("process_4", 20, "crash")).outcome == "blocked"


@pytest.mark.thorough
@pytest.mark.parametrize(("seed", "outcome"), [(21297, "blocked"), (26641, "gave-up")])
def test_a_rule_that_does_not_arrive_is_no_fault_of_keepers(seed: int, outcome: str) -> None:
    """Vehicles go round one that has died for ever; one gives up after many moves."""
    assert FreeSwarm().run_of(seed).outcome == outcome


@pytest.mark.slow
def test_a_process_that_was_replaced_ends_by_itself() -> None:
    """It wakes, learns that it is fenced off, and nobody waits for it to come back."""
    run = FreeSwarm().run_of(4936)
    assert "twin" in {fault.kind for fault in run.fired}
    assert run.failure is None


SLOW = pytest.mark.slow
ON_KEEPERS = ("cut", "torn", "return", "pause", "slow", "stall")


@pytest.mark.few(6)
@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=SLOW if kind == "torn" else ()) for kind in FREE_KINDS]
)
def test_each_fault_happens_and_is_survived(kind: str) -> None:
    """To a message, a keeper, a module process or the router; nothing is wrong in between."""
    amount = 0 if kind in ("crash", "loss") else SECOND_US // 4
    where, nth = {
        "late": (f"process_1{STARTS}", 0),
        "router": (ROUTER, 30),
        **dict.fromkeys(("partition", "one-way", "host"), (ROUTER, 30)),
        "twin": ("process_1", 8),
        "leave": ("process_1", 8),
        "crash": ("process_1", 8),
    }.get(kind, ("keeper_0", 12) if kind in ON_KEEPERS else ("keeper_0 up", 12))
    tries = range(nth, nth + 20 if kind == "torn" else nth + 1)
    found = [free_simulate(GRID, ListedFaults([Fault(where, at, kind, amount)])) for at in tries]
    assert [run.failure for run in found] == [None] * len(found)
    assert any(run.fired for run in found)


def test_a_keeper_comes_back_from_its_journal() -> None:
    """Also from one that has lost its last record, time and again."""
    faults = [
        Fault(f"keeper_{keeper}", nth, kind, 20_000)
        for keeper in (0, 2)
        for nth, kind in ((8, "torn"), (9, "cut"), (10, "torn"), (11, "torn"), (13, "return"))
    ]
    found = free_simulate(GRID, ListedFaults(faults))
    assert found.failure is None
    assert {fault.kind for fault in found.fired} == {"torn", "cut", "return"}


@pytest.mark.slow
def test_a_seed_is_the_same_run_each_time() -> None:
    """With every message at the same time."""
    simulator = FreeSwarm()
    traces = []
    for _ in range(2):
        scenario = free_scenario_of(3, WITHOUT_ROUNDS)
        traces.append(Trace())
        simulator.play(3, scenario, simulator.draw(3, scenario, "free faults"), traces[-1])
    assert traces[0] == traces[1]
    assert traces[0].arrows


@pytest.mark.slow
def test_a_seed_is_its_scenario_and_the_faults_that_fired() -> None:
    """What happened can be listed, and then happens again."""
    found = FreeSwarm().run_of(5)
    again = FreeSwarm().play(5, found.scenario, ListedFaults(found.fired))
    assert again == found
    assert found.fired


@pytest.mark.thorough
def test_ten_seeds_hold() -> None:
    """And most kinds of faults happen in them."""
    runs = [FreeSwarm().run_of(seed) for seed in range(10)]
    assert [run.failure for run in runs] == [None] * 10
    kinds = Counter(fault.kind for run in runs for fault in run.fired)
    assert len(kinds) >= len(FREE_KINDS) - 6


@pytest.mark.nightly
@pytest.mark.timeout(1200)
def test_a_hundred_seeds_hold() -> None:
    """All kinds of faults happen in them, and all rules."""
    kinds, rules = Counter[str](), Counter[str]()
    for seed in range(100):
        run = FreeSwarm().run_of(seed)
        assert run.failure is None, (seed, run.failure)
        kinds.update(fault.kind for fault in run.fired)
        rules[run.scenario.rule] += 1
    assert set(kinds) == set(FREE_KINDS)
    assert {"random", "chain", "word", "tswap", "pibt"} <= set(rules)


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "bug",
    some(
        sorted(PLANTED.keys() - {"locks no guards", "forgets fences"}),
        PLANTED.keys() - {"answers no inquiry"},
    ),
)
def test_a_broken_keeper_is_found(bug: str) -> None:
    """Within few seeds of one rule."""
    planted = FreeSwarm(ScenarioOptions(rule="random", clock="free"), PLANTED[bug])
    assert any(planted.run_of(seed).failure is not None for seed in range(60))


@pytest.mark.nightly
@pytest.mark.timeout(1200)
def test_a_keeper_that_is_seldom_wrong_is_found() -> None:
    """Within some hundreds of seeds, of which the first hundred do not show it."""
    planted = FreeSwarm(ScenarioOptions(rule="random", clock="free"), PLANTED["forgets fences"])
    assert any(planted.run_of(seed).failure is not None for seed in range(100, 600))


@pytest.mark.thorough
@pytest.mark.timeout(600)
def test_a_keeper_that_locks_no_guards_is_found() -> None:
    """With a rule that has guards without need."""
    asked = ScenarioOptions("agv:graph=grid2x9,n=6", RESTLESS, clock="free")
    planted = FreeSwarm(asked, PLANTED["locks no guards"])
    assert any(planted.run_of(seed).failure is not None for seed in range(300))


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("system", ["agv:graph=grid2x9,n=6", "hex"])
def test_registers_and_exchanges_hold(system: str) -> None:
    """With a rule that writes registers, heeds them and exchanges them at random."""
    restless = FreeSwarm(ScenarioOptions(system, RESTLESS, clock="free"))
    assert [restless.run_of(seed).failure for seed in range(6)] == [None] * 6


@pytest.mark.thorough
def test_a_broken_keeper_is_found_with_few_faults_left(tmp_path: Path) -> None:
    """What is left of a failing seed fails in the same way; its messages are drawn."""
    planted = FreeSwarm(ScenarioOptions("hex", "random", clock="free"), PLANTED["counts no reads"])
    failures = ((seed, planted.run_of(seed).failure) for seed in range(5, 60))
    seed = next(seed for seed, failure in failures if failure and failure.kind == "level")
    folder = tmp_path / "new"
    (kept,) = simulate_seeds([seed], folder, SeedTally(planted))
    assert kept is not None
    assert kept.kind == "level"
    assert kept.modules <= 5
    assert len(kept.faults) <= 1
    assert kept.log == kept.pictures[0]
    assert {str(path) for path in folder.iterdir()} == {*kept.pictures}
