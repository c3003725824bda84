"""Verifying a file as it is read: the same answer as with all messages in memory, in less of it."""

import os
import random
import tracemalloc
from dataclasses import replace as with_fields

import pytest
from msgspec.structs import replace

from cubepath.coordinator.auditing.rule_audit import audit
from cubepath.coordinator.verification.findings import Check, Verification
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.recordings.writing import copy_recording
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.messages import decode
from samples.long_runs import write
from samples.recordings import all_edited, edited, first, new_path, record_of, with_records
from tampering import (
    tamperings_of_certificates,
    tamperings_of_choices,
    tamperings_of_results,
    tamperings_of_runs,
    tamperings_of_schedules,
)
from tampering.tamperings import TAMPERINGS, Tampering, crowd, failing

MODULES_OF_RESULTS = (
    tamperings_of_certificates,
    tamperings_of_choices,
    tamperings_of_results,
    tamperings_of_runs,
    tamperings_of_schedules,
)
"""Imported for the tamperings that they add."""

SOME = [
    pytest.param(make, id=make.__name__, marks=[pytest.mark.nightly] if number % 4 else [])
    for number, (make, _) in enumerate(each.values for each in TAMPERINGS)
]
"""Each tampering, most of them nightly."""


def written(recording: Recording) -> Recording:
    """Return the recording as it is read from a file, of many chunks."""
    path = new_path()
    copy_recording(recording, path)
    return read_recording(path)


@pytest.mark.few(10)
@pytest.mark.parametrize("make", SOME)
def test_a_file_is_told_as_messages_in_memory(make: Tampering) -> None:
    """Every tampering: the same checks fail, with the same words, and the numbers are the same."""
    recording = with_fields(make(), problems=())
    assert len([*written(recording).blocks()]) > 1
    assert audit(written(recording)) == audit(recording)


@pytest.mark.parametrize("way", ["reversed", "shuffled", "last first"])
def test_messages_in_wild_order_give_the_same_answer(way: str) -> None:
    """However far from its round a message stands, and whatever else is wrong.

    But for the pace of the run, which is the order of its phases.
    """

    def apart_from_pace(found: Verification) -> list[Check]:
        return [check for check in found.checks if check.name not in ("pacing", "ended")]

    for recording in (crowd(), edited(crowd(), first(crowd(), "report", lambda m: m.round == 3))):
        records = list(recording.records)
        if way == "reversed":
            records.reverse()
        elif way == "shuffled":
            random.Random(5).shuffle(records)  # noqa: S311 - a test's own order
        else:
            records.insert(0, records.pop())
        found = verify(written(with_records(recording, records)))
        assert apart_from_pace(found) == apart_from_pace(verify(recording))
        assert "pacing" in failing(found) or way == "last first"


def test_a_message_of_a_round_that_is_over_still_counts() -> None:
    """Logged in the last round, it says that it is of the first: named, and nothing is lost."""
    report = first(crowd(), "report")
    last = first(crowd(), "summary").round
    late = [*edited(crowd(), report).records, record_of(report, last)]
    found = verify(written(with_records(crowd(), late)))
    assert failing(found) == {"messages", "batches"}
    assert found == verify(with_records(crowd(), late))
    edges = first(crowd(), "edges")
    late = [*edited(crowd(), edges).records, record_of(edges, last)]
    assert failing(verify(written(with_records(crowd(), late)))) == {"messages"}


def test_edges_of_other_rounds_are_told_in_their_order() -> None:
    """The least round first, although it is known to be incomplete last."""
    edges = first(crowd(), "edges")
    strays = [record_of(replace(edges, round=number)) for number in (99, 0, 50)]
    found = verify(written(with_records(crowd(), [*strays, *crowd().records])))
    told = next(check.detail for check in found.checks if check.name == "edges")
    assert told == "round 0: edges, but not every module has reported (and 2 more)"


def large() -> Recording:
    """Return a recording of some megabytes, more than is read at a time."""
    noise = random.Random(1)  # noqa: S311 - a test's own
    some = [
        Record("go/coordinator", noise.randbytes(30_000), number, 0, 0) for number in range(1, 101)
    ]
    return written(with_records(crowd(), some))


def test_a_file_that_is_cut_while_it_is_read_is_refused() -> None:
    """In one line with its name: what was read before cannot be trusted alone."""
    recording = large()
    os.truncate(recording.path, recording.size // 2)
    with pytest.raises(InputError, match=r"\.mcap: cut to \d+ bytes while it was read, expected"):
        verify(recording)


def test_a_file_that_is_changed_while_it_is_read_is_refused() -> None:
    """Each chunk is held to its CRC whenever it is read."""
    recording = large()
    with recording.path.open("r+b") as stream:
        stream.seek(recording.size // 2)
        stream.write(bytes(400))
    with pytest.raises(InputError, match=r"the chunk at byte \d+ cannot be read any more"):
        verify(recording)


@pytest.mark.thorough
def test_memory_does_not_grow_with_the_messages() -> None:
    """A part more takes less than 100 bytes more, those of the moves and of the certificate."""
    peaks = []
    for parts in (4_000, 16_000):
        path = new_path()
        write(path, scene_from_spec("agv:graph=grid6x6,n=20"), parts)
        recording = read_recording(path)
        assert audit(recording).ok  # what is loaded once is no part of it
        tracemalloc.start()
        assert audit(recording).ok
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] - peaks[0] < 100 * 12_000, peaks


def test_results_of_a_run_are_checked_when_all_rounds_are_known() -> None:
    """Cubes and summary may stand before the rounds."""
    results = {"cube", "certificate", "summary"}
    records = sorted(crowd().records, key=lambda each: each.kind not in results)
    assert decode(records[-1].data).round > 1
    found = written(with_records(crowd(), records))
    assert verify(found).ok
    none = all_edited(found, "summary", lambda _: None)
    assert failing(verify(written(none))) == {"complete"}
