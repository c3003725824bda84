"""The check `ended`: where a run had to end, and what it says of that."""

from collections.abc import Callable
from dataclasses import replace as with_fields

import pytest

from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import run
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.messages import Ready
from samples.recordings import new_path, recorded
from samples.schedules import VEHICLES, carry_out, original, written
from tampering.tamperings import crowd, failing
from tampering.tamperings_of_runs import died, without
from tampering.tamperings_of_schedules import carried_out, not_begun, stopped, with_summary


def told(recording: Recording) -> str:
    """Return what the check says; nothing where it holds."""
    return next(each.detail for each in verify(recording).checks if each.name == "ended")


def at_its_goal() -> Recording:
    return recorded("agv:graph=grid4x4,n=7", "tswap", rounds=1000)


@pytest.mark.few(4)
@pytest.mark.parametrize(
    "make",
    [
        crowd,
        at_its_goal,
        carried_out,
        stopped,
        not_begun,
        lambda: stopped(repair=True),
        lambda: carry_out(original(*VEHICLES).path, max_rounds=3)[1],
        lambda: recorded("hex:n=3,bend=0,shift=0", "random"),
        lambda: recorded("hex:n=5", "chain", rounds=0),
    ],
)
def test_a_run_that_ended_as_it_had_to_holds(make: Callable[[], Recording]) -> None:
    """At its goal, after its rounds, where a schedule stopped or was repaired, or at once."""
    assert told(make()) == ""


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"ended": "goal"}, "it says goal, derived is max-rounds"),
        ({"ended": "failed", "error": "out of memory"}, "it says failed (out of memory), derived"),
        ({"ended": "interrupted", "error": "interrupted"}, "it says interrupted (interrupted), "),
        ({"error": "interrupted"}, "it says max-rounds (interrupted), derived is max-rounds"),
    ],
)
def test_a_finished_round_has_one_end(changes: dict[str, str], why: str) -> None:
    """All had answered, so the coordinator looked at the round, and nothing came between."""
    assert told(with_summary(crowd(), **changes)).startswith(why)


def unanswered() -> Recording:
    """Return a run whose last phase one process has not answered."""
    whole = crowd()
    last = verify(whole).rounds
    return without(
        whole, lambda each: isinstance(each, Ready) and (each.phase, each.round) == ("settle", last)
    )


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"ended": "interrupted", "error": "interrupted"}, ""),
        ({"ended": "interrupted"}, "it was interrupted, and says None"),
        ({"ended": "failed", "error": "out of memory"}, ""),
        ({"ended": "failed"}, "it failed, and says None, expected one line"),
        ({"ended": "failed", "error": "two\nlines"}, "it failed, and says 'two\\nlines', expected"),
        ({}, "it says max-rounds, but process_0 has not answered phase settle of round 10"),
    ],
)
def test_a_round_that_was_not_finished_was_ended_from_outside(
    changes: dict[str, str], why: str
) -> None:
    """By an interrupt or a failure, which says why; not by its goal or its rounds."""
    recording = unanswered()
    found = told(with_summary(recording, **changes) if changes else recording)
    assert found.startswith(why)
    assert (found == "") == (why == "")


def test_what_is_said_of_the_dead_and_the_late_fits_the_phase() -> None:
    """The process is one of the run, the round that in which it was."""
    assert told(died("module_3 (process 0) died in round 10: killed by signal 9")) == ""
    assert told(died("module_3 (process 0) died in round 9: killed by signal 9")) != ""
    assert told(died("module_3 (process 1) died in round 10: killed by signal 9")) != ""
    late = "no answer within 60 s to phase {} of round {} from module_3 (process 0)"
    assert told(died(late.format("settle", 10))) == ""
    assert told(died(late.format("claim", 10))) != ""
    assert told(died(late.format("settle", 9))) != ""


def test_nobody_gave_up_whom_no_report_says_so() -> None:
    """A line of a module needs its report, a stop of the schedule its place in the summary."""
    for line in ("module_3: I was tired", "the schedule stopped at round 2: nobody was there"):
        assert told(died(line)) == f"it says {line!r}, which no module says"


def test_without_a_parameter_rounds_may_end_anywhere() -> None:
    """Nobody knows how many there may be; an error is none of them."""
    whole = crowd()
    less = {key: value for key, value in whole.parameters.items() if key != "max_rounds"}
    assert told(with_fields(whole, parameters=less)) == ""
    wrong = with_summary(with_fields(whole, parameters=less), error="out of memory")
    assert told(wrong) == "it says max-rounds (out of memory), derived is no end"
    fewer = with_fields(whole, parameters={**whole.parameters, "max_rounds": "5"})
    assert told(fewer).startswith("it continues after round 5: max-rounds")


def exchanged(scene: Scene) -> Scene:
    """Return a labelled scene that starts at its goal, but for two vehicles in each other's."""
    places = [goals[0] for goals in scene.goals]
    places[:2] = reversed(places[:2])
    return with_fields(scene, start=tuple((place, n) for n, place in enumerate(places)))


def test_labels_decide_whether_a_goal_is_reached() -> None:
    """Vehicles on the right places are not at the goal while two of them are exchanged."""
    scene = exchanged(scene_from_spec("agv-labelled:graph=grid4x4,n=6"))
    path = new_path()
    run(Plan(written(scene), "pibt", processes=0, max_rounds=0, log=path))
    recording = read_recording(path)
    assert verify(recording).ok
    claimed = with_summary(recording, ended="goal", goal_reached=True)
    assert failing(verify(claimed)) == {"summary", "ended"}
    assert told(claimed) == "it says goal, derived is max-rounds"
