"""What `cubepath info` says of a recording."""

from __future__ import annotations

import json
from dataclasses import replace as with_fields

from command_line import GOLDEN
from cubepath.coordinator.runs.contents import info, render
from cubepath.protocol.recordings.recording import Recording, read_recording
from recordings import all_edited, first, recorded, with_records


def crowd() -> Recording:
    """Return the recording of a real run."""
    return recorded("agv:graph=grid4x4,n=7", "tswap", rounds=10)


def test_info_says_what_was_run_and_what_came_of_it() -> None:
    """System, rule, seed, versions, numbers, kinds and sizes, as one JSON document."""
    document = json.loads(json.dumps(info(crowd())))
    summary = first(crowd(), "summary")
    assert document["system"] == "agv:graph=grid4x4,n=7"
    assert (document["rule"], document["seed"], document["hesitate"]) == ("tswap", 0, 0.0)
    assert (document["modules"], document["processes"], document["max_rounds"]) == (7, 0, 10)
    assert set(document["versions"]) >= {"cubepath", "python", "eclipse-zenoh", "mcap"}
    assert document["parameters"] == {}
    for key in ("rounds", "moves", "reduced_moves", "cubes", "path_digest", "ended"):
        assert document[key] == getattr(summary, key)
    assert document["kinds"]["report"]["messages"] == 7 * summary.rounds
    assert sum(kind["messages"] for kind in document["kinds"].values()) == document["messages"]
    assert document["message_bytes"] == sum(len(each.data) for each in crowd().records)
    assert document["bytes"] == crowd().path.stat().st_size
    assert document["seconds"] > 0
    assert document["problems"] == []


def test_info_says_which_format_a_recording_has() -> None:
    """That of the file, for machines and for people."""
    for recording, name in (
        (read_recording(GOLDEN / "agv-3.mcap"), "cubepath-recording-1"),
        (crowd(), "cubepath-recording-2"),
    ):
        assert info(recording)["format"] == name
        assert f"format           {name}" in render(info(recording))


def test_without_a_summary_what_can_be_counted_is_counted() -> None:
    """A killed run: rounds and moves come from the edges, and the rest is None."""
    document = info(all_edited(crowd(), "summary", lambda _: None))
    summary = first(crowd(), "summary")
    assert (document["rounds"], document["moves"]) == (summary.rounds, summary.moves)
    assert document["ended"] is None
    assert document["cubes"] is None
    assert "its end is not on record" in render(document)


def test_the_table_is_for_people() -> None:
    """One aligned line each, problems last and by name."""
    found = with_fields(crowd(), problems=("truncated at byte 7",))
    lines = render(info(found)).splitlines()
    assert lines[-1].split(maxsplit=1) == ["problem", "truncated at byte 7"]
    assert len({len(line) - len(line.split(maxsplit=1)[1]) for line in lines[-1:]}) == 1
    text = render(info(crowd()))
    assert "the rounds were over" in text or "the goal was reached" in text
    assert "7 in no other processes" in text


def test_odd_recordings_are_described_too() -> None:
    """No messages, no parameters, messages that are none, a clock that was none."""
    empty = with_fields(crowd(), records=(), parameters={})
    assert info(empty)["system"] is None
    assert info(empty)["began"] is None
    render(info(empty))
    odd = with_records(
        crowd(),
        [
            with_fields(each, data=b"?" if each.kind == "edges" else each.data, wall_ns=2**64 - 1)
            for each in crowd().records
        ],
    )
    odd = with_fields(odd, parameters={"seed": "seven", "mine": "yes"})
    document = info(odd)
    assert (document["seed"], document["parameters"]) == ("seven", {"mine": "yes"})
    assert "mine" in render(document)
