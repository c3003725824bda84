"""Recordings: what is written is read, by us and by others; what is none is refused."""

import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.description import FORMAT, FREE_FORMAT, SCENE
from cubepath.protocol.recordings.mcap_file import MAGIC
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.recordings.writing import RecordingWriter, copy_recording
from cubepath.protocol.wire.messages import Report, decode
from cubepath.protocol.wire.on_record import schema_of
from tampering.damaged import PARAMETERS, ROUNDS, SCENE_OF_ALL, files, originals, write


def test_what_is_written_is_read(tmp_path: Path) -> None:
    """Messages, parameters and scene come back as they were, without problems."""
    path = tmp_path / "deep" / "down" / "a.mcap"
    write(path)
    found = read_recording(path)
    assert found.problems == ()
    assert found.records == originals()
    assert found.parameters == PARAMETERS
    assert found.scene.start == SCENE_OF_ALL.start
    assert [each.topic for each in found.of_kind("go")] == ["go/coordinator"] * ROUNDS


@given(st.lists(st.tuples(st.binary(max_size=20), st.integers(0, 2**63), st.integers(0, 2**63))))
def test_any_bytes_are_read_as_they_were_written(messages: list[tuple[bytes, int, int]]) -> None:
    """The recorder looks at nothing: it keeps the bytes, the round and the wall clock."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.mcap"
        with RecordingWriter(path, SCENE_OF_ALL, {}) as writer:
            for data, number, wall_ns in messages:
                writer.write("go/coordinator", data, round_number=number, wall_ns=wall_ns)
        found = read_recording(path)
    assert found.problems == ()
    assert [(each.data, each.round, each.wall_ns) for each in found.records] == messages


def test_other_tools_can_open_a_recording(tmp_path: Path) -> None:
    """mcap's own reader finds every message under its topic, with its JSON Schema."""
    path = tmp_path / "a.mcap"
    write(path)
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        found = list(reader.iter_messages())
        scene, again = reader.iter_attachments()
        assert again == scene  # once more at the end
        metadata, repeated, counts = reader.iter_metadata()
        assert repeated == metadata
    assert [message.data for _, _, message in found] == [each.data for each in originals()]
    for schema, channel, _ in found:
        assert channel.message_encoding == "json"
        assert schema is not None
        assert schema.encoding == "jsonschema"
        assert schema.name == f"cubepath.{channel.topic.partition('/')[0]}"
        assert json.loads(schema.data) == schema_of(channel.topic.partition("/")[0])
    assert scene.name == SCENE
    assert metadata.metadata["format"] == FORMAT
    assert metadata.metadata["seed"] == "7"
    assert (counts.name, counts.metadata["messages"]) == ("cubepath-counts", "240")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda _: None, "No such file"),
        (lambda path: path.mkdir(), "a folder, expected a file"),
        (lambda path: path.write_bytes(b""), "empty file"),
        (lambda path: path.write_bytes(b"{}"), "not an MCAP file"),
        (lambda path: path.write_bytes(MAGIC[:4]), "truncated within its first bytes"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path: Path, make: object, message: str) -> None:
    """File and reason stand in one line."""
    path = tmp_path / "x.mcap"
    assert callable(make)
    make(path)
    with pytest.raises(InputError, match=message) as caught:
        read_recording(path)
    assert str(path) in str(caught.value)


def test_a_recording_of_something_else_is_refused(tmp_path: Path) -> None:
    """A whole MCAP file without our parameters, or in another format, is none of ours."""
    for named in ("", "cubepath-recording-1", "cubepath-recording-99"):
        path = tmp_path / "other.mcap"
        with path.open("wb") as stream:
            writer = Writer(stream)
            writer.start()
            if named:
                writer.add_metadata("cubepath", {"format": named})
            writer.finish()  # type: ignore[no-untyped-call]
        with pytest.raises(InputError, match="no cubepath recording") as caught:
            read_recording(path)
        shown = repr(named) if named else "none"
        read = " or ".join(f"'cubepath-recording-{number}'" for number in (4, 5, 6))
        assert str(caught.value).endswith(f": format {shown}, expected {read}")


@pytest.mark.parametrize("written_as", [FORMAT, FREE_FORMAT])
def test_all_formats_are_read_and_kept_by_a_copy(written_as: str, tmp_path: Path) -> None:
    """A recording says which format it has, and so does a copy, which has the same messages."""
    path, out = tmp_path / "a.mcap", tmp_path / "b.mcap"
    path.write_bytes(files()[1].replace(FORMAT.encode(), written_as.encode()))
    found = read_recording(path)
    assert found.format == written_as
    copy_recording(found, out)
    copied = read_recording(out)
    assert (copied.format, copied.records) == (written_as, found.records)


def test_a_copy_is_whole_and_says_what_it_is_of(tmp_path: Path) -> None:
    """A copy of what could be read has no problems, and the notes that were given."""
    path, out = tmp_path / "cut.mcap", tmp_path / "out.mcap"
    path.write_bytes(files()[1])
    found = read_recording(path)
    assert found.problems
    assert copy_recording(found, out, {"recovered": "from a cut one"}) == len(found.records)
    copied = read_recording(out)
    assert copied.problems == ()
    assert copied.records == found.records
    assert copied.parameters == {**PARAMETERS, "recovered": "from a cut one"}
    with pytest.raises(InputError, match="is the recording itself"):
        copy_recording(found, path)


@pytest.mark.slow
def test_a_copy_is_whole_or_not_there(tmp_path: Path) -> None:
    """A file that may not grow so large: one line, and nothing of the copy is left."""
    path = tmp_path / "run.mcap"
    path.write_bytes(files()[0])
    code = """
import resource, sys
from pathlib import Path
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.recordings.writing import copy_recording
from cubepath.protocol.recordings.recording import read_recording
found = read_recording(Path(sys.argv[1]))
sys.dont_write_bytecode = True  # Python before 3.12 would leave half of a file
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]),) * 2)
try:
    copy_recording(found, Path(sys.argv[2]))
except CubepathError as error:
    print(error)
"""
    out = tmp_path / "out.mcap"
    copy_recording(read_recording(path), out)
    size = out.stat().st_size
    out.unlink()
    for most in (0, size - 10):
        done = subprocess.run(
            [sys.executable, "-c", code, path, out, str(most)],
            capture_output=True,
            text=True,
            timeout=60,
            check=True,
        )
        assert done.stdout == f"{out}: cannot be written: File too large\n"
        assert list(tmp_path.iterdir()) == [path]


def test_a_copy_replaces_no_file(tmp_path: Path) -> None:
    """What is there stays as it is."""
    path, out = tmp_path / "run.mcap", tmp_path / "out.mcap"
    path.write_bytes(files()[0])
    out.write_text("other")
    with pytest.raises(InputError, match="exists already, expected a new file"):
        copy_recording(read_recording(path), out)
    assert out.read_text() == "other"


def test_a_message_may_have_keys_that_are_not_known_yet() -> None:
    """A report with a key more is read, also where its move has one."""
    told = (
        '"kind":"report","round":1,"module":0,"before":0,"site":1,"claim":"granted","received":{}'
    )
    move = '"move":{"generator":"edge","at":[0,1],"cost":3}'
    found = decode(f'{{{told},{move},"later":true}}'.encode())
    assert isinstance(found, Report)
    assert found.move == GeneratorPlacement("edge", (0, 1))


def test_a_scene_that_is_no_text_is_refused(tmp_path: Path) -> None:
    """Bytes that are no UTF-8 in the attachment, in a file that is otherwise whole."""
    path = tmp_path / "scene.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.add_metadata("cubepath", {"format": FORMAT})
        writer.add_attachment(0, 0, "scene.toml", "application/toml", b'name = "\xff"')
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(InputError, match=r"scene.mcap \(scene.toml\): not UTF-8 text \(byte 8\)"):
        read_recording(path)
