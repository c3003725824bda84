"""Processes of a run with rounds that die or stand still: what is tolerated, and what is told."""

import re
from typing import Any

import pytest

from cubepath.coordinator.testing.fixtures import RunFixture
from cubepath.coordinator.testing.run_under_test import RunUnderTest

MORE = 10
"""How many rounds show that a run goes on."""


def begun(start: RunFixture, processes: int = 2, **options: Any) -> RunUnderTest:
    """Start a run that has no end, and play some rounds of it."""
    run = start("hex:n=6", "random", max_rounds=10**6, processes=processes, links=False, **options)
    run.step(5)
    return run


@pytest.mark.slow
def test_a_module_process_that_dies_ends_the_run(cubepath_run: RunFixture) -> None:
    """One clear line naming the modules, and a whole recording."""
    run = begun(cubepath_run, 3)
    run.kill("process_0")
    outcome = run.play(failing=True)
    assert re.match(r"module_0, module_1 \(process 0\) died in round \d+", outcome.error or "")
    run.finish().assert_legal()


@pytest.mark.thorough
def test_a_router_that_dies_is_started_again(cubepath_run: RunFixture) -> None:
    """What was on its way is lost and asked for again."""
    run = begun(cubepath_run)
    run.kill("router")
    run.step(MORE)
    run.finish().assert_legal()


@pytest.mark.parametrize(
    "seconds",
    [pytest.param(1.5, marks=pytest.mark.thorough), pytest.param(12, marks=pytest.mark.nightly)],
)
@pytest.mark.parametrize("who", ["process_0", "router"])
def test_who_stands_still_is_waited_for(cubepath_run: RunFixture, who: str, seconds: float) -> None:
    """Longer than it takes to ask again, and than the lease of a link."""
    run = begun(cubepath_run, patience=100.0)
    run.pause(who, seconds=seconds)
    run.until_round(run.round + MORE, timeout_s=100)
    run.finish().assert_legal()


@pytest.mark.thorough
def test_who_is_late_is_named_when_patience_is_over(cubepath_run: RunFixture) -> None:
    """The one that stands still and not those that wait for it; the recording is whole."""
    run = begun(cubepath_run, 3, patience=4.0)
    run.pause("process_1")
    outcome = run.play(timeout_s=60, failing=True)
    assert re.fullmatch(
        r"no answer within 4 s to phase \w+ of round \d+ from module_2, module_3 \(process 1\)",
        outcome.error or "",
    )
    run.finish().assert_legal()
