"""Liars: what is told of each kind of lie, and that honest processes are never accused."""

from collections import Counter
from random import Random

import msgspec
import pytest

from cubepath.agents.processes.config import ProcessConfig
from cubepath.agents.processes.node import HostNode
from cubepath.coordinator.simulation.faults import LIES, SAYS, DrawnFaults, Fault, ListedFaults
from cubepath.coordinator.simulation.network import Trace
from cubepath.coordinator.simulation.scenarios import Scenario, ScenarioOptions
from cubepath.coordinator.simulation.simulated import LIE, SimulatedRun, simulate
from cubepath.coordinator.simulation.swarm import LockstepSwarm
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.messages import Bundle, Presence, Refused, decode, encode
from cubepath.protocol.wire.nodes import Effect, Node, Put

GRID = Scenario("agv:graph=grid12x3,n=6", "random", 3, 0.0, 6, 0)
"""Six vehicles in three processes, beside the border of two regions."""
SAYING = f"process_1{SAYS}"
LYING = ScenarioOptions(liars=True)


def lied(kind: str, least: int = 0) -> SimulatedRun:
    """Return the first run in which process 1 lies in this way, and does so nowhere else."""
    for nth in range(least, 120):
        found = simulate(GRID, ListedFaults([Fault(SAYING, nth, kind)]))
        assert found.failure is None, (nth, found.failure)
        if found.fired:
            return found
    raise AssertionError(f"no {kind}")


def refused(found: SimulatedRun) -> set[tuple[str, str]]:
    """Return who was refused, and why in a word."""
    messages = [decode(each.data) for each in found.recording.records if each.kind == "refused"]
    return {(each.sender, each.reason) for each in messages if isinstance(each, Refused)}


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("kind", "reasons"),
    [
        ("lie-site", {"impossible"}),
        ("lie-claim", {"out of place", "impossible", "contradicts"}),
        ("lie-report", {"impossible"}),
        ("lie-count", {"contradicts"}),
        ("lie-other", {"foreign", "contradicts", "impossible", "doubled"}),
        ("lie-part", {"out of place", "contradicts"}),
        ("lie-silence", {"contradicts"}),
    ],
)
def test_a_lie_about_what_is_known_is_refused(kind: str, reasons: set[str]) -> None:
    """The run ends by patience, in a line that names the liar and why it was refused."""
    found = lied(kind, 1)  # whoever joins has said nothing yet, whatever it counts
    assert found.outcome == LIE
    assert {who for who, _ in refused(found)} <= {"process_1"}
    assert {why for _, why in refused(found)} <= reasons
    assert found.ending is not None
    line = found.ending.error or ""
    assert line.startswith("no answer within 60 s to phase ")
    assert "(process 1)" in line
    assert "(process 0)" not in line
    assert "(process 2)" not in line
    if refused(found):
        assert "; last refused, on " in line


def test_what_is_withheld_and_counted_looks_like_a_process_that_is_dead() -> None:
    """Nobody is refused; it is named as late."""
    found = lied("lie-withhold")
    assert (found.outcome, refused(found)) == (LIE, set())
    assert found.ending is not None
    assert "(process 1)" in (found.ending.error or "")


@pytest.mark.parametrize(
    ("kind", "reasons"),
    [("lie-double", {"doubled"}), ("lie-old", {"doubled", "stale", "out of place"})],
)
def test_what_is_said_twice_changes_nothing(kind: str, reasons: set[str]) -> None:
    """The run has the rounds that it would have had, and the path."""
    found = lied(kind)
    assert found.outcome == "max-rounds"
    assert refused(found) <= {("process_1", reason) for reason in reasons}
    digests = {
        verify(each.recording).path_digest for each in (found, simulate(GRID, ListedFaults([])))
    }
    assert len(digests) == 1


def test_a_flood_is_counted_and_takes_few_lines() -> None:
    """Of dozens of messages two or three lines."""
    found = lied("lie-flood")
    records = [each for each in found.recording.records if each.kind == "refused"]
    assert 0 < len(records) <= 6
    assert {who for who, _ in refused(found)} == {"process_1"}


def test_who_says_that_it_heard_something_else_is_told_by_verify() -> None:
    """The only lie that ends no run: the check that fails names the module."""
    found = lied("lie-heard")
    assert found.outcome == "max-rounds"
    wrong = [check for check in verify(found.recording).checks if not check.ok]
    assert {check.name for check in wrong} <= {"deliveries", "hearing"}
    assert wrong
    assert all("module_" in check.detail and ": report" in check.detail for check in wrong)


@pytest.mark.slow
def test_a_verdict_turned_round_is_told_of_who_said_it() -> None:
    """Whoever believed it is not refused, though its report cannot be."""
    for seed in range(40):
        run = Scenario("agv:graph=K6,n=4", "random", 4, 0.0, 6, seed)
        for nth in range(12):
            found = simulate(run, ListedFaults([Fault(SAYING, nth, "lie-verdict")]))
            assert found.failure is None
            if found.fired:
                assert refused(found) == {("process_1", "impossible")}
                return
    raise AssertionError("no verdict to turn round")


class Forger(HostNode):
    """Says that its first module is elsewhere; it is no liar of the list."""

    def receive(self, key: str, data: bytes) -> list[Effect]:
        return [self._forged(effect) for effect in super().receive(key, data)]

    def _forged(self, effect: Effect) -> Effect:
        if not isinstance(effect, Put):
            return effect
        message = decode(effect.data)
        if not isinstance(message, Bundle) or self._config.process:
            return effect
        parts = [Presence(each.round, each.module, (11, 2)) for each in message.parts]
        return Put(effect.key, encode(msgspec.structs.replace(message, parts=parts)))


def test_who_is_accused_and_has_not_lied_is_a_failure() -> None:
    """The check that no honest process is refused can fail."""

    def make(orders: ProcessConfig, scene: Scene) -> Node:
        return Forger(orders, scene)

    found = simulate(GRID, ListedFaults([Fault(SAYING, 400, "lie-double")]), make=make)
    assert found.failure is not None
    assert found.failure.kind in ("accused", "ended")


def test_lies_are_listed_and_shown() -> None:
    """The list of faults gives the same run; the picture has a remark."""
    first = LockstepSwarm(LYING).run_of(4)
    assert any(fault.kind in LIES for fault in first.fired)
    trace = Trace()
    again = simulate(first.scenario, ListedFaults(first.fired), fault_seed=4, trace=trace)
    assert again.recording.records == first.recording.records
    assert any(remark.text.startswith("lies: ") for remark in trace.remarks)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 7, 11])
def test_without_lies_a_seed_is_what_it_was(seed: int) -> None:
    """Liars are drawn apart: until the first lie both runs are the same."""
    plain, lying = LockstepSwarm().run_of(seed), LockstepSwarm(LYING).run_of(seed)
    assert plain.scenario == lying.scenario
    if not any(fault.kind in LIES for fault in lying.fired):
        assert plain.recording.records == lying.recording.records


def test_every_kind_of_lie_is_drawn_and_in_some_runs_none() -> None:
    """One liar or two, by name."""
    kinds, liars = set[str](), Counter[int]()
    names = [f"process_{number}" for number in range(4)]
    for seed in range(60):
        faults = DrawnFaults(Random(seed), "coordinator", names, 10**6, Random(seed))  # noqa: S311
        liars[len(faults.liars)] += 1
        for name in names:
            found = (faults.at(name + SAYS, nth, LIES) for nth in range(100))
            told = {fault.kind for fault in found if fault is not None}
            assert not told or name in faults.liars
            kinds |= told
    assert kinds == set(LIES)
    assert liars.keys() == {0, 1, 2}


@pytest.mark.thorough
def test_some_seeds_with_liars_hold() -> None:
    """No honest process dies or is accused, and each path is verified."""
    runs = [LockstepSwarm(LYING).run_of(seed) for seed in range(8)]
    assert [run.failure for run in runs if run.failure] == []
    assert sum(run.outcome == LIE for run in runs) > 1


@pytest.mark.nightly
def test_a_hundred_and_fifty_seeds_with_liars_hold() -> None:
    """As above; each kind of lie is told."""
    told: Counter[str] = Counter()
    for seed in range(2050, 2200):
        found = LockstepSwarm(LYING).run_of(seed)
        assert found.failure is None, (seed, found.failure)
        told.update(fault.kind for fault in found.fired if fault.kind in LIES)
    assert told.keys() >= set(LIES) - {"lie-verdict", "lie-note"}
