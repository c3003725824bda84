"""The pace of a run that is watched."""

import math

import pytest
from hypothesis import given, strategies as st

from cubepath.coordinator.tools.live.watching import STEPS_MAX, RoundPacer
from cubepath.protocol.core.errors import InputError


@given(st.lists(st.sampled_from(["pause", "resume", "step", "round"]), max_size=30))
def test_a_paused_run_plays_the_rounds_that_are_asked_for(orders: list[str]) -> None:
    """As in a count by hand: orders that come twice count once, but for steps."""
    pace, paused, due = RoundPacer(), False, 0
    for order in orders:
        if order == "round":
            goes = not paused or due > 0
            assert pace.left() == (0.0 if goes else math.inf)
            due -= paused and goes
            continue
        pace.order(order)
        due = 0 if order == "resume" or not paused else due
        paused = order != "resume"
        due += order == "step"
        assert pace.state == {"paused": paused, "steps": due, "rate": None}


def test_a_rate_keeps_rounds_apart_and_steps_need_not_wait() -> None:
    """At 0.1 rounds a second the second round waits about ten seconds; a step is at once."""
    pace = RoundPacer(rate=0.1)
    assert pace.left() == 0.0
    assert 5 < pace.left() <= 10
    pace.order("step", 2)
    assert [pace.left(), pace.left(), pace.left()] == [0.0, 0.0, math.inf]
    pace.order("rate", None)
    pace.order("resume")
    assert [pace.left(), pace.left()] == [0.0, 0.0]


@pytest.mark.parametrize(
    ("order", "value", "told"),
    [
        ("halt", None, "expected one of pause, resume, step, rate"),
        ("rate", 0, "expected more than 0"),
        ("rate", math.nan, "expected more than 0"),
        ("rate", "fast", "expected a number"),
        ("step", 0, "expected 1 or more"),
        ("step", 1.5, "expected 1 or more"),
        ("step", STEPS_MAX + 1, "expected at most 1000"),
    ],
)
def test_what_is_no_order_is_refused(order: str, value: object, told: str) -> None:
    """In one line, and the run goes on as before, or waits."""
    pace = RoundPacer()
    with pytest.raises(InputError, match=told):
        pace.order(order, value)
    assert pace.state["steps"] == 0
