"""Kinds of faults by states of what they strike: the table of the tests, and what is met of it."""

import json
from itertools import product

import pytest

from cubepath.coordinator.simulation.faults import Fault, ListedFaults
from cubepath.coordinator.simulation.network import Trace
from cubepath.coordinator.simulation.scenarios import Scenario
from cubepath.coordinator.simulation.simulated import simulate
from cubepath.coordinator.simulation.swarm import LockstepSwarm, simulator_of
from cubepath.protocol.wire.messages import decode
from fault_states import ASKED, FILE, impossible, text_of, unmet, usual

TOLD = json.loads(FILE.read_text())


@pytest.mark.parametrize("nth", range(2, 9))
def test_a_fault_is_counted_in_the_phase_of_what_it_strikes(nth: int) -> None:
    """What is lost on its way from a process is of the phase in which the process is."""
    trace, faults = Trace(), ListedFaults([Fault("process_0 up", nth, "loss")])
    found = simulate(Scenario("hex:n=3", "chain", 2, 0.0, 9, 7), faults, trace=trace)
    (lost,) = (decode(arrow.data) for arrow in trace.arrows if arrow.fate == "lost")
    assert found.met == {("loss", getattr(lost, "phase", "settle")): 1}


@pytest.mark.parametrize("clock", ASKED)
def test_each_cell_is_met_or_not_or_cannot_be(clock: str) -> None:
    """One of the three, and the file is as it is written."""
    told, simulator = TOLD[clock], simulator_of(ASKED[clock])
    met = [(kind, state) for kind, counts in told["met"].items() for state in counts]
    cells = [*met, *map(tuple, told["unmet"]), *impossible(told)]
    assert sorted(cells) == sorted(product(simulator.kinds, simulator.states))
    assert FILE.read_text() == text_of(TOLD)


@pytest.mark.slow
@pytest.mark.parametrize("clock", ASKED)
def test_what_many_seeds_have_met_the_first_seeds_meet(clock: str) -> None:
    """Each cell that a third of the seeds met; tests/fault_states.py looks for the rest."""
    assert not unmet(simulator_of(ASKED[clock]), usual(TOLD[clock], 1 / 3), range(50))


def test_what_is_met_no_more_is_found() -> None:
    """And what is met is not."""
    cells = {("loss", "sense"), ("loss", "over")}
    assert unmet(LockstepSwarm(), cells, range(5)) == {("loss", "over")}
