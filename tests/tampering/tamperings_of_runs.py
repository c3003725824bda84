"""Recordings that say something wrong of the run itself: its parameters, its pace, its end."""

from collections.abc import Callable
from dataclasses import replace as with_fields
from typing import Any

from msgspec.structs import replace

from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.wire.messages import (
    Bundle,
    Go,
    Message,
    Ready,
    Reports,
    Retransmit,
    Waiting,
    decode,
)
from samples.recordings import edited, first, record_of, recorded, with_records
from tampering.tamperings import crowd, tampers
from tampering.tamperings_of_schedules import not_begun, stopped, with_summary


def with_parameter(key: str, value: str) -> Recording:
    """Return a run with another parameter."""
    return with_fields(crowd(), parameters={**crowd().parameters, key: value})


@tampers("parameters")
def more_processes_than_modules() -> Recording:
    return with_parameter("processes", "9")


@tampers("parameters")
def modules_of_another_scene() -> Recording:
    return with_parameter("modules", "9")


@tampers("parameters")
def another_system() -> Recording:
    return with_parameter("system", "agv:graph=grid4x4,n=8")


@tampers("parameters")
def hesitation_that_is_certain() -> Recording:
    return with_parameter("hesitate", "1.0")


@tampers("parameters")
def rounds_that_are_no_number() -> Recording:
    return with_parameter("max_rounds", "10.0")


@tampers("parameters")
def a_repair_of_no_schedule() -> Recording:
    return with_parameter("repair", "tswap")


# Notes, of a rule that is not installed.


def with_note(*numbers: int) -> Recording:
    """Return a run of a rule that nobody knows, with another note in its third round."""
    whole = with_parameter("rule", "mine")
    note = first(whole, "note", lambda each: each.round == 3)
    return edited(whole, note, replace(note, note=list(numbers)))


@tampers("bundle")
def a_note_of_another_length() -> Recording:
    return with_note(1, 2)


@tampers("messages")
def a_note_that_is_no_int32() -> Recording:
    return with_note(1, 2, 3, 4, 5, 1 << 31)


@tampers("bundle")
def a_note_of_silence() -> Recording:
    return with_note(1, 2, 3, 4, 5, -(1 << 31))


# Batches.


def place_of(recording: Recording, where: Callable[[Any], object]) -> int:
    """Return the place of the first message on record of which `where` holds."""
    return next(n for n, each in enumerate(recording.records) if where(decode(each.data)))


def inserted(recording: Recording, place: int, *messages: Message) -> Recording:
    """Return the recording with more messages before a place."""
    records = [*recording.records]
    records[place:place] = map(record_of, messages)
    return with_records(recording, records)


def without(recording: Recording, where: Callable[[Any], object]) -> Recording:
    """Return the recording without the first message of which `where` holds."""
    records = [*recording.records]
    del records[place_of(recording, where)]
    return with_records(recording, records)


@tampers("batches")
def a_batch_of_nothing() -> Recording:
    """Return a run with one more batch, which is counted, and on which nothing depends."""
    whole = crowd()
    claims = place_of(whole, lambda each: isinstance(each, Go) and each.phase == "settle")
    records = [*whole.records]
    region = "9,9"

    def counting(place: int, message: Any) -> None:
        said = dict(sorted({**message.sent, region: 1}.items()))
        records[place] = with_fields(
            records[place], data=record_of(replace(message, sent=said)).data
        )

    counting(claims, decode(records[claims].data))
    ready = place_of(
        whole, lambda each: isinstance(each, Ready) and (each.phase, each.round) == ("claim", 1)
    )
    answer = decode(records[ready].data)
    assert isinstance(answer, Ready)
    counting(ready, answer)
    found = with_records(whole, records)
    return inserted(found, ready, Bundle(1, "claim", answer.process, region, 0, []))


@tampers("batches")
def a_note_by_itself() -> Recording:
    note = first(crowd(), "note")
    settle = place_of(
        crowd(), lambda each: isinstance(each, Go) and (each.phase, each.round) == ("claim", 2)
    )
    return inserted(crowd(), settle, note)


# The pace.


@tampers("pacing")
def a_phase_that_nobody_began() -> Recording:
    return without(crowd(), lambda each: isinstance(each, Go) and each.phase == "claim")


@tampers("pacing")
def a_phase_that_begins_twice() -> Recording:
    go = Go(2, "sense")
    return inserted(crowd(), place_of(crowd(), lambda each: each == go), go)


@tampers("pacing")
def two_phases_in_the_other_order() -> Recording:
    whole = crowd()
    records = [*whole.records]
    one = place_of(whole, lambda each: isinstance(each, Go) and each.phase == "claim")
    two = place_of(whole, lambda each: isinstance(each, Go) and each.phase == "settle")
    records[one], records[two] = records[two], records[one]
    return with_records(whole, records)


@tampers("pacing")
def a_process_that_did_not_answer() -> Recording:
    return without(crowd(), lambda each: isinstance(each, Ready) and each.round == 3)


@tampers("pacing")
def a_process_that_did_not_join() -> Recording:
    return without(crowd(), lambda each: isinstance(each, Ready) and each.phase == "join")


@tampers("pacing")
def an_answer_that_comes_twice() -> Recording:
    place = place_of(crowd(), lambda each: isinstance(each, Ready) and each.round == 3)
    answer = decode(crowd().records[place].data)
    return inserted(crowd(), place, answer)


@tampers("pacing")
def an_answer_of_no_process() -> Recording:
    place = place_of(crowd(), lambda each: isinstance(each, Ready) and each.round == 3)
    answer = decode(crowd().records[place].data)
    assert isinstance(answer, Ready)
    return inserted(crowd(), place, replace(answer, process=1))


@tampers("pacing")
def an_answer_that_counts_one_more() -> Recording:
    whole = crowd()
    answer = first(whole, "ready", lambda each: each.sent)
    region, count = next(iter(answer.sent.items()))
    return edited(whole, answer, replace(answer, sent={**answer.sent, region: count + 1}))


@tampers("pacing")
def a_phase_that_counts_one_less() -> Recording:
    whole = crowd()
    go = first(whole, "go", lambda each: each.sent)
    region, count = next(iter(go.sent.items()))
    return edited(whole, go, replace(go, sent={**go.sent, region: count - 1}))


@tampers("pacing")
def somebody_asks_who_is_nobody() -> Recording:
    place = place_of(crowd(), lambda each: isinstance(each, Ready) and each.round == 3)
    return inserted(crowd(), place, Retransmit(3, 5, "sense", "0,0"))


@tampers("pacing")
def somebody_waits_in_another_round() -> Recording:
    place = place_of(crowd(), lambda each: isinstance(each, Ready) and each.round == 3)
    return inserted(crowd(), place, Waiting(2, 0, "claim"))


@tampers("pacing")
def a_batch_that_comes_twice() -> Recording:
    place = place_of(crowd(), lambda each: isinstance(each, Bundle) and each.round == 3)
    return inserted(crowd(), place, decode(crowd().records[place].data))


@tampers("pacing")
def reports_that_come_twice() -> Recording:
    place = place_of(crowd(), lambda each: isinstance(each, Reports) and each.round == 3)
    return inserted(crowd(), place, decode(crowd().records[place].data))


@tampers("pacing")
def a_claim_that_came_before_its_phase() -> Recording:
    whole = crowd()
    place = place_of(whole, lambda each: isinstance(each, Bundle) and each.phase == "claim")
    records: list[Record] = [*whole.records]
    go = place_of(whole, lambda each: isinstance(each, Go) and each.phase == "claim")
    while decode(records[go].data).round != records[place].round:
        go += 1
    records.insert(
        next(n for n in range(place, -1, -1) if records[n].kind == "go"), records.pop(place)
    )
    return with_records(whole, records)


# The end.


@tampers("ended")
def a_run_that_was_not_interrupted() -> Recording:
    return with_summary(crowd(), ended="interrupted", error="interrupted")


@tampers("ended")
def a_module_that_never_gave_up() -> Recording:
    return with_summary(crowd(), ended="failed", error="module_3: I was tired")


@tampers("ended")
def an_error_of_a_run_that_had_none() -> Recording:
    return with_summary(crowd(), error="module_3: I was tired")


@tampers("ended")
def a_schedule_that_stopped_for_another_reason() -> Recording:
    return with_summary(stopped(), error="the schedule stopped at round 2: module_0: I was tired")


@tampers("ended")
def a_schedule_that_stopped_before_it_began() -> Recording:
    return with_summary(not_begun(), error="the schedule stopped at round 9: nobody was there")


@tampers("ended")
def a_run_that_goes_on_at_its_goal() -> Recording:
    whole = recorded("agv:graph=grid4x4,n=7", "random", rounds=3)
    place = first(whole, "report", lambda each: each.round == 2)
    assert place is not None
    sites = {
        report.site if not isinstance(report.site, list) else tuple(report.site)
        for report in reports_after(whole, 2)
    }
    scene = with_fields(whole.scene, goal=frozenset(sites), goals=())
    assert not scene.reached(tuple(each.site) for each in reports_after(whole, 3)), (
        "nobody moves in the last round"
    )
    return with_fields(whole, stored_scene=scene)


def reports_after(recording: Recording, number: int) -> list[Any]:
    """Return the reports of a round."""
    return [
        part
        for record in recording.of_kind("report")
        if (part := decode(record.data)).round == number
    ]


@tampers("ended")
def a_process_that_died_in_another_round() -> Recording:
    return died("module_3 (process 0) died in round 4: killed by signal 9")


@tampers("ended")
def a_process_that_died_and_is_none() -> Recording:
    return died("module_3 (process 5) died in round 10: killed by signal 9")


def died(error: str) -> Recording:
    """Return a run that ended before the last answer, with a line on why."""
    whole = crowd()
    last = first(whole, "summary").round
    cut = without(
        whole, lambda each: isinstance(each, Ready) and (each.phase, each.round) == ("settle", last)
    )
    return with_summary(cut, ended="failed", error=error)
