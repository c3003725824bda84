"""Messages of any zenoh programs: recorded as they are, cut and merged, and put back."""

import csv
import json
import time
from base64 import b64decode
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import zenoh
from mcap.reader import make_reader

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.playback.player import Player, replay
from cubepath.coordinator.runs.contents import info
from cubepath.coordinator.tools.exports.exporting import export
from cubepath.coordinator.tools.recorder.recorder import Recorder
from cubepath.coordinator.verification.recording import verify
from cubepath.coordinator.verification.recovery import recover
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.recordings.cutting import filter_recording, merge_recordings, split_recording
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.sessions import open_client

JSON = zenoh.Encoding.APPLICATION_JSON.with_schema("Pose")
BLOCK = zenoh.CongestionControl.BLOCK


def _until(holds: Callable[[], bool], seconds: float = 20.0) -> None:
    deadline = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.005)


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    """Where a router of somebody else listens."""
    with Router("tcp/127.0.0.1:0") as router:
        yield router.endpoint


def _say(session: zenoh.Session, count: int = 3) -> None:
    """Say what two small programs say: poses with numbers attached, a picture, a farewell."""
    for number in range(count):
        session.put(
            "robot/arm",
            b'{"x": %d}' % number,
            encoding=JSON,
            attachment=b"n%d" % number,
            congestion_control=BLOCK,
            priority=zenoh.Priority.REAL_TIME,
        )
    session.put("robot/eye/left", b"\0\xff", congestion_control=BLOCK)
    session.delete("robot/arm", congestion_control=BLOCK)


SAID = 8
"""What stands in a recording of it: three attachments are messages of their own there."""


@pytest.fixture(scope="module")
def recorded(endpoint: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of what two programs say."""
    path = tmp_path_factory.mktemp("recorded") / "out.mcap"
    with open_client(endpoint) as session, Recorder(endpoint, path, keys="robot/**") as recorder:
        _say(session)
        session.put("other/key", b"not asked for", congestion_control=BLOCK)
        _until(lambda: recorder.messages == SAID)
    assert recorder.ended == "stopped"
    assert recorder.lost == {}
    return path


def _plain(records: list[Record]) -> list[tuple[str, bytes, object]]:
    """Return all but times and numbers, and how somebody was held up."""
    return [
        (each.topic, each.data, each.put and each.put._replace(congestion_control=""))
        for each in records
    ]


def test_everything_of_a_message_is_kept(recorded: Path) -> None:
    """Key, bytes, encoding, schema, attachment, priority, deletions, and both times."""
    found = list(read_recording(recorded).records)
    poses = [each for each in found if each.topic == "robot/arm"]
    assert [each.data for each in poses] == [b'{"x": 0}', b'{"x": 1}', b'{"x": 2}']
    put = poses[0].put
    assert put is not None
    assert (put.encoding, put.priority) == ("application/json;Pose", "real_time")
    assert (put.congestion_control, put.express) == ("block", False)
    attached = [each for each in found if each.topic == "robot/arm?attachment"]
    assert [each.data for each in attached] == [b"n0", b"n1", b"n2"]
    assert all(found[found.index(each) + 1] in poses for each in attached)
    assert [each.data for each in found if each.topic == "robot/arm?delete"] == [b""]
    assert all(abs(each.round - each.wall_ns) < 60e9 for each in found)
    assert len({each.wall_ns for each in poses}) == 3  # the router's timestamps differ


def test_other_tools_read_encodings_and_schemas(recorded: Path) -> None:
    """The mcap package's own reader finds JSON of the schema that the encoding names."""
    with recorded.open("rb") as stream:
        messages = list(make_reader(stream).iter_messages(topics=["robot/arm", "robot/eye/left"]))
    by_topic = {channel.topic: (schema, channel) for schema, channel, _ in messages}
    schema, channel = by_topic["robot/arm"]
    assert schema is not None
    assert (schema.name, channel.message_encoding) == ("Pose", "json")
    schema, channel = by_topic["robot/eye/left"]
    assert (schema, channel.message_encoding) == (None, "")


def test_info_counts_by_topic(recorded: Path) -> None:
    """What is there of each key stands in one line, and nothing that only a run has."""
    found = info(recorded)
    assert found["kinds"]["robot/arm"] == {"messages": 3, "bytes": 24}
    assert found["kinds"]["robot/arm?attachment"] == {"messages": 3, "bytes": 6}
    assert found["messages"] == SAID
    assert found["parameters"]["keys"] == "robot/**"
    assert "system" not in found


def test_a_replay_is_heard_as_the_programs_were(
    recorded: Path, endpoint: str, tmp_path: Path
) -> None:
    """A recording of a replay has the same messages, with times of its own."""
    again = tmp_path / "again.mcap"
    with Recorder(endpoint, again, keys="robot/**") as recorder:
        played = replay(recorded, connect=endpoint, wait_for_subscribers=20)
        _until(lambda: recorder.messages == SAID)
    assert (played.messages, played.agrees) == (5, True)
    first, second = read_recording(recorded).records, read_recording(again).records
    assert _plain([*second]) == _plain([*first])
    assert min(each.wall_ns for each in second) > max(each.round for each in first)


@pytest.mark.parametrize(
    ("options", "others", "own"),
    [
        ({"topics": ["robot/arm"]}, "robot/eye/*", "robot/arm"),
        ({"remap": ["robot/arm=left/arm"], "topics": ["robot/arm"]}, "robot/arm", "left/*"),
    ],
)
def test_a_replay_waits_for_subscribers_of_what_it_puts(
    recorded: Path, endpoint: str, options: dict[str, list[str]], others: str, own: str
) -> None:
    """Those of other keys are not waited for, and it says if there were no others."""
    heard: list[str] = []
    given: Any = {"connect": endpoint, **options}
    with open_client(endpoint) as session:
        session.declare_subscriber(others, lambda _: None)
        with pytest.raises(CheckError, match=rf"^no subscriber to {own[:4]}\S*/arm within 0\.3 s"):
            replay(recorded, wait_for_subscribers=0.3, **given)
        assert not replay(recorded, **given).heard
        session.declare_subscriber(own, lambda sample: heard.append(sample.payload.to_string()))
        assert replay(recorded, wait_for_subscribers=20, **given).heard
        assert replay(recorded, **given).heard
        _until(lambda: len(heard) == 8)


@pytest.mark.parametrize("key", ["many/{}", "{}/many"])
def test_a_replay_on_many_keys_knows_who_listens(endpoint: str, tmp_path: Path, key: str) -> None:
    """Of many keys it asks for how they begin, or for all."""
    path, count = tmp_path / "x.mcap", 150
    with open_client(endpoint) as session, Recorder(endpoint, path, keys="**") as recorder:
        for number in range(count):
            session.put(key.format(number), b"x", congestion_control=BLOCK)
        _until(lambda: recorder.messages == count)
        recorder.stop()
        with pytest.raises(CheckError, match=r"^no subscriber to "):
            replay(path, connect=endpoint, wait_for_subscribers=0.2)
        session.declare_subscriber(key.format(count - 1), lambda _: None)
        assert replay(path, connect=endpoint, wait_for_subscribers=20).heard


def test_a_command_says_that_nobody_heard_a_replay(
    recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It ends well all the same."""
    assert (
        main(["replay", str(recorded), "--listen", "tcp/127.0.0.1:0", "--topics", "robot/e*"]) == 0
    )
    assert "nobody subscribed to what was put" in capsys.readouterr().err


def test_a_replay_is_paused_stepped_moved_and_remapped(recorded: Path, tmp_path: Path) -> None:
    """A step puts one message with its attachment, on another key if that is asked for."""
    with (
        Player(
            recorded, endpoint="tcp/127.0.0.1:0", remap=["robot/arm=left/arm"], exclude=["*delete"]
        ) as player,
        Recorder(player.endpoint, tmp_path / "p.mcap", keys="**") as recorder,
    ):
        player.step()
        _until(lambda: recorder.messages == 2)
        player.step(count=2)
        player.back()
        player.step()
        player.seek("0s")
        with pytest.raises(InputError, match="messages on any keys have no rounds"):
            player.step("round")
        with pytest.raises(InputError, match=r"expected messages, or a time such as 3\.5s"):
            player.seek(3)
        player.rate("1000x")
        player.play()
        player.wait(20)
        _until(lambda: recorder.messages >= 2 * 4 + 7)
    said = [
        (each.topic, each.data)
        for each in read_recording(tmp_path / "p.mcap").records
        if not each.topic.startswith("cubepath/")
    ]
    pose = [("left/arm?attachment", b"n%d"), ("left/arm", b'{"x": %d}')]
    steps = [0, 1, 2, 2, 0, 1, 2]
    expected = [(topic, data % number) for number in steps for topic, data in pose]
    assert said == [*expected, ("robot/eye/left", b"\0\xff")]


def test_times_between_messages_are_kept(endpoint: str, tmp_path: Path) -> None:
    """At 2x a replay takes half as long as the recording, and gaps can be cut."""
    path = tmp_path / "slow.mcap"
    with open_client(endpoint) as session, Recorder(endpoint, path, keys="slow") as recorder:
        for _ in range(2):
            session.put("slow", b"tick", congestion_control=BLOCK)
            time.sleep(0.5)
        _until(lambda: recorder.messages == 2)
    one, other = read_recording(path).records
    apart = (other.round - one.round) / 1e9
    assert apart > 0.4
    played = replay(path, endpoint="tcp/127.0.0.1:0", rate="2x")
    assert apart / 2 <= played.seconds
    assert replay(path, endpoint="tcp/127.0.0.1:0", begin="0.1s").messages == 1


def test_cuts_and_merges_keep_every_message(recorded: Path, tmp_path: Path) -> None:
    """Parts put together are the recording again; what is filtered keeps its attachments."""
    parts = split_recording(recorded, tmp_path / "parts", parts=3)
    assert merge_recordings(parts[::-1], tmp_path / "whole.mcap") == SAID
    whole, whence = read_recording(tmp_path / "whole.mcap"), read_recording(recorded)
    assert [*whole.records] == [*whence.records]
    assert whole.parameters == whence.parameters
    filter_recording(recorded, tmp_path / "arm.mcap", topics=["robot/arm"])
    kept = [each.topic for each in read_recording(tmp_path / "arm.mcap").records]
    assert kept == ["robot/arm?attachment", "robot/arm"] * 3 + ["robot/arm?delete"]
    recover(recorded, tmp_path / "copy.mcap")
    assert [*read_recording(tmp_path / "copy.mcap").records] == [*whence.records]


def test_commands_cut_by_time(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By log times, which have 64 bits, or by seconds since the first message."""
    late = max(each.round for each in read_recording(recorded).records)
    out = tmp_path / "late.mcap"
    assert main(["log", "filter", str(recorded), "-o", str(out), "--from", str(late)]) == 0
    assert {each.round for each in read_recording(out).records} == {late}
    table = str(tmp_path / "all.csv")
    export_all = ["log", "export", str(recorded), "-o", table]
    assert main([*export_all, "--from", "0s", "--until", "60.5s"]) == 0
    assert main([*export_all, "--from", "9999s"]) == 0
    for command in (export_all, ["log", "filter", str(recorded), "-o", str(tmp_path / "x.mcap")]):
        assert main([*command, "--until", "3"]) == 2
        line = "cubepath: 3: messages on any keys have no rounds, expected a time such as 3s"
        assert line in capsys.readouterr().err
    assert len(Path(table).read_text().splitlines()) == 1


def test_two_recorders_together_have_each_message_once(endpoint: str, tmp_path: Path) -> None:
    """The router's timestamp tells which are the same: equal bytes are said often."""
    one, other = tmp_path / "one.mcap", tmp_path / "other.mcap"
    with open_client(endpoint) as session, Recorder(endpoint, one, keys="twice/**") as first:
        for _ in range(5):
            session.put("twice/a", b"same", attachment=b"same too", congestion_control=BLOCK)
        _until(lambda: first.messages == 10)
        with Recorder(endpoint, other, keys="twice/*") as second:
            for _ in range(5):
                session.put("twice/a", b"same", attachment=b"same too", congestion_control=BLOCK)
            _until(lambda: (first.messages, second.messages) == (20, 10))
    assert merge_recordings([other, one], tmp_path / "both.mcap") == 20
    both = read_recording(tmp_path / "both.mcap")
    topics = [each.topic for each in both.records]
    assert topics == ["twice/a?attachment", "twice/a"] * 10
    assert all(a.round <= b.round for a, b in pairwise(both.records))
    assert both.parameters["keys"] == "twice/* twice/**"


def test_what_needs_a_run_refuses_it_in_a_line(recorded: Path, tmp_path: Path) -> None:
    """Verifying, exporting moves and splitting by rounds say what they expected."""
    with pytest.raises(InputError, match="messages on any keys, expected the recording of a run"):
        verify(recorded)
    for suffix, table in (("csv", "moves"), ("mcap", None)):
        with pytest.raises(
            InputError, match=r"expected the table messages, or 'cubepath log filter'"
        ):
            export(recorded, tmp_path / f"out.{suffix}", table=table)
    assert export(recorded, tmp_path / "all.csv").count == SAID - 3
    with pytest.raises(InputError, match="expected seconds, not rounds"):
        split_recording(recorded, tmp_path / "parts", rounds=1)
    with pytest.raises(InputError, match=r"endpoint=ENDPOINT \(--listen\) for a router of its own"):
        replay(recorded)
    with pytest.raises(InputError, match=r"from=12: .* expected a time"):
        replay(recorded, endpoint="tcp/127.0.0.1:0", begin=12)


def test_a_table_has_every_message(endpoint: str, tmp_path: Path) -> None:
    """A row each with its attachment; bytes that are no text come back from base64."""
    path = tmp_path / "x.mcap"
    said = [b"plain", b'{"x": [1]}', b'"text"', b"7", b"\0\xfe", b"base64:AA==", b"a\0b", b""]
    with open_client(endpoint) as session, Recorder(endpoint, path, keys="t/**") as recorder:
        session.put("t/other", b"x", congestion_control=BLOCK)
        for each in said:
            session.put("t/a", each, attachment=each or None, congestion_control=BLOCK)
        _until(lambda: recorder.messages == 2 * len(said))
    count = export(path, tmp_path / "x.csv", table="messages", kinds=["t/a"]).count
    assert count == len(said)
    with (tmp_path / "x.csv").open(newline="") as stream:
        rows = [*csv.DictReader(stream)]
    assert {(row["kind"], row["sender"]) for row in rows} == {("t/a", "")}
    texts = [row["message"] for row in rows]
    assert texts == [row["attachment"] for row in rows]
    assert texts[:3] == ["plain", '{"x": [1]}', '"text"']
    assert texts[4:6] == ["base64:AP4=", "base64:YmFzZTY0OkFBPT0="]
    coded = [text.partition("base64:") for text in texts]
    assert [b64decode(code) if sign else text.encode() for text, sign, code in coded] == said
    export(path, tmp_path / "x.jsonl", table="messages", topics=["t/a"])
    lines = [json.loads(line) for line in (tmp_path / "x.jsonl").read_text().splitlines()]
    assert [line["message"] for line in lines] == [texts[0], {"x": [1]}, texts[2], 7, *texts[4:]]
    assert lines[-1]["attachment"] is None
    export(path, tmp_path / "x.parquet", table="messages")
    frame = pd.read_parquet(tmp_path / "x.parquet")
    assert frame["attachment"].fillna("").tolist() == ["", *texts]
    assert frame["message"].tolist() == ["x", *texts]
    own = read_recording(path).frame("messages")
    assert {*own["kind"]} == {"t/other", "t/a", "t/a?attachment"}
    assert {*own["sender"]} == {""}
    with pytest.raises(InputError, match=r"kind t/b: .*\(did you mean 't/a'\?\), .* t/a, t/other$"):
        export(path, tmp_path / "y.csv", table="messages", kinds=["t/b"])
    with pytest.raises(
        InputError, match=r"topics t/b: .*\(did you mean 't/a'\?\), .* t/a, t/other$"
    ):
        export(path, tmp_path / "y.csv", table="messages", topics=["t/b"])


def test_wrong_keys_are_refused_before_anything_is_opened(tmp_path: Path) -> None:
    """A key expression that is none, and a run beside keys."""
    nowhere = "tcp/127.0.0.1:1"
    with pytest.raises(InputError, match="keys=a//b: no key expression"):
        Recorder(nowhere, tmp_path / "x.mcap", keys="a//b")
    with pytest.raises(InputError, match="run=r: not with keys=a"):
        Recorder(nowhere, tmp_path / "x.mcap", keys="a", run="r")


def test_a_command_says_that_no_message_came(
    endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A comma is a part of a key; without keys a run is awaited, and there may be none."""
    with pytest.raises(CheckError, match=r"^no run answers at .*; messages of your own programs"):
        Recorder(endpoint, patience_s=0.1)
    with pytest.raises(InputError, match=r"cannot listen there, it is in use$"):
        Router(endpoint)
    out = str(tmp_path / "x.mcap")
    record = ["log", "record", "--connect", endpoint, "--keys", "a,b", "--timeout", "0.2"]
    assert main([*record, "-o", out]) == 0
    assert "no message came on a,b" in capsys.readouterr().err


def test_no_message_of_those_that_block_is_lost(endpoint: str, tmp_path: Path) -> None:
    """Though the recorder may keep a hundredth of them in memory; numbers of publishers agree."""
    count = 20_000
    with (
        open_client(endpoint) as session,
        Recorder(endpoint, tmp_path / "x.mcap", keys="fast", memory_megabytes=1) as recorder,
    ):
        assert recorder.room < count / 50
        with session.declare_publisher("fast", congestion_control=BLOCK) as publisher:
            for number in range(count):
                info_ = zenoh.SourceInfo(publisher.id, number)
                publisher.put(b"%d" % number, source_info=info_)
        _until(lambda: recorder.messages == count, 60)
    assert recorder.lost == {}
    found = [int(each.data) for each in read_recording(tmp_path / "x.mcap").records]
    assert found == [*range(count)]


def test_the_last_seconds_are_written_on_demand(endpoint: str, tmp_path: Path) -> None:
    """A snapshot has what came last, and files can be split as those of a run."""
    with (
        open_client(endpoint) as session,
        Recorder(endpoint, tmp_path / "x.mcap", keys="robot/**", snapshot_seconds=60) as recorder,
        Recorder(endpoint, tmp_path / "y.mcap", keys="robot/**", split_seconds=1e-6) as splitter,
    ):
        _say(session, 1)
        _until(lambda: splitter.messages == 4)
        _until(lambda: info(recorder.snapshot())["messages"] == 4)
    assert len(splitter.logs) > 1
    assert sum(info(each)["messages"] for each in splitter.logs) == 4
