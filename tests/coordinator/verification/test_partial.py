"""What verifying says of recordings that were cut from others: what is missing, and no forgery."""

from dataclasses import replace
from pathlib import Path

import pytest

from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.recordings.cutting import (
    filter_recording,
    left_out,
    merge_recordings,
    split_recording,
)
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.recordings.stored_messages import Record
from processes.command_line import GOLDEN
from samples.recordings import new_path

PATHS = sorted(GOLDEN.glob("*.mcap"))


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_what_was_split_and_merged_verifies_as_before(path: Path) -> None:
    """The beginning as far as it goes, a part in the middle by its messages, the whole as ever."""
    parts = split_recording(path, new_path(""), parts=3)
    first, middle, last = map(verify, parts)
    assert first.ok
    assert not first.complete
    checked = [check.name for check in first.checks if check.checked]
    assert {"admissible", "sites", "parameters"} <= {*checked}
    assert ("edges" in checked) == ("free" not in path.stem)  # written at the end without rounds
    for each in (middle, last):
        assert each.ok
        assert not each.complete
        assert [check.name for check in each.checks if check.checked] == [
            "readable",
            "parameters",
            "messages",
        ]
    count = len(read_recording(path).records)
    missing = [each.missing.messages for each in (first, middle, last)]
    assert sum(missing) == 2 * count
    merge_recordings(parts, out := new_path())
    assert verify(out) == verify(path)


AT_THE_END = {"summary", "ended", "normal", "ends", "class", "certificate"}


@pytest.mark.parametrize("name", ["hex-5", "hex-free-5"])
def test_what_is_said_at_the_end_is_not_checked_where_it_is_not_on_record(name: str) -> None:
    """Of a beginning nor `complete`; that fails of a file that was cut off, after what it has."""
    path = GOLDEN / f"{name}.mcap"
    free = "free" in name
    ending = AT_THE_END | ({"edges"} if free else set())
    filter_recording(path, out := new_path(), until=4)
    found = verify(out)
    unchecked = {check.name: check.detail for check in found.checks if not check.checked}
    assert unchecked.keys() >= ending | {"complete"}
    assert {unchecked[each] for each in ending} == {"not checked: the end is not on record"}
    (cut := new_path()).write_bytes(path.read_bytes()[:25_000])
    found = verify(cut)
    wrong = {check.name: check.detail for check in found.checks if not check.ok}
    assert wrong.keys() == {"readable", "complete"}
    assert wrong["complete"].endswith(f"lost after {'level' if free else 'round'} {found.rounds}")
    assert ending <= {check.name for check in found.checks if not check.checked}


def test_it_says_which_messages_are_there() -> None:
    """Each check that is not made says how many of how many messages there are, and which."""
    filter_recording(GOLDEN / "hex-5.mcap", out := new_path(), topics=["reports"], first=3)
    found = verify(out)
    (why,) = {check.detail for check in found.checks if not check.checked}
    assert why == "not checked: 54 of 578 messages (topics reports, from 3)"
    moves = int((read_recording(GOLDEN / "hex-5.mcap").moves()["round"] >= 3).sum())
    assert (found.moves, found.rounds, found.missing.messages) == (moves, 27, 524)
    assert left_out(read_recording(out)) == 524


def test_a_filter_that_leaves_nothing_out_changes_nothing() -> None:
    """Every check is made, and holds."""
    filter_recording(GOLDEN / "hex-5.mcap", out := new_path(), topics=["*"])
    assert verify(out) == verify(GOLDEN / "hex-5.mcap")


def test_what_is_wrong_with_a_part_is_found() -> None:
    """A message under another round or topic, one that is none, and one that stands before."""
    parts = split_recording(GOLDEN / "hex-5.mcap", new_path(""), parts=3)
    part = read_recording(parts[1])
    good = list(part.records)

    def said(record: Record) -> str:
        found = verify(replace(part, records=(*good[:-1], record)))
        assert not found.ok
        return next(check.detail for check in found.checks if not check.ok)

    last = good[-1]
    wrong = replace(last, data=b"{")
    assert said(wrong).startswith(f"message {last.sequence} ({last.topic}):")
    wrong = replace(last, round=400)
    assert "of round 400 is of round" in said(wrong)
    wrong = replace(last, topic="presence/module_77")
    assert f"is {last.topic}" in said(wrong)
    assert "stands after message" in said(good[0])


def test_more_messages_than_the_whole_had_are_no_part() -> None:
    """A recording that says that it was cut from a smaller one is taken for whole."""
    recording = read_recording(GOLDEN / "hex-5.mcap")
    parameters = {**recording.parameters, "whole_messages": "578"}
    assert verify(replace(recording, parameters=parameters)).complete
