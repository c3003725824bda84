"""Appending to MCAP files: the same bytes as the mcap package writes, and nothing written twice."""

import struct
from collections.abc import Sequence
from io import BytesIO
from typing import TypeAlias

import pytest
from hypothesis import example, given, strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from cubepath.protocol.recordings.appending import McapAppender

NUMBERS = st.integers(0, (1 << 64) - 1)
MESSAGES = st.tuples(
    st.integers(0, 5), st.integers(0, (1 << 32) - 1), NUMBERS, NUMBERS, st.binary(max_size=200)
)
"""Topic, sequence, log time, publish time and data."""
ATTACHMENTS = st.tuples(st.text(max_size=8), st.binary(max_size=40))
METADATA = st.dictionaries(st.text(max_size=5), st.text(max_size=5), max_size=3)
Told: TypeAlias = tuple[int, int, int, int, bytes]
Step: TypeAlias = Told | tuple[str, bytes] | dict[str, str] | None
STEPS = st.lists(MESSAGES | ATTACHMENTS | METADATA | st.none(), max_size=30)
"""A message, an attachment, a metadata record, or None: a flush."""


class Grown(BytesIO):
    """A file that must only grow at its end."""

    def write(self, data: object) -> int:
        assert self.tell() == len(self.getvalue())
        return super().write(data)  # type: ignore[arg-type]


def appended(steps: Sequence[Step]) -> list[bytes]:
    """Return what stands in the file after each flush, and at the end."""
    out = Grown()
    writer = McapAppender(out, "cubepath")
    channels: dict[int, int] = {}
    stages: list[bytes] = []
    for step in steps:
        match step:
            case None:
                writer.close_chunk()
                stages.append(out.getvalue())
            case dict():
                writer.close_chunk()
                writer.add_metadata("name", step)
            case (name, data):
                writer.close_chunk()
                writer.add_attachment(name, "text/plain", data)
            case (topic, sequence, log_time, publish_time, data):
                if topic not in channels:
                    schema = writer.add_schema(f"{topic % 2}", "jsonschema", b"{}")
                    channels[topic] = writer.add_channel(f"{topic}", "json", schema)
                writer.add_message(channels[topic], sequence, log_time, publish_time, data)
    writer.finish()
    return [*stages, out.getvalue()]


def written(steps: Sequence[Step]) -> list[bytes]:
    """Return the same of the writer of the mcap package."""
    out = BytesIO()
    writer = Writer(out, compression=CompressionType.ZSTD, enable_data_crcs=True)
    writer.start("cubepath", "cubepath")
    channels: dict[int, int] = {}
    stages: list[bytes] = []
    for step in steps:
        match step:
            case None:
                writer.flush()
                stages.append(out.getvalue())
            case dict():
                writer.flush()
                writer.add_metadata("name", step)
            case (name, data):
                writer.flush()
                writer.add_attachment(0, 0, name, "text/plain", data)
            case (topic, sequence, log_time, publish_time, data):
                if topic not in channels:
                    schema = writer.register_schema(f"{topic % 2}", "jsonschema", b"{}")
                    channels[topic] = writer.register_channel(f"{topic}", "json", schema)
                writer.add_message(channels[topic], log_time, data, publish_time, sequence)
    writer.finish()
    return [*stages, out.getvalue()]


@given(STEPS)
@example([])
@example([None, (0, 0, 0, 0, b""), None, None])
def test_the_bytes_are_those_of_the_mcap_package(steps: list[Step]) -> None:
    """After each flush and at the end, and only ever at the end of the file."""
    assert appended(steps) == written(steps)


@given(st.lists(MESSAGES, max_size=30))
def test_publish_time_and_sequence_are_kept(messages: list[Told]) -> None:
    """The reader of the mcap package finds every message whole, all CRCs included."""
    out = BytesIO(appended([part for each in messages for part in (each, None)])[-1])
    found = [
        (int(channel.topic), each.sequence, each.log_time, each.publish_time, each.data)
        for _, channel, each in make_reader(out, validate_crcs=True).iter_messages()
    ]
    assert found == sorted(messages, key=lambda each: each[2])


@pytest.mark.parametrize("number", [-1, 1 << 64])
def test_a_message_that_fits_no_file_leaves_it_as_it_was(number: int) -> None:
    """A time of more than 64 bits raises, and those before and after it stand as without it."""
    found: list[bytes] = []
    for wrong in (False, True):
        out = BytesIO()
        writer = McapAppender(out, "cubepath")
        channel = writer.add_channel("go", "json", writer.add_schema("go", "jsonschema", b"{}"))
        for each in range(3):
            writer.add_message(channel, each, each, each, b"data")
            if wrong:
                with pytest.raises(struct.error):
                    writer.add_message(channel, each, each, number, b"wrong")
        writer.finish()
        found.append(out.getvalue())
    assert found[0] == found[1]
