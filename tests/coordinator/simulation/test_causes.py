"""The event that decided that a run fails: found, near what a planted bug did wrong, and drawn."""

import json
from pathlib import Path
from random import Random

import pytest

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.simulation import swarm
from cubepath.coordinator.simulation.causes import Point, cause_of
from cubepath.coordinator.simulation.faults import BranchedFaults, Fault, ListedFaults
from cubepath.coordinator.simulation.network import Trace
from cubepath.coordinator.simulation.scenarios import ScenarioOptions
from cubepath.coordinator.simulation.swarm import LockstepSwarm, shrunk
from cubepath.protocol.core.errors import CheckError
from exploration.guilty_events import judged, planted
from exploration.planted import WRONG, IsDeaf, TakesDoubles

LINES = ScenarioOptions("hex", "chain")


def test_a_run_goes_other_ways_only_from_its_point_on() -> None:
    """Up to a step a branch has the events of the run, and then another course."""
    run, whole, branch = LockstepSwarm(LINES).run_of(3), Trace(), Trace()
    listed = ListedFaults(run.fired)
    LockstepSwarm(LINES).play(3, run.scenario, listed, whole)
    faults = BranchedFaults(ListedFaults(run.fired), 100, [], Random(1), listed.asked)  # noqa: S311 - not for secrets
    LockstepSwarm(LINES).play(3, run.scenario, faults, branch)
    assert branch.events[:99] == whole.events[:99]
    assert branch.events[99:] != whole.events[99:]


def test_what_is_left_of_faults_comes_at_most_once_each() -> None:
    """And never where it was, unless drawn there; a link's fault stays on links."""
    left = [Fault("process_0 up", 7, "loss"), Fault("process_1", 3, "pause", 5)]
    random, asked = Random(2), {"link": 4, "process_ ": 4}  # noqa: S311 - not for secrets
    faults = BranchedFaults(ListedFaults(left), 1, list(left), random, asked)
    faults.begin()
    found = [
        fault
        for nth in range(200)
        for where in ("process_0 down", "process_2")
        if (fault := faults.at(where, nth)) is not None
    ]
    assert sorted(fault.kind for fault in found) == ["loss", "pause"]
    assert all((fault.kind == "loss") == fault.where.endswith("down") for fault in found)


def test_a_share_lies_within_its_interval() -> None:
    """Exactly, also of none and of all, so that it can be drawn."""
    for plays in range(1, 33):
        for failures in range(plays + 1):
            point = Point(0, 0.0, plays, failures)
            low, high = point.interval
            assert 0.0 <= low <= point.share <= high <= 1.0


@pytest.mark.thorough
def test_the_event_is_named_drawn_and_the_same_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command stops at the first failing seed, and says which event decided it."""
    WRONG.again()
    monkeypatch.setattr(swarm, "simulator_of", lambda _: LockstepSwarm(LINES, TakesDoubles))
    answers = []
    for folder in ("one", "two"):
        line = ["simulate", "--seeds", "3..9", "--why", "--json", "-o", str(tmp_path / folder)]
        assert main(line) == 1
        answers.append(json.loads(capsys.readouterr().out))
    (failed,) = answers[0]["failed"]
    cause = failed["cause"]
    assert (answers[0]["seeds"], cause) == (1, answers[1]["failed"][0]["cause"])
    assert sum(line.startswith(">") for line in cause["around"]) == 1
    assert 1 < len(cause["around"]) <= 17
    assert cause["what"] in "\n".join(cause["around"])
    assert (cause["fault"], "fault: duplicate" in cause["what"]) == (True, True)
    assert cause["around"][-1].startswith(f"  event {cause['events']},")
    by_event = {point["event"]: point for point in cause["points"]}
    assert by_event[cause["event"]]["probability"] > by_event[0]["probability"]
    assert all(each["low"] <= each["probability"] <= each["high"] for each in cause["points"])
    names = [Path(each).name for each in failed["pictures"]]
    assert names == [f"simulated-3-{what}" for what in ("messages.svg", "messages.png")] + [
        f"simulated-3-{what}" for what in ("why.svg", "why.png")
    ]
    assert all(Path(each).stat().st_size > 1000 for each in failed["pictures"])
    assert "decided here" in Path(failed["pictures"][0]).read_text()


@pytest.mark.slow
def test_a_bug_that_shows_whatever_happens_has_no_event() -> None:
    """That is said; nothing is named at random."""
    WRONG.again()
    simulator = LockstepSwarm(LINES, IsDeaf)
    run = shrunk(simulator.run_of(0), 0, simulator)
    cause, _ = cause_of(run, 0, simulator)
    assert (cause.event, cause.around) == (None, ())
    assert cause.what.startswith("it fails from the start on")


def test_a_run_that_fails_only_once_is_refused() -> None:
    """Its rule, or its bug, depends on something that is not in the run."""
    WRONG.again()
    simulator = LockstepSwarm(LINES, TakesDoubles)
    run = next(each for seed in range(3, 40) if (each := simulator.run_of(seed)).failure)
    with pytest.raises(CheckError, match="fails in another way or not at all"):
        cause_of(run, 3, LockstepSwarm(LINES))


@pytest.mark.slow
def test_it_is_near_what_a_bug_did_wrong() -> None:
    """Within ten events of the act without which the run holds."""
    distance = judged("TakesDoubles").distance
    assert distance is not None
    assert distance <= 10


@pytest.mark.nightly
@pytest.mark.thorough
def test_most_planted_bugs_are_found_within_ten_events() -> None:
    """Eight of twelve at least; one bug shows whatever happens, one long after it has acted."""
    found = [judged(name) for name in planted()]
    assert len(found) == 12
    assert sum(each.distance is not None and each.distance <= 10 for each in found) >= 8
    assert all(each.seconds < 120 for each in found)
