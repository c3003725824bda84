"""Strategies of faults and of runs with faults: what they draw holds, and what fails shrinks."""

from typing import Any

import pytest
from hypothesis import find, given, settings, strategies as st

from cubepath.coordinator.simulation.faults import ENDING, FREE_KINDS, KINDS
from cubepath.coordinator.testing.network import NetworkFault
from cubepath.coordinator.testing.strategies import (
    Trial,
    fault,
    faults,
    network_faults,
    scenarios,
    trial_of,
)
from cubepath.protocol.core.errors import InputError
from exploration.planted import ForgetsCounts, IsDeaf, Raises

pytestmark = pytest.mark.slow
SMALL = ["agv:graph=C6,n=2", "hex:n=3"]


@given(scenarios(SMALL))
@settings(max_examples=30)
def test_what_is_tolerated_changes_nothing(trial: Trial) -> None:
    """The path is the same, and the log legal; two systems with their own rules."""
    found = trial.check()
    assert found.goal_reached
    found.log.assert_legal()


@given(scenarios("hex:n=3", clock="free", most=4))
@settings(max_examples=15)
def test_runs_without_rounds_hold_under_all_faults(trial: Trial) -> None:
    """Crashes among them."""
    trial.check()


@given(scenarios("hex:n=3", endings=True))
@settings(max_examples=15)
def test_a_run_that_a_fault_ends_says_so(trial: Trial) -> None:
    """Whoever was struck is named: that is part of what a trial checks."""
    found = trial.check()
    ended = any(fault.kind in ENDING for fault in found.fired)
    assert ended or found.goal_reached


@given(st.sampled_from(["lockstep", "free"]), st.data())
def test_what_is_drawn_can_come_to_pass(clock: Any, data: st.DataObject) -> None:
    """Each kind at a place where there is such a thing, one at a place and count."""
    known = FREE_KINDS if clock == "free" else set(KINDS) - ENDING
    found = data.draw(faults(clock=clock, processes=3, most=12))
    assert {fault.kind for fault in found} <= set(known)
    assert len({(fault.where, fault.nth) for fault in found}) == len(found)
    assert sum(fault.amount_us for fault in found if clock == "lockstep") < 30_000_000


SOME = ["delay", "loss", "duplicate"]
"""Of all kinds one run in a hundred has a fault that a bug shows by; of these, far more have."""


@pytest.mark.thorough
@pytest.mark.parametrize(("bug", "kinds"), [(Raises, ["loss"]), (ForgetsCounts, SOME)])
def test_a_failing_run_shrinks_to_one_fault(bug: Any, kinds: list[str]) -> None:
    """Early, and in a small run: what hypothesis shows is what one would write by hand."""

    def fails(trial: Trial) -> bool:
        return trial.play(bug).run.failure is not None

    found = find(
        scenarios("agv:graph=C6,n=2", kinds=kinds, most=3 * len(kinds)),
        fails,
        settings=settings(max_examples=2000, database=None),
    )
    assert len(found.faults) <= 1
    assert found.scenario.seed == 0
    assert found.scenario.hesitate == 0.0
    with pytest.raises(AssertionError) as told:
        found.check(bug)
    text = str(told.value)
    assert "system agv:graph=C6,n=2, rule tswap, seed 0, " in text
    assert text.count("fault: ") == len(found.play(bug).fired)
    assert len(text.splitlines()) < 30


def test_what_fails_is_told_with_its_faults() -> None:
    """The system, the seed, the fault and the last messages: enough to write it down by hand."""
    trials_of = (
        trial_of("agv:graph=C6,n=2", faults=[fault("loss", "process_0 down", nth)])
        for nth in range(30)
    )
    trial = next(each for each in trials_of if each.play(Raises).run.failure is not None)
    assert trial.check().fired == trial.faults
    with pytest.raises(AssertionError) as told:
        trial.check(Raises)
    text = str(told.value)
    assert "system agv:graph=C6,n=2, rule tswap, seed 0, 2 processes, hesitate 0" in text
    assert f"fault: loss at process_0 down, number {trial.faults[0].nth}\n" in text
    assert "the last messages:" in text


def test_a_trial_is_the_same_run_each_time() -> None:
    """Bit for bit, whatever was done before."""
    struck = [fault("loss", "process_0 up", 3), fault("router", "router", 9, 0.005)]
    trial = trial_of("hex:n=4", faults=struck)
    one, other = trial.play(), trial.play()
    assert one.log.recording.records == other.log.recording.records
    assert {fault.kind for fault in one.fired} == {"loss", "router"}


def test_a_node_of_ones_own_is_tried_as_any_other() -> None:
    """A deaf one ends the run, and the text says who it was."""
    with pytest.raises(AssertionError, match="tolerable faults ended it"):
        trial_of("hex:n=3", processes=1).check(IsDeaf)


def wrong(value: Any) -> Any:
    """Return what no type checker lets pass."""
    return value


@pytest.mark.parametrize(
    ("make", "line"),
    [
        (lambda: faults(kinds=["rain"]), "fault rain: expected one of delay, "),
        (lambda: faults(kinds=["torn"]), "fault torn: expected one of delay, "),
        (lambda: faults(most=13), "most=13: expected 0 to 12"),
        (lambda: trial_of("hex:n=3", faults=[fault("rain", "x")]), "fault rain: expected one"),
        (
            lambda: trial_of("hex:n=3", faults=[fault("router", "x")]),
            "fault router at x: expected one of router",
        ),
        (
            lambda: trial_of("hex:n=4", faults=[fault("pause", "proces_0", 12, seconds=1)]),
            r"fault pause at proces_0: expected one of .* \(did you mean 'process_0'\?\)",
        ),
        (
            lambda: trial_of("hex:n=4", faults=[fault("loss", "process_99 up")]),
            "fault loss at process_99 up: expected one of process_0 up, ",
        ),
        (
            lambda: trial_of("hex:n=4", faults=[fault("pause", "process_0")]),
            "fault pause at process_0: seconds=0, expected more",
        ),
        (lambda: fault("pause", "process_0", nth=wrong("x")), "nth='x': expected 0 or more"),
        (lambda: trial_of("hex:n=3", "nope"), "unknown rule 'nope'"),
        (
            lambda: trial_of("hex:n=3", clock="free").check(IsDeaf),
            r"make: only for runs with rounds",
        ),
        (lambda: trial_of("hex:n=3", clock="free").check().log, "log: a simulated run without"),
    ],
)
def test_what_cannot_be_tried_is_one_line(make: Any, line: str) -> None:
    """As everywhere."""
    with pytest.raises(InputError, match=f"^{line}"):
        make()


@given(network_faults(["arm", "leg"], keys=["robot/*/set"]))
def test_faults_of_own_processes_are_short_to_read(drawn: list[NetworkFault]) -> None:
    """What means nothing for a kind is as by default, and what is as by default is not written."""
    for each in drawn:
        assert eval(repr(each)) == each  # noqa: S307 - it is to be written down
        assert each.key == "robot/*/set"
        assert each.count == 1 or each.kind not in ("pause", "restart")
        assert each.way == "up" or each.kind != "cut"
        assert each.seconds == 0.1 or each.kind in ("pause", "delay", "double")


def test_a_fault_of_an_own_process_shrinks_to_one_line() -> None:
    """And keys that are none are refused."""
    found = find(network_faults(["arm"], kinds=["restart"], keys=["a", "b"]), lambda each: each)
    assert repr(found) == "[NetworkFault('restart', 'arm', key='a')]"
    with pytest.raises(
        InputError, match=r"^keys='a': expected key expressions, as \['robot/arm'\]$"
    ):
        network_faults(["arm"], keys="a")
    with pytest.raises(InputError, match=r"^key='a//': expected a key expression of zenoh"):
        NetworkFault("cut", "arm", key="a//")
