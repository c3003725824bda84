"""Verifying batches: whatever is wrong with one, or with a part of it, is found and named."""

from typing import Any

import pytest
from msgspec.structs import replace

from cubepath.coordinator.runs.gathering import gathered
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.wire.keys import topic_of
from cubepath.protocol.wire.messages import (
    Bundle,
    Message,
    Report,
    Reports,
    Retransmit,
    Waiting,
    decode,
    encode,
    kind_of,
)
from samples.batched import first_batch
from samples.recordings import edited, first, recorded, with_records
from tampering.tamperings import crowd, failing


def whole() -> Recording:
    """Return a real run."""
    return crowd()


def with_message(recording: Recording, place: int, *messages: Message) -> Recording:
    """Return the recording with messages in place of one."""
    records = list(recording.records)
    records[place : place + 1] = [
        Record(topic_of(each), encode(each), each.round, 0, 0) for each in messages
    ]
    return with_records(recording, records)


def said_of(recording: Recording, check: str) -> str:
    """Return what is said of a check."""
    return next(each.detail for each in verify(recording).checks if each.name == check)


def test_the_parts_of_a_kind_are_found_in_batches() -> None:
    """`of_kind` gives them as records of their own, with their own topics; none stands alone."""
    assert not {"presence", "note", "claim", "verdict", "report"} & {
        each.kind for each in whole().records
    }
    reports = [(each.topic, each.round) for each in whole().of_kind("report")]
    rounds = len(list(whole().of_kind("edges")))
    assert sorted(reports) == sorted(
        (f"report/module_{module}", number)
        for module in range(len(whole().scene.start))
        for number in range(1, rounds + 1)
    )
    batch = next(whole().of_kind("reports"))
    parts = list(batch.parts())
    assert {(each.sequence, each.wall_ns) for each in parts} == {(batch.sequence, batch.wall_ns)}
    summary = next(crowd().of_kind("summary"))
    assert list(summary.parts()) == [summary]


def test_what_is_said_or_asked_again_is_no_fault() -> None:
    """Parts for several regions, `again` and `waiting`, as often as they come."""
    recording = whole()
    place, batch = first_batch(recording, "claim", 2)
    more: tuple[Message, ...] = (Retransmit(2, 0, "claim", "elsewhere"), Waiting(2, 0, "claim"))
    assert verify(with_message(recording, place, *more, batch, *more, *more)).ok


def test_a_part_that_differs_between_two_batches_is_named() -> None:
    """By its own kind and module."""
    recording = whole()
    place, batch = first_batch(recording, "note", 3)
    assert isinstance(batch, Bundle)
    at = next(n for n, part in enumerate(batch.parts) if kind_of(part) == "note")
    parts: list[Any] = [*batch.parts]
    parts[at] = replace(parts[at], note=[9 for _ in parts[at].note])
    found = with_message(recording, place, batch, replace(batch, region="other", parts=parts))
    module = parts[at].module
    told = said_of(found, "bundle")
    assert told.startswith(f"round 3, module_{module}: note comes twice, and differs (and ")


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"region": "7,7"}, "goes to region 7,7 in vain"),
        ({"number": 2}, "what it said to region 0,0 in phase claim is numbered [2], not from 0 on"),
        ({"phase": "sense"}, "claim was sent in phase sense, not in claim"),
        ({"parts": []}, "it heard claim of module_"),
    ],
)
def test_a_batch_goes_where_its_parts_are_for(change: dict[str, Any], told: str) -> None:
    """To their regions and no other, in their phase, numbered from 0 on, and nothing is lost."""
    recording = whole()
    place, batch = first_batch(recording, "claim", 2)
    found = verify(with_message(recording, place, replace(batch, **change)))
    assert not found.ok
    assert any(told in each.detail for each in found.checks if not each.ok)


def test_a_part_goes_to_every_region_that_it_is_for() -> None:
    """A batch less than there are regions is named; so is a module that changes its process."""
    recording = recorded("agv:graph=grid12x12,n=30", "random", rounds=4, processes=2)
    assert verify(recording).ok
    places = [
        (place, message)
        for place, message in enumerate(decode(each.data) for each in recording.records)
        if isinstance(message, Bundle) and message.phase == "sense" and message.round == 2
    ]
    assert len({message.region for _, message in places}) >= 2
    for place, message in places:
        told = said_of(with_message(recording, place), "bundle")
        assert "no presence" in told or f"does not go to region {message.region}" in told
    place, batch = first_batch(recording, "report", 3)
    other = replace(batch, process=1 - batch.process)
    told = said_of(with_message(recording, place, batch, other), "bundle")
    assert f"comes from process_{other.process}, but the module is in process_" in told


def test_a_part_of_another_round_than_its_batch_is_named() -> None:
    """With the message that holds it."""
    recording = whole()
    place, batch = first_batch(recording, "report", 4)
    assert isinstance(batch, Reports)
    late = replace(batch.parts[0], round=5)
    found = with_message(recording, place, replace(batch, parts=[late, *batch.parts[1:]]))
    where = f"message {place} (reports/process_{batch.process}, round 4)"
    told = said_of(found, "messages")
    assert told == f"{where} holds report/module_{late.module} of round 5"


def test_a_batch_under_another_topic_or_round_is_named() -> None:
    """As a single message is."""
    recording = whole()
    place, batch = first_batch(recording, "presence", 2)
    records = list(recording.records)
    wrong = Record("bundle/process_7", encode(batch), 3, 0, place)
    records[place] = wrong
    told = said_of(with_records(recording, records), "messages")
    assert told == (
        f"message {place} (bundle/process_7, round 3) is bundle/process_{batch.process} of round 2"
    )


@pytest.mark.parametrize("change", ["twice", "unsaid", "missed"])
def test_what_a_module_heard_is_checked_by_kind_and_sender(change: str) -> None:
    """A report tells senders alone; one too many or too few is found."""
    recording = whole()
    place, batch = first_batch(recording, "report", 2)
    assert isinstance(batch, Reports)
    heard = [part.received for part in batch.parts]
    at = next(place for place, each in enumerate(heard) if len(each.get("presence", ())) > 1)
    report, here = batch.parts[at], heard[at]["presence"]
    told = {"twice": [here[0], *here], "unsaid": [*here, report.module], "missed": here[1:]}[change]
    parts = [*batch.parts]
    parts[at] = replace(report, received={**heard[at], "presence": told})
    found = with_message(recording, place, replace(batch, parts=parts))
    assert failing(verify(found)) == {"hearing" if change == "missed" else "deliveries"}


def test_what_contradicts_or_cannot_be_read_is_named_by_report_or_batch() -> None:
    """Nothing is gathered then; of a right recording the path of the run is."""
    assert gathered(whole()).digest == first(crowd(), "summary").path_digest
    recording = recorded("agv:graph=grid4x4,n=7", "tswap", rounds=4, processes=2)
    place, batch = first_batch(recording, "report", 2)
    assert isinstance(batch, Reports)
    other = replace(batch, parts=[replace(part, failed="no") for part in batch.parts])
    with pytest.raises(CheckError, match=r"report \d+ \(report/module_\d\): .* differently"):
        gathered(with_message(recording, place, batch, other))
    records = list(recording.records)
    records[place] = Record(records[place].topic, b"{}", 2, 0, place)
    with pytest.raises(InputError, match=r"report \d+ \(reports/process_\d\): not a cubepath"):
        gathered(with_records(recording, records))


def test_a_report_by_itself_counts_in_a_recording_of_batches_but_is_named() -> None:
    """A batch and single messages with the same reports are the same reports."""
    recording = whole()
    place, batch = first_batch(recording, "report", 1)
    assert all(isinstance(part, Report) for part in batch.parts)
    assert failing(verify(with_message(recording, place, batch, *batch.parts))) == {"batches"}
    assert decode(recording.records[place].data) == batch


@pytest.mark.parametrize("site", [[3, "edge", 1], [0], {"x": 1}, "edge", None, [0, 0, [1]]])
def test_a_site_that_is_none_of_the_system_is_no_crash(site: Any) -> None:
    """Of whatever form it is: where it was to go is not asked, and that it is wrong is said."""
    recording = recorded("arm:n=6", "word", rounds=20)
    here = first(recording, "presence")
    assert "bundle" in failing(verify(edited(recording, here, replace(here, site=site))))
    verdict = first(recording, "verdict")
    assert "claims" in failing(verify(edited(recording, verdict, replace(verdict, to=[site]))))
