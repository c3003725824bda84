"""The check `pacing`: the phases of a run, in the order in which they were recorded."""

from dataclasses import replace as with_fields

import pytest

from cubepath.coordinator.verification.pacing import Pacing
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import (
    Bundle,
    Go,
    Message,
    Observations,
    Ready,
    Reports,
    Retransmit,
    Waiting,
)
from samples.recordings import recorded
from tampering.tamperings import crowd


def of_two(recording: Recording | None = None) -> tuple[Pacing, list[str]]:
    """Return the pacing of a run of two processes, and what it will say."""
    whole = crowd() if recording is None else recording
    found: list[str] = []
    known = with_fields(whole, parameters={**whole.parameters, "processes": "2"})
    return Pacing(known, lambda _, line: found.append(line)), found


def said(*messages: Message) -> list[str]:
    """Return what is said of some messages of a run of two processes."""
    pacing, found = of_two()
    for message in messages:
        pacing.take(message)
    return found


JOINED = (Ready(0, 1, "join"), Ready(0, 0, "join"))
SENSED = (
    *JOINED,
    Go(1, "sense"),
    Bundle(1, "sense", 0, "0,0", 0, []),
    Ready(1, 0, "sense", {"0,0": 1}),
    Ready(1, 1, "sense", {"0,0": 1, "0,1": 1}),
    Bundle(1, "sense", 1, "0,1", 0, []),
    Bundle(1, "sense", 1, "0,0", 0, []),
)
CLAIMED = (
    *SENSED,
    Go(1, "claim", {"0,0": 2, "0,1": 1}),
    Ready(1, 0, "claim"),
    Ready(1, 1, "claim"),
)
SETTLED = (
    *CLAIMED,
    Go(1, "settle"),
    Reports(1, 0, []),
    Reports(1, 1, []),
    Ready(1, 0, "settle"),
    Ready(1, 1, "settle"),
)


@pytest.mark.parametrize(
    "more",
    [
        (),
        (Go(2, "sense"),),
        (Go(1, "over"), Ready(1, 0, "over"), Ready(1, 1, "over"), Go(2, "sense")),
        (Go(1, "stop"),),
        (Retransmit(1, 1, "settle", "0,0"), Waiting(1, 0, "settle"), Waiting(1, 0, "settle")),
    ],
)
def test_a_round_has_its_phases(more: tuple[Message, ...]) -> None:
    """Answers and what they count come in any order; a schedule may end between two rounds."""
    assert said(*SETTLED, *more) == []


def test_modules_may_be_driven_from_outside() -> None:
    """They observe before they claim; what was said is counted for the observations."""
    observed: tuple[Message, ...] = (
        Go(1, "observe", {"0,0": 2, "0,1": 1}),
        *(Observations(1, process, []) for process in (0, 1)),
        *(Ready(1, process, "observe") for process in (0, 1)),
    )
    assert said(*SENSED, *observed, Go(1, "claim")) == []
    assert said(*SENSED, *observed[:2], *observed[3:], Go(1, "claim")) == [
        "round 1: go claim, but process_1 has sent no observations in round 1"
    ]


@pytest.mark.parametrize(
    ("messages", "why"),
    [
        ((*JOINED[:1], Go(1, "sense")), "but process_0 has not answered phase join of round 0"),
        ((*JOINED, Go(2, "sense")), "round 2: go sense after phase join of round 0"),
        ((*SENSED, Go(1, "settle")), "round 1: go settle after phase sense of round 1"),
        ((*SENSED, Go(1, "claim", {"0,0": 3})), "counts {'0,0': 3} messages, said were"),
        ((*CLAIMED, Go(1, "settle", {"0,0": 1})), "counts {'0,0': 1} messages, said were {}"),
        ((*SETTLED[:-3], Go(2, "sense")), "but process_0 has not answered phase settle"),
        (
            (*SETTLED[:-3], *SETTLED[-2:], Go(2, "sense")),
            "but process_1 has sent no reports in round 1",
        ),
        ((*SENSED, Bundle(1, "sense", 0, "0,0", 0, [])), "bundle of phase sense, a second time"),
        ((*SENSED, Ready(1, 1, "sense")), "ready of phase sense, a second time"),
        ((*SETTLED, Reports(1, 1, [])), "process_1: reports, a second time"),
        ((*SENSED, Reports(1, 1, [])), "process_1: reports, in phase sense of round 1"),
        ((*SENSED, Ready(1, 1, "claim")), "ready of phase claim, in phase sense of round 1"),
        ((*SENSED, Ready(1, -1, "sense")), "process_-1: ready of phase sense, which is no process"),
        ((*SENSED, Waiting(1, 2, "claim")), "process_2: waiting of phase claim, which is no"),
        ((*SENSED, Retransmit(2, 1, "sense", "0,0")), "retransmit of phase sense, in round 1"),
        ((*SETTLED, Go(0, "stop")), "round 0: go stop in round 1, or a second time"),
        ((*SETTLED, Go(1, "stop"), Go(1, "stop")), "go stop in round 1, or a second time"),
        ((*SETTLED, Go(1, "stop"), Go(2, "sense")), "go sense, after all were ordered to stop"),
    ],
)
def test_what_does_not_fit_is_named(messages: tuple[Message, ...], why: str) -> None:
    """The first thing that is said of it, in one line with the round and the process."""
    found = said(*messages)
    assert found
    assert why in found[0]


def test_what_is_counted_and_not_there_is_missing() -> None:
    """In the phase that was begun last."""
    pacing, _ = of_two()
    for message in SENSED[:-2]:
        pacing.take(message)
    assert pacing.missing() == 2
    assert pacing.unfinished() == (
        "process_1 counts {'0,0': 1, '0,1': 1} messages in phase sense of round 1, on record are {}"
    )


def test_without_a_parameter_those_who_joined_are_the_processes() -> None:
    """Each of them has to answer, and nobody else is a stranger."""
    found: list[str] = []
    pacing = Pacing(with_fields(crowd(), parameters={}), lambda _, line: found.append(line))
    for message in (Ready(0, 3, "join"), Go(1, "sense"), Go(1, "claim")):
        pacing.take(message)
    assert found == ["round 1: go claim, but process_3 has not answered phase sense of round 1"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "processes", [2, *(pytest.param(each, marks=pytest.mark.thorough) for each in (1, 3))]
)
def test_real_runs_keep_their_pace(processes: int) -> None:
    """Whichever process is first."""
    whole = recorded("hex-open:n=6", rounds=8, seed=3, hesitate=0.2, processes=processes)
    found = verify(whole)
    assert found.ok, [check for check in found.checks if not check.ok]
