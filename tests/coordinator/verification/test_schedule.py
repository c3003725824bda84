"""The check `schedule`: what it says, and where it has nothing to say."""

from collections.abc import Callable
from dataclasses import replace as with_fields
from math import inf

import pytest
from msgspec.structs import replace

from cubepath.coordinator.verification.ending import check_schedule
from cubepath.coordinator.verification.recording import verify
from cubepath.coordinator.verification.transcript import Sorting, Transcript
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.path_files.durations import schedule_from_jsonl, schedule_to_jsonl
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Go, Report
from samples.recordings import edited, first, record_of, with_records
from samples.schedules import VEHICLES, original
from tampering.tamperings import failing, moved
from tampering.tamperings_of_schedules import (
    carried_out,
    not_begun,
    stopped,
    with_cubes,
    with_summary,
)


def told(recording: Recording) -> str:
    """Return what the check says; nothing where it holds."""
    return next(each.detail for each in verify(recording).checks if each.name == "schedule")


def transcript_of(recording: Recording) -> Transcript:
    """Return the messages of a recording, sorted, with all rounds closed."""
    sorting = Sorting(recording, lambda _name, _where: None)
    sorting.take(recording.records)
    assert list(sorting.close(inf))
    sorting.end()
    return sorting.found


LOST = "there was one, but it is not on record"
GAVE_UP = "module_0 gave up in round 2: generator edge: [(1, 0), (1, 1)] is no edge of the graph"


@pytest.mark.parametrize(
    "make",
    [carried_out, stopped, not_begun, lambda: stopped(repair=True), lambda: original(*VEHICLES)],
)
def test_a_schedule_that_was_carried_out_or_stopped_holds(make: Callable[[], Recording]) -> None:
    """To its end, up to where it stopped, with a rule that took over, and where there was none."""
    assert verify(make()).ok


def test_a_parameter_or_the_summary_tells_that_there_was_one() -> None:
    """Each by itself: the name of its file, how many cubes it had, where it stopped."""
    lost = with_fields(carried_out(), schedule=None)
    untold = with_summary(lost, schedule_cubes=None)
    assert told(untold) == LOST
    unnamed = {key: value for key, value in lost.parameters.items() if key != "schedule"}
    assert told(with_fields(lost, parameters=unnamed)) == LOST
    assert told(with_fields(untold, parameters=unnamed)) == ""
    halted = with_fields(stopped(), schedule=None, parameters=unnamed)
    assert told(with_summary(halted, schedule_cubes=None)) == LOST


def test_a_move_that_was_due_and_not_made_is_named() -> None:
    """By its round, where nobody gave up."""
    report = first(carried_out(), "report", moved)
    placed = report.move
    found = told(edited(carried_out(), report, replace(report, move=None, site=report.before)))
    at = str([list(site) for site in placed.at]).replace(" ", "")
    assert found == f"round {report.round}: {placed.generator} at {at} is not made"


def test_a_rule_may_take_over_at_the_end_of_the_schedule_alone() -> None:
    """Before it, the schedule must have stopped; after it, there is nothing to say."""
    whole = carried_out()
    assert told(with_records(whole, [*whole.records, record_of(Go(50, "over"))])) == ""
    assert told(with_records(whole, [*whole.records, record_of(Go(9, "over"))])) == ""
    early = with_records(whole, [*whole.records, record_of(Go(3, "over"))])
    assert told(early) == "it was over after 3 of 8 cubes, and did not stop"
    records = list(whole.records)
    place = next(place for place, each in enumerate(records) if each.kind == "go")
    records[place] = with_fields(records[place], data=b"{}")
    assert failing(verify(with_records(whole, records))) == {"messages", "pacing"}
    # One that cannot be read hides none of those after it.
    records = list(stopped(repair=True).records)
    place = next(place for place, each in enumerate(records) if each.kind == "go")
    records[place] = with_fields(records[place], data=b"{}")
    assert told(with_records(stopped(repair=True), records)) == ""


def test_a_run_that_reached_its_goal_was_at_the_end_of_its_schedule() -> None:
    """One that was ended otherwise may have cubes left."""
    text = carried_out().schedule or b""
    cubes = schedule_from_jsonl(text)
    longer = with_fields(carried_out(), schedule=schedule_to_jsonl([*cubes, cubes[0]]))
    assert told(with_summary(longer, schedule_cubes=9)) == "the run ended after 8 of 9 cubes"
    assert told(with_summary(longer, schedule_cubes=9, ended="interrupted")) == ""


def test_a_stop_is_for_a_move_that_was_due_and_not_made() -> None:
    """In a round of the schedule, of its cube, and nobody has made it."""
    whole = stopped()
    stop = first(whole, "summary").schedule_stopped
    made = first_made(whole)
    placed = made.move
    wrong = "it did not stop for edge: not due, or it was made"
    for change in (replace(stop, round=1), replace(stop, round=99), replace(stop, round=0)):
        assert told(with_summary(whole, schedule_stopped=change)).startswith(GAVE_UP)
    assert told(with_summary(whole, schedule_stopped=replace(stop, move=placed))) == wrong
    last = schedule_from_jsonl(whole.schedule or b"")[-1][0]
    before = replace(stop, round=0, move=last)  # no cube has that number, nor has the last one
    assert told(with_summary(whole, schedule_stopped=before)) == f"{GAVE_UP} (and 1 more)"


def test_a_schedule_may_stop_in_its_last_cube() -> None:
    """The round of the stop is then that of the last cube."""
    stop = first(stopped(), "summary").schedule_stopped
    shorter = with_cubes(stopped(), 0, stop.round)
    assert told(with_summary(shorter, schedule_cubes=stop.round)) == ""


def first_made(recording: Recording) -> Report:
    """Return the report of a move in the round in which the schedule stopped."""
    stop = first(recording, "summary").schedule_stopped
    found: Report = first(
        recording, "report", lambda each: each.round == stop.round and each.move is not None
    )
    return found


def test_where_a_module_gave_up_others_may_stay_but_not_go_elsewhere() -> None:
    """Not even one of the moves that were due has to be made; a move that was not due is named."""
    recording = stopped()
    transcript = transcript_of(recording)
    number = transcript.complete_rounds
    carried = transcript.carried[number]
    assert carried.made
    found: list[str] = []

    def check() -> list[str]:
        found.clear()
        check_schedule(recording, transcript, lambda _name, where: found.append(where))
        return [where for where in found if "cube" in where or "not made" in where]

    assert check() == []
    transcript.carried[number] = carried._replace(made=frozenset())
    assert check() == []
    astray = frozenset({("edge", ((90, 0), (91, 0)))})
    transcript.carried[number] = carried._replace(made=astray)
    assert check() == [
        f"round {transcript.complete_rounds}: edge at [[90,0],[91,0]] is not in its cube"
    ]


def test_a_stop_is_not_for_the_one_move_that_was_made() -> None:
    """Where a round has a single move, and the summary says that it stopped there for that one."""
    recording = stopped()
    transcript = transcript_of(recording)
    number = transcript.complete_rounds
    carried = transcript.carried[number]
    made = min(carried.made, key=repr)
    transcript.carried[number] = carried._replace(made=frozenset({made}))
    summary = transcript.summary
    assert summary is not None
    stop = summary.schedule_stopped
    assert stop is not None
    move = GeneratorPlacement(made[0], made[1])
    transcript.summary = replace(summary, schedule_stopped=replace(stop, round=number, move=move))
    found: list[str] = []
    check_schedule(recording, transcript, lambda _name, where: found.append(where))
    assert f"it did not stop for {move.generator}: not due, or it was made" in found
