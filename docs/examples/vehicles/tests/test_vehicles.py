"""Vehicles in real processes, on a bad network: ``python -m pytest`` in the folder above."""

from pathlib import Path

import pytest
from hypothesis import given, settings

from cubepath.coordinator.testing import RunFixture, Trial, scenarios

WANDER = f"{Path(__file__).parents[1] / 'vehicles.py'}:WANDER"
CITY = "agv:graph=grid4x4,n=4"


def test_a_vehicle_that_dies_comes_back(cubepath_run: RunFixture) -> None:
    """Without rounds: a process is killed while its vehicles drive, and started again."""
    run = cubepath_run(CITY, clock="free")
    run.until_moves(3)
    run.kill("process_1")
    run.restart("process_1")
    run.until_goal()
    log = run.finish()
    log.assert_legal()
    log.assert_goal()


@pytest.mark.cubepath(seeds=range(2))
def test_what_the_wire_does_changes_nothing(cubepath_run: RunFixture) -> None:
    """Messages are lost and doubled: the run is the same as on a good wire."""
    bad = cubepath_run(CITY, WANDER, max_rounds=8)
    lost = bad.drop("said", probability=0.05, seed=1, times=3)
    twice = bad.double("reports")
    bad.play()
    good = cubepath_run(CITY, WANDER, max_rounds=8, links=False)
    good.play()
    assert twice.count >= 8
    assert lost.count <= 3
    bad.finish().assert_same_run(good.finish())


def test_nobody_waits_for_a_vehicle_for_ever(cubepath_run: RunFixture) -> None:
    """A process stands still in the third round for a moment, and nothing else is lost."""
    run = cubepath_run(CITY, WANDER, max_rounds=6)
    paused = run.pause("process_0", at=3, seconds=0.5)
    assert run.play().rounds == 6
    assert paused.done
    log = run.finish()
    log.assert_legal()
    assert log.count("claim", round=6)


@given(scenarios(CITY, WANDER, max_rounds=8))
@settings(max_examples=10, deadline=None)
def test_no_fault_that_is_tolerated_is_noticed(trial: Trial) -> None:
    """Faults by hypothesis, in virtual time; what fails shrinks to few faults and small numbers."""
    trial.check().log.assert_legal()


def test_the_log_says_who_claimed_what(cubepath_run: RunFixture) -> None:
    """And what each process said."""
    run = cubepath_run(CITY, WANDER, max_rounds=5)
    run.play()
    log = run.finish()
    assert {claim.result for claim in log.claims()} <= {"granted", "lost"}
    assert len(log.claims(result="granted")) == len(log.moves)
    assert len(log.deliveries("reports", sender="process_0")) == 5
