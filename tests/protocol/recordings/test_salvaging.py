"""Damaged recordings: the damage is named, and no message is ever made up."""

from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import example, given, strategies as st
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Footer
from mcap.writer import IndexType, Writer

from cubepath.protocol.recordings.mcap_file import MAGIC
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.recordings.writing import RecordingWriter
from tampering.damaged import (
    FLUSH_EVERY,
    PARAMETERS,
    SCENE_OF_ALL,
    assert_honest,
    chunks_of,
    files,
    flipped,
    originals,
    reading,
    salvaged,
    write,
)


@pytest.mark.slow
@given(st.data())
def test_truncated_anywhere_it_is_named_and_a_prefix_is_read(data: st.DataObject) -> None:
    """Cut at any byte: refused in one line, or named, with the first messages and no others."""
    whole = data.draw(st.sampled_from(files()))
    cut = data.draw(st.integers(0, len(whole) - 1))
    assert_honest(reading(whole[:cut]), prefix=True)


def test_truncated_at_each_kind_of_place() -> None:
    """Around the ends of every record, where lengths and magic are cut in two."""
    whole = files()[0]
    edges = {0, 1, len(MAGIC), len(whole) - len(MAGIC), len(whole)}
    edges |= {place for chunk in chunks_of(whole) for place in chunk}
    for edge in edges:
        for cut in range(max(0, edge - 12), min(len(whole), edge + 12)):
            assert_honest(reading(whole[:cut]), prefix=True)


def test_all_that_was_flushed_is_read() -> None:
    """A truncated file gives all whole chunks before the cut."""
    whole = files()[0]
    for number, (_, end) in enumerate(chunks_of(whole), 1):
        found = reading(whole[:end])
        assert found is not None
        assert len(found.records) == min(number * FLUSH_EVERY, len(originals()))
        assert "truncated at byte" in found.problems[0]
        assert f"{number} chunks and {len(found.records)} messages" in found.problems[0]


@pytest.mark.slow
@given(st.data())
@example(data=None)
def test_a_flipped_bit_is_named_and_changes_no_message(data: st.DataObject | None) -> None:
    """One bit anywhere, in a closed file or one left by a kill: no message is ever another."""
    if data is None:
        return
    whole = data.draw(st.sampled_from(files()))
    place = data.draw(st.integers(0, len(whole) - 1))
    assert_honest(reading(flipped(whole, place, data.draw(st.integers(0, 7)))))


@pytest.mark.slow
@given(st.data())
def test_any_bytes_overwritten_are_named_and_change_no_message(data: st.DataObject) -> None:
    """Any run of bytes replaced by any other, of any length: the same holds."""
    whole = files()[0]
    start = data.draw(st.integers(0, len(whole) - 1))
    end = data.draw(st.integers(start, min(len(whole), start + 200)))
    new = data.draw(st.binary(max_size=200))
    if whole[start:end] != new:
        assert_honest(reading(whole[:start] + new + whole[end:]))


@given(st.binary(max_size=300))
@example(b"")
@example(MAGIC)
@example(MAGIC + MAGIC)
@example(b"{}")
def test_any_other_file_is_refused_in_one_line(data: bytes) -> None:
    """What is no recording is refused by name; the reader of records raises nothing at all."""
    assert reading(data) is None
    salvaged(MAGIC + data)
    salvaged(MAGIC + data + MAGIC)


@pytest.mark.parametrize("closed", [True, False])
def test_a_corrupt_chunk_is_left_out_by_itself(closed: bool) -> None:
    """Each chunk in turn, the first with the channels included: all others are read."""
    whole = files()[0] if closed else files()[1]
    ends = chunks_of(files()[0])
    for number, (start, end) in enumerate(ends[: None if closed else -1], 1):
        found = reading(flipped(whole, (start + end) // 2))
        assert found is not None
        assert_honest(found)
        assert f"chunk {number} (log times " in found.problems[0]
        lost = {*range((number - 1) * FLUSH_EVERY, number * FLUSH_EVERY)}
        there = {record.sequence for record in found.records}
        flushed = len(originals()) if closed else len(originals()) // FLUSH_EVERY * FLUSH_EVERY
        assert there == {*range(flushed)} - lost


def test_a_corrupt_length_costs_no_more_than_its_chunk() -> None:
    """Where records lose their place, the index at the end tells where to go on."""
    whole = files()[0]
    for start, _ in chunks_of(whole):
        head = start - 53  # before the content: kind, length, times, size, CRC, compression
        assert whole[head] == Opcode.CHUNK
        for place in range(head, head + 9):
            for bit in (0, 6):
                found = reading(flipped(whole, place, bit))
                assert found is not None
                assert_honest(found)
                assert len(found.records) >= len(originals()) - FLUSH_EVERY


def test_a_damaged_length_before_the_parameters_does_not_cost_them() -> None:
    """The index tells where they begin, as it does for the scene and for chunks."""
    whole = files()[0]
    header, body = len(MAGIC), len(MAGIC) + 9
    following = body + int.from_bytes(whole[header + 1 : body], "little")
    assert (whole[header], whole[following]) == (Opcode.HEADER, Opcode.METADATA)
    found = salvaged(flipped(whole, body - 1))
    assert found.problems == [
        f"corrupt at byte {header}: a record is damaged, reading continues at byte {following}"
    ]
    assert found.metadata == ["cubepath", "cubepath", "cubepath-counts"]
    assert len(found.attachments) == 2
    assert len(found.messages) == len(originals())


def test_topics_that_a_damaged_chunk_named_are_known_from_the_summary() -> None:
    """A channel may stand in the first chunk alone, and later chunks use it."""
    out = BytesIO()
    writer = Writer(out, chunk_size=1)
    writer.start()
    channel = writer.register_channel("presence/module_0", "json", 0)
    for number in (1, 2):
        writer.add_message(channel, number, b"{}", number, number)
    writer.finish()  # type: ignore[no-untyped-call]
    whole = out.getvalue()
    (start, end), _ = chunks_of(whole)
    found = salvaged(flipped(whole, (start + end) // 2))
    assert "chunk 1 (log times 1 to 1) cannot be read" in found.problems[0]
    assert [message.sequence for message in found.messages] == [2]
    assert found.topics == {channel: "presence/module_0"}


def test_a_scene_is_read_where_it_stands_once_more() -> None:
    """Damage to either costs nothing; without both nothing can be checked, and it is refused."""
    whole = files()[0]
    one, other = (find(b"cubepath-system-1") for find in (whole.index, whole.rindex))
    assert one < other
    for place in (one, other):
        found = reading(flipped(whole, place))
        assert found is not None
        assert_honest(found)
        assert found.scene.start == SCENE_OF_ALL.start
        assert found.records == originals()
    assert reading(flipped(flipped(whole, one), other)) is None
    assert reading(flipped(files()[1], one)) is None  # where it stands once


@pytest.mark.parametrize("closed", [True, False])
def test_damaged_parameters_are_named(closed: bool) -> None:
    """A seed with a flipped bit is noticed, even where the file has no end; there it is once."""
    whole = files()[0] if closed else files()[1]
    place = whole.index(b"seed") + 8
    assert whole[place : place + 1] == b"7"
    found = reading(flipped(whole, place))
    assert found is not None
    assert found.parameters["seed"] == ("7" if closed else "6")
    told = "the CRC of the data" if closed else "the parameters"
    assert any(told in problem for problem in found.problems)


def damages() -> dict[str, tuple[bytes, str]]:
    """Return damaged recordings by name, each with the problem that is to be told."""
    whole, killed = files()
    size, end = len(whole), len(killed)
    counted = "4 chunks and 200 messages could be read before it"
    magic = "expected it to begin with the magic of MCAP"
    read = "all messages could be read"
    return {
        "nothing": (b"", f"truncated within its first bytes: {magic}"),
        "part of the magic": (MAGIC[:3], f"truncated within its first bytes: {magic}"),
        "another file": (b"{}", f"not an MCAP file: {magic}"),
        "killed": (killed, f"truncated at byte {end} of {end}: {counted}"),
        "head cut": (killed + b"\x06\x00", f"truncated at byte {end} of {end + 2}: {counted}"),
        "body cut": (
            killed + b"\x06" + (9).to_bytes(8, "little") + b"x",
            f"truncated at byte {end} of {end + 10}: {counted}",
        ),
        "no record": (killed + b"w" * 9, f"corrupt at byte {end} of {end + 9}: {counted}"),
        "no opcode": (killed + bytes(9), f"corrupt at byte {end} of {end + 9}: {counted}"),
        "magic after": (
            killed + b"w" * 9 + MAGIC,
            f"corrupt at byte {end} of {end + 17}: {counted}",
        ),
        "magic cut": (
            whole[:-1],
            f"truncated at byte {size - 1}: the closing magic is missing; {read}",
        ),
        "footer cut": (
            whole[:-12],
            f"truncated at byte {size - 12}: the closing magic is missing; {read}",
        ),
        "more": (whole + b"m", f"corrupt: 1 byte follows after the end; {read}"),
        "summary": (
            flipped(whole, size - 60),
            f"corrupt: the summary from byte {summary_of(whole)} on does not hold; {read}",
        ),
        "header": (flipped(whole, 25), "corrupt: the CRC of the data section does not hold"),
    }


def summary_of(data: bytes) -> int:
    """Return where the summary of a closed recording begins."""
    footer = Footer.read(ReadDataStream(BytesIO(data[-len(MAGIC) - 20 :])))
    return int(footer.summary_start)


@pytest.mark.parametrize("name", damages())
def test_what_is_wrong_is_said_once_and_where(name: str) -> None:
    """One problem, with its place; whatever else there is has been read."""
    data, problem = damages()[name]
    found = salvaged(data)
    assert found.problems == [problem]
    if data.startswith(MAGIC):
        count = 200 if "200 messages" in problem else 240
        assert [message.sequence for message in found.messages] == list(range(count))
        assert len(found.topics) == 6
        closed = count == 240
        assert found.metadata == (["cubepath"] * 2 + ["cubepath-counts"])[: 1 + 2 * closed]
        assert len(found.attachments) == 1 + closed


def test_where_something_was_lost_it_is_not_said_that_all_was_read() -> None:
    """Bytes taken out of a chunk: the summary does not hold either."""
    whole = files()[0]
    begin = whole.index(bytes([Opcode.CHUNK]), len(whole) // 3)
    found = salvaged(whole[: begin + 40] + whole[begin + 140 :])
    assert 0 < len(found.messages) < 240
    assert any("the summary from byte" in each for each in found.problems)
    assert not any("all messages" in each for each in found.problems)


def test_a_chunk_must_have_a_checksum_and_a_size_that_can_be() -> None:
    """One without a CRC is not believed, one that claims gigabytes is not unpacked."""
    out = BytesIO()
    writer = Writer(out, enable_crcs=False)
    writer.start()
    channel = writer.register_channel("a", "json", 0)
    writer.add_message(channel, 1, b"{}", 2, 0)
    writer.finish()  # type: ignore[no-untyped-call]
    found = salvaged(out.getvalue())
    assert "chunk 1 (log times 1 to 1) cannot be read: it has no checksum" in found.problems[0]
    assert found.messages == []
    whole = files()[0]
    start, _ = chunks_of(whole)[1]
    size = start - 28  # before it: size, CRC, and the compression's name of 4 with its length
    assert 0 < int.from_bytes(whole[size : size + 8], "little") < 1 << 20
    huge = whole[:size] + (2 << 30).to_bytes(8, "little") + whole[size + 8 :]
    said = f"cannot be read: it claims to hold {2 << 30} bytes"
    (problem,) = salvaged(huge).problems
    assert problem.endswith(said)
    assert problem.startswith(f"corrupt at byte {start - 53}: chunk 2 (log times ")


def test_a_chunk_whose_head_is_damaged_is_named_without_times() -> None:
    """What cannot be read of its head is not taken from the chunk before; a reason is given."""
    whole = files()[0]
    start, _ = chunks_of(whole)[1]
    name = start - 16  # the length of the compression's name
    assert whole[name : name + 8] == b"\x04\x00\x00\x00zstd"
    (problem,) = salvaged(whole[:name] + b"\xff" * 4 + whole[name + 4 :]).problems
    assert problem.startswith(f"corrupt at byte {start - 53}: chunk 2 cannot be read: ")
    assert not problem.endswith(": ")


def test_a_recording_needs_no_summary() -> None:
    """Another writer may leave it out: the footer says so, and there is no problem."""
    out = BytesIO()
    writer = Writer(
        out,
        index_types=IndexType.NONE,
        repeat_channels=False,
        repeat_schemas=False,
        use_statistics=False,
        use_summary_offsets=False,
    )
    writer.start()
    channel = writer.register_channel("a", "json", 0)
    writer.add_message(channel, 1, b"{}", 2, 0)
    writer.finish()  # type: ignore[no-untyped-call]
    assert summary_of(out.getvalue()) == 0
    found = salvaged(out.getvalue())
    assert found.problems == []
    assert [message.data for message in found.messages] == [b"{}"]
    assert list(found.topics.values()) == ["a"]


def test_a_gap_is_named() -> None:
    """A chunk that was cut out so that all else fits is missed by the numbers of messages."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.mcap"
        write(path)
        whole = read_recording(path)
        path.unlink()
        writer = RecordingWriter(path, SCENE_OF_ALL, PARAMETERS)
        for record in (*whole.records[:10], *whole.records[11:]):
            writer.messages = record.sequence
            writer.write(
                record.topic, record.data, round_number=record.round, wall_ns=record.wall_ns
            )
        writer.close()
        found = read_recording(path)
    assert found.problems == ("message 11 stands where message 10 should be",)


def unchunked(*, crcs: bool) -> bytes:
    """Return a recording as another writer might make it, without chunks."""
    out = BytesIO()
    writer = Writer(out, use_chunking=False, enable_data_crcs=crcs)
    closed = reading(files()[0])
    assert closed is not None
    writer.start()
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.mcap"
        write(path)
        with path.open("rb") as stream:
            reader = make_reader(stream)
            for each in reader.iter_metadata():
                writer.add_metadata(each.name, each.metadata)
            for scene in reader.iter_attachments():
                writer.add_attachment(0, 0, scene.name, scene.media_type, scene.data)
    for record in closed.records:
        channel = writer.register_channel(record.topic, "json", 0)
        writer.add_message(channel, record.round, record.data, record.wall_ns, record.sequence)
    writer.finish()  # type: ignore[no-untyped-call]
    return out.getvalue()


def test_messages_outside_chunks_need_someone_to_vouch_for_them() -> None:
    """Without chunks the CRC of the whole data decides; without that nothing is given."""
    found = reading(unchunked(crcs=True))
    assert found is not None
    assert (found.problems, found.records) == ((), originals())
    found = reading(unchunked(crcs=False))
    assert found is not None
    assert found.records == ()
    assert "nothing vouches for them" in found.problems[0]
    assert_honest(reading(flipped(unchunked(crcs=True), 3000)))


@pytest.mark.parametrize("closed", [True, False])
def test_a_file_that_was_cut_is_told_as_cut(closed: bool) -> None:
    """Wherever it ends, in a record, between two, or in the head of one: it is not corrupt."""
    whole = files()[0] if closed else files()[1]
    begin = chunks_of(files()[0])[0][0]  # both begin alike
    for size in range(begin, len(whole) - 1, 499):
        found = reading(whole[:size])
        assert found is not None
        assert found.problems[0].startswith("truncated at byte ")
        assert not any("corrupt" in problem for problem in found.problems)
