"""What `cubepath log info` says of a recording."""

import json
import random
import re
from dataclasses import replace as with_fields
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from msgspec import structs

from cubepath.coordinator.runs.contents import info, render
from cubepath.protocol.recordings.cutting import filter_recording
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.recordings.writing import copy_recording
from cubepath.protocol.wire.keys import topic_of
from cubepath.protocol.wire.messages import Refused, encode
from processes.command_line import GOLDEN
from samples.recordings import all_edited, first, new_path, recorded, with_records


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
    assert document["parts"]["report"] == 7 * summary.rounds
    assert sum(kind["messages"] for kind in document["kinds"].values()) == document["messages"]
    assert document["message_bytes"] == sum(len(each.data) for each in crowd().records)
    assert document["bytes"] == crowd().path.stat().st_size
    assert document["seconds"] > 0
    assert document["problems"] == []


def test_info_says_who_was_refused_and_why() -> None:
    """By sender and reason, how often in the whole run, with the first line."""
    told = [
        Refused(2, "x/guest", "guest", "malformed", "no JSON", 1, "x"),
        Refused(2, "x/guest", "guest", "malformed", "no JSON", 41),
        Refused(3, "y/guest", "guest", "malformed", "no message", 1, "y"),
        Refused(3, "go/coordinator", "coordinator", "foreign", "go", 1, "z"),
    ]
    whole = crowd()
    records = [Record(topic_of(each), encode(each), each.round, 0, 0) for each in told]
    document = info(with_records(whole, [*records, *whole.records]))
    assert [(each["sender"], each["count"], each["detail"]) for each in document["refused"]] == [
        ("coordinator", 1, "go"),
        ("guest", 43, "no JSON"),
    ]
    assert re.search(r"refused +43 of guest, malformed: no JSON", render(document))
    assert info(whole)["refused"] == []


def test_info_says_which_format_a_recording_has() -> None:
    """That of the file, for machines and for people."""
    for recording, name in (
        (crowd(), "cubepath-recording-4"),
        (read_recording(GOLDEN / "hex-free-5.mcap"), "cubepath-recording-5"),
    ):
        assert info(recording)["format"] == name
        assert re.search(rf"^format +{name}$", render(info(recording)), re.MULTILINE)


def test_without_a_summary_what_can_be_counted_is_counted() -> None:
    """A killed run: rounds and moves come from the edges, and the rest is None."""
    document = info(all_edited(crowd(), "summary", lambda _: None))
    summary = first(crowd(), "summary")
    assert (document["rounds"], document["moves"]) == (summary.rounds, summary.moves)
    assert document["ended"] is None
    assert document["cubes"] is None
    assert "its end is not on record" in render(document)


def test_without_edges_moves_are_counted_from_what_was_reported() -> None:
    """The same numbers from reports or commits; where nothing tells them they are not known."""
    for name, kinds in (("hex-5", ["reports"]), ("hex-free-5", ["commit", "commits"])):
        path = GOLDEN / f"{name}.mcap"
        filter_recording(path, out := new_path(), topics=kinds)
        told, whole = info(out), info(path)
        assert (told["rounds"], told["moves"]) == (whole["rounds"], whole["moves"])
    filter_recording(GOLDEN / "hex-5.mcap", out := new_path(), topics=["bundle"])
    told = info(out)
    assert (told["rounds"], told["moves"]) == (None, None)
    assert re.search(r"^moves +unknown$", render(told), re.MULTILINE)


@pytest.mark.parametrize(
    ("parameters", "why"),
    [
        ({"filtered": "until 4"}, "messages of the run were left out"),
        ({"topics": "a replay"}, "messages of the run were left out"),
        ({"split": "1 of 3"}, "this is a part of a recording"),
        ({"recovered": "6 messages"}, "this was recovered from a damaged file"),
        ({}, "the run was killed, or the file is damaged"),
    ],
)
def test_a_missing_end_has_the_reason_that_the_recording_tells(
    parameters: dict[str, str], why: str
) -> None:
    """A part is neither killed nor damaged."""
    part = with_fields(all_edited(crowd(), "summary", lambda _: None), parameters=parameters)
    assert f"its end is not on record: {why}" in render(info(part))


def test_an_interrupt_is_told_once_and_versions_stand_under_their_name() -> None:
    """Also where parameters that nobody knows come before them."""
    ended = all_edited(
        crowd(),
        "summary",
        lambda summary: structs.replace(summary, ended="interrupted", error="interrupted"),
    )
    ended = with_fields(ended, parameters={**ended.parameters, "recovered": "some"})
    lines = render(info(ended)).splitlines()
    assert [line for line in lines if "interrupted" in line] == [
        "ended            it was interrupted"
    ]
    place = next(n for n, line in enumerate(lines) if line.startswith("  cubepath "))
    assert lines[place - 1] == "versions"


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


def test_what_a_file_says_of_itself_is_what_is_in_it(tmp_path: Path) -> None:
    """The counts at its end, and those of its messages one by one."""
    path = tmp_path / "a.mcap"
    copy_recording(crowd(), path)
    whole = read_recording(path)
    document, counted = info(whole), info(with_fields(whole, records=tuple(whole.records)))
    assert document == counted
    assert document["complete"] is True
    assert document["parts"]["report"] == len([*crowd().of_kind("report")])
    assert document["parts"].keys() == {"presence", "note", "claim", "verdict", "report"}


def test_only_the_end_of_a_whole_file_is_read(tmp_path: Path) -> None:
    """A chunk is looked at for the summary, and no other; the CRC of the data vouches for them."""
    path = tmp_path / "a.mcap"
    noise = random.Random(1)  # noqa: S311 - a test's own
    some = [Record("go/coordinator", noise.randbytes(30_000), n, 0, 0) for n in range(100)]
    copy_recording(with_records(crowd(), [*some, *crowd().records]), path)
    recording = read_recording(path)
    with path.open("r+b") as stream:
        stream.seek(recording.size // 2)
        stream.write(bytes(400))
    found = info(recording)
    assert (found["ended"], found["messages"]) == ("max-rounds", len(crowd().records) + 100)
    # Read again, the damage is found.
    damaged = info(read_recording(path))
    assert not damaged["complete"]
    assert damaged["messages"] < found["messages"]


def test_counts_that_do_not_fit_are_not_believed(tmp_path: Path) -> None:
    """A closing record that was changed, with all CRCs made right: messages are counted."""
    path, out = tmp_path / "a.mcap", tmp_path / "b.mcap"
    copy_recording(crowd(), path)
    true = info(read_recording(path))
    with path.open("rb") as stream, out.open("wb") as other:
        reader = make_reader(stream)
        writer = Writer(other, enable_data_crcs=True)
        writer.start()
        for each in reader.iter_metadata():
            wrong = {key: value.replace("report", "repork") for key, value in each.metadata.items()}
            writer.add_metadata(each.name, wrong)
        for scene in reader.iter_attachments():
            writer.add_attachment(0, 0, scene.name, scene.media_type, scene.data)
        for record in read_recording(path).records:
            channel = writer.register_channel(record.topic, "json", 0)
            writer.add_message(channel, record.round, record.data, record.wall_ns, record.sequence)
        writer.finish()  # type: ignore[no-untyped-call]
    found = info(read_recording(out))
    assert found["problems"] == []
    assert (found["kinds"], found["parts"]) == (true["kinds"], true["parts"])


def test_parts_of_batches_are_told_to_people() -> None:
    """By kind, under the kinds of messages."""
    text = render(info(crowd()))
    reports = len([*crowd().of_kind("report")])
    assert re.search(rf"^  report +{reports}  in batches$", text, re.MULTILINE)
