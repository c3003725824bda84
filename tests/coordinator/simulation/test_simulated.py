"""Simulated runs: what they come to without faults and with each kind, and what is found wrong."""

from collections import Counter
from dataclasses import replace

import msgspec
import pytest

from cubepath.agents.processes.config import ProcessConfig
from cubepath.agents.processes.node import HostNode
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import run
from cubepath.coordinator.simulation.faults import ENDING, KINDS, SECOND_US, Fault, ListedFaults
from cubepath.coordinator.simulation.network import Trace
from cubepath.coordinator.simulation.scenarios import Scenario, ScenarioOptions
from cubepath.coordinator.simulation.simulated import MakeNode, SimulatedRun, simulate
from cubepath.coordinator.simulation.swarm import LockstepSwarm
from cubepath.coordinator.testing.properties import always, sometimes
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.wire.nodes import Node
from exploration.planted import Faultless, ForgetsCounts, IsDeaf, Raises, TakesDoubles
from samples.recordings import new_path

HEX = Scenario("hex:n=4", "chain", 3, 0.0, 1000, 7)
GRID = Scenario("agv-labelled:graph=grid3x3,n=4", "pibt", 4, 0.25, 1000, 3)


def played(scenario: Scenario, *faults: Fault) -> SimulatedRun:
    """Return a run with these faults, which holds."""
    found = simulate(scenario, ListedFaults(faults))
    assert found.failure is None
    assert found.fired == faults
    return found


@pytest.mark.parametrize("scenario", [HEX, GRID])
def test_without_faults_the_goal_is_reached(scenario: Scenario) -> None:
    """With a recording that is verified, and no waiting at all."""
    found = played(scenario)
    assert found.outcome == "goal"
    assert verify(found.recording).ok
    assert found.seconds < 0.1


@pytest.mark.slow
def test_a_real_run_has_the_same_path() -> None:
    """The same plan over zenoh gives the same edge path and the same cubes."""
    log = new_path()
    outcome = run(Plan("hex:n=4", "chain", seed=7, processes=2, max_rounds=1000, log=log))
    found = verify(played(HEX).recording)
    assert (outcome.path_digest, outcome.cubes) == (found.path_digest, found.cubes)
    assert verify(read_recording(log)).path_digest == found.path_digest


TOLERATED = [
    Fault("process_1 up", 9, "loss"),
    Fault("process_0 down", 12, "loss"),
    Fault("coordinator down", 20, "loss"),
    Fault("coordinator up", 4, "loss"),
    Fault("process_2 up", 5, "duplicate", 700),
    Fault("coordinator up", 5, "duplicate", 90_000),
    Fault("process_0 up", 3, "delay", 30_000),
    Fault("process_1 down", 8, "reorder", 30_000),
    Fault("process_1", 7, "pause", 20 * SECOND_US),
    Fault("coordinator", 11, "pause", 25 * SECOND_US),
    Fault("process_2", 4, "slow", 40_000),
    Fault("router", 33, "router", 4 * SECOND_US),
]


@pytest.mark.few(5)
@pytest.mark.parametrize("fault", TOLERATED, ids=lambda fault: f"{fault.kind} {fault.where}")
def test_each_fault_is_tolerated(fault: Fault) -> None:
    """The run goes past it to the same path."""
    found = played(HEX, fault)
    assert found.outcome == "goal"
    assert found.rounds == played(HEX).rounds


def test_all_of_them_together_are_tolerated() -> None:
    """The faults of one run do not add up to one that ends it."""
    assert simulate(HEX, ListedFaults(TOLERATED)).outcome == "goal"


@pytest.mark.parametrize("nth", [0, 1, 6, 15])
def test_a_crash_ends_the_run_in_one_line(nth: int) -> None:
    """The line names the process, and what is on record is verified."""
    found = played(HEX, Fault("process_1", nth, "crash"))
    assert found.outcome == "crash"
    assert found.ending is not None
    assert "(process 1) died in round" in (found.ending.error or "")
    assert verify(found.recording).ok


def test_a_stall_of_a_process_ends_the_run_by_patience() -> None:
    """Who stands still for longer than the patience is named."""
    found = played(HEX, Fault("process_1", 6, "stall", 200 * SECOND_US))
    assert found.outcome == "stall"
    assert found.ending is not None
    assert found.ending.error is not None
    assert found.ending.error.startswith("no answer within 60 s")
    assert "(process 1)" in found.ending.error


@pytest.mark.parametrize("seed", [3, 7])
def test_the_same_seed_gives_the_same_trace_and_recording(seed: int) -> None:
    """Bit for bit, and also from the list of the faults that happened."""
    first, again = LockstepSwarm().run_of(seed), LockstepSwarm().run_of(seed)
    assert first.fired == again.fired
    assert first.recording.records == again.recording.records
    traces = [Trace(), Trace()]
    for trace in traces:
        listed = simulate(first.scenario, ListedFaults(first.fired), fault_seed=seed, trace=trace)
        assert listed.recording.records == first.recording.records
    assert traces[0] == traces[1]


def test_some_seeds_hold() -> None:
    """A quick handful: no failure, and most reach their end."""
    outcomes = Counter(LockstepSwarm().run_of(seed).outcome for seed in range(6))
    assert not outcomes["failure"]
    assert outcomes["goal"] + outcomes["max-rounds"] >= 4


@pytest.mark.parametrize("fifteenth", range(4))
def test_a_run_ends_in_each_way_in_some_seed(fifteenth: int) -> None:
    """All together: in the usual ways, and by each fault that may end it."""
    vehicles = LockstepSwarm(ScenarioOptions("agv", "random", 3))
    for seed in range(15 * fifteenth, 15 * fifteenth + 15):
        outcome = vehicles.run_of(seed).outcome
        always(outcome != "failure", f"seed {seed} holds")
        for end in ("goal", "max-rounds", *ENDING):
            sometimes(outcome == end, f"a simulated run ends: {end}")


@pytest.mark.nightly
def test_three_hundred_seeds_hold() -> None:
    """No seed fails, every kind of fault fires, and seven in ten go past all of their faults."""
    outcomes: Counter[str] = Counter()
    fired: Counter[str] = Counter()
    failures = []
    for seed in range(1000, 1300):
        found = LockstepSwarm().run_of(seed)
        outcomes[found.outcome] += 1
        fired.update(fault.kind for fault in found.fired)
        if found.failure is not None:
            failures.append((seed, found.failure))
    assert failures == []
    assert fired.keys() == set(KINDS)
    past = outcomes["goal"] + outcomes["max-rounds"] + outcomes["gave-up"]
    assert past >= 0.7 * 300
    assert outcomes["goal"] >= 50


LOST = Fault("process_1 down", 2, "loss")


@pytest.mark.parametrize(
    ("make", "faults", "kind"),
    [(Faultless, (), None), (TakesDoubles, (), None), (IsDeaf, (), "ended")],
)
def test_a_planted_bug_shows_only_where_it_matters(
    make: MakeNode, faults: tuple[Fault, ...], kind: str | None
) -> None:
    """Without its fault a bug does no harm; one that ends every run is told."""
    found = simulate(HEX, ListedFaults(faults), make=make)
    assert (found.failure and found.failure.kind) == kind


def test_a_run_stops_at_the_first_round_with_other_moves() -> None:
    """What comes after a difference says nothing more; the recording can be read up to there."""
    other = replace(HEX, seed=8, hesitate=0.5)

    def make(orders: ProcessConfig, scene: Scene) -> Node:
        return HostNode(msgspec.structs.replace(orders, seed=9), scene)

    found = simulate(other, ListedFaults(()), make=make)
    assert found.failure is not None
    assert found.failure.kind == "path"
    assert found.failure.detail.startswith(f"round {found.rounds} has the moves ")
    assert found.rounds < simulate(other, ListedFaults(())).rounds
    assert found.recording.records[-1].kind == "summary"


@pytest.mark.parametrize(
    ("make", "kinds"),
    [
        (TakesDoubles, {"path", "verify deliveries"}),
        (ForgetsCounts, {"raised", "path", "ended", "verify hearing"}),
        (Raises, {"raised"}),
    ],
)
def test_a_planted_bug_is_found(make: MakeNode, kinds: set[str]) -> None:
    """Within some tens of seeds, with the check or the error that it breaks."""
    found = (LockstepSwarm(make=make).run_of(seed).failure for seed in range(60))
    first = next(failure for failure in found if failure is not None)
    assert first.kind in kinds, first


def test_a_run_that_begins_at_its_goal_is_over() -> None:
    """Nothing is started, and the recording holds."""
    found = simulate(replace(HEX, system="hex:n=1"), ListedFaults(()))
    assert (found.failure, found.rounds, found.outcome) == (None, 0, "goal")
    assert found.steps == 0
