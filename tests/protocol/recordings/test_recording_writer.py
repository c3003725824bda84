"""Writing recordings when something goes wrong: a kill, a full disk, a place that is none."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.recordings.writing import (
    CHUNK_BYTES,
    TOPICS_MAX,
    RecordingFull,
    RecordingWriter,
    copy_recording,
)
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.messages import Go, encode
from tampering.damaged import chunks_of

EVERY = 50
"""Messages between two flushes of the process below."""
WRITER = """
import resource, signal, sys
from pathlib import Path
from cubepath.protocol.wire.messages import Go, encode
from cubepath.protocol.recordings.writing import RecordingFull, RecordingWriter
from cubepath.protocol.scenes.specs import scene_from_spec

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
sys.dont_write_bytecode = True  # Python before 3.12 would leave half of a file
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
number = 0
try:
    with RecordingWriter(Path(sys.argv[1]), scene_from_spec("agv:graph=P3,n=1"), {}) as writer:
        while True:
            number += 1
            data = encode(Go(number, "sense"))
            writer.write("go/coordinator", data, round_number=number, wall_ns=number)
            if number % int(sys.argv[3]) == 0:
                writer.flush()
            print(number, flush=True)
except RecordingFull as error:
    print(error, file=sys.stderr)
    sys.exit(1)
"""
KILLED = """
import os, signal, sys
from itertools import count
from pathlib import Path
from cubepath.protocol.wire.messages import Go, encode
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.scenes.specs import scene_from_spec

SCENE = scene_from_spec("agv:graph=P3,n=1")

def write(path, length, out):
    now = 0
    # A message each millisecond.
    writer = RecordingWriter(path, SCENE, {}, clock=lambda: now / 1000)
    for now in count(1):
        number = now // length + 1
        data = encode(Go(number, "sense", {"region": now}))
        writer.write("go/coordinator", data, round_number=number, wall_ns=now)
        os.write(out, b"message\\n")
        if now % length == length - 1:
            writer.flush()
            os.write(out, b"round\\n")

for place, job in enumerate(sys.argv[2:]):
    length, after = map(int, job.split(","))
    ours, its = os.pipe()
    child = os.fork()
    if not child:
        os.close(ours)
        write(Path(sys.argv[1]) / f"{place}.mcap", length, its)
    os.close(its)
    with open(ours) as told:
        lines = [told.readline() for _ in range(after)]
        os.kill(child, signal.SIGKILL)
        lines += told  # what it still said before it ended
    os.waitpid(child, 0)
    print(lines.count("message\\n"), lines.count("round\\n"))
"""
"""Writes recordings in child processes, kills each after so many lines, and says what it said."""
SCENE = scene_from_spec("agv:graph=P3,n=1")


def start(path: Path, most: int, every: int = EVERY) -> subprocess.Popen[str]:
    """Start a process that writes messages to `path` and prints the number of each."""
    return subprocess.Popen(
        [sys.executable, "-W", "error", "-c", WRITER, str(path), str(most), str(every)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


LONG = 10**9
"""Messages of a round that never ends."""


@pytest.mark.slow
def test_a_kill_loses_less_than_a_second_and_no_finished_round(tmp_path: Path) -> None:
    """kill -9 at any moment: what was written a second before can be read, and whole rounds."""
    jobs = [(length, after) for length in (1, 7, 300, LONG) for after in (1, 99, 777, 1313, 1999)]
    told = subprocess.run(
        [sys.executable, "-W", "error", "-c", KILLED, tmp_path, *(f"{a},{b}" for a, b in jobs)],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    ).stdout.splitlines()
    for place, ((length, after), line) in enumerate(zip(jobs, told, strict=True)):
        messages, rounds = map(int, line.split())
        assert messages + rounds >= after
        found = read_recording(tmp_path / f"{place}.mcap")
        assert found.problems
        there = [record.wall_ns for record in found.records]
        assert there == [*range(1, len(there) + 1)]
        assert len(there) >= messages - 1000
        assert len(there) >= rounds * length - 1


def test_a_message_waits_for_half_a_second_and_no_longer(tmp_path: Path) -> None:
    """Also where none follows, if whoever waits says so; and before, nothing is written."""
    path = tmp_path / "a.mcap"
    now = [0.0]
    there: list[int] = []

    def look() -> None:
        there.append(len(read_recording(path).records))

    data = encode(Go(1, "sense"))
    with RecordingWriter(path, SCENE, {}, clock=lambda: now[0]) as writer:
        for now[0] in (100.0, 100.4, 100.6, 101.0, 101.2, 103.0):
            writer.write("go/coordinator", data, round_number=1, wall_ns=0)
            look()
        assert there == [0, 0, 3, 3, 3, 6]
        writer.write("go/coordinator", data, round_number=1, wall_ns=0)
        for now[0] in (103.4, 103.5, 105.0):
            writer.flush_if_due()
            look()
        assert there[6:] == [6, 7, 7]


def test_a_copy_is_written_in_full_chunks(tmp_path: Path) -> None:
    """Nobody reads it before it is whole, so no clock divides it: two copies are equal."""
    path, copy, again = (tmp_path / f"{name}.mcap" for name in "abc")
    with RecordingWriter(path, SCENE, {}) as writer:
        for number in range(100):
            data = encode(Go(number, "sense"))
            writer.write("go/coordinator", data, round_number=number, wall_ns=number)
            writer.flush()
    for out in (copy, again):
        copy_recording(read_recording(path), out)
    assert copy.read_bytes() == again.read_bytes()
    assert len(chunks_of(copy.read_bytes())) == 1 < len(chunks_of(path.read_bytes()))


@pytest.mark.slow
@pytest.mark.parametrize("most", [6_000, 40_001])
def test_a_full_disk_is_told_in_one_line_and_keeps_what_was_flushed(
    tmp_path: Path, most: int
) -> None:
    """A file that may grow no further: `RecordingFull`, and a readable beginning."""
    path = tmp_path / "full.mcap"
    with start(path, most) as child:
        out, err = child.communicate(timeout=60)
    assert child.returncode == 1
    (line,) = err.splitlines()
    written = len(out.splitlines())
    assert line.startswith(f"{path}: recording stopped after ")
    assert line.endswith("File too large")
    assert path.stat().st_size <= most
    found = read_recording(path)
    assert found.problems
    assert len(found.records) > written - 2 * EVERY
    assert [record.round for record in found.records] == [*range(1, len(found.records) + 1)]


def test_long_messages_wait_for_no_others(tmp_path: Path) -> None:
    """What was written but for less than a chunk can be read at any time, whatever the clock."""
    path = tmp_path / "a.mcap"
    data = encode(Go(1, "sense", {"region": 1, "x" * 90_000: 1}))
    with RecordingWriter(path, SCENE, {}, clock=lambda: 0.0) as writer:
        for number in range(1, 20):
            writer.write("go/coordinator", data, round_number=1, wall_ns=0)
            found = len(read_recording(path).records)
            assert number - CHUNK_BYTES / len(data) < found <= number
        writer.write("go/coordinator", data * 10, round_number=1, wall_ns=0)
        assert len(read_recording(path).records) == 20


@pytest.mark.slow
def test_no_room_even_for_the_beginning(tmp_path: Path) -> None:
    """Where not even the scene fits the recording does not begin, and nothing is left open."""
    with start(tmp_path / "full.mcap", 100) as child:
        out, err = child.communicate(timeout=60)
    assert (child.returncode, out) == (1, "")
    assert err.splitlines() == [
        f"{tmp_path / 'full.mcap'}: recording stopped after 0 messages: File too large"
    ]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only some systems have /dev/full")
def test_a_device_that_is_always_full() -> None:
    """The error is one of the family, with the reason that the system gives."""
    with pytest.raises(RecordingFull, match="after 0 messages: No space left") as caught:
        RecordingWriter(Path("/dev/full"), scene_from_spec("agv:graph=P3,n=1"), {})
    assert isinstance(caught.value, CheckError)


def test_after_a_full_disk_nothing_more_is_written(tmp_path: Path) -> None:
    """Whoever goes on writing is told again, and closing is no error."""
    path = tmp_path / "a.mcap"
    writer = RecordingWriter(path, scene_from_spec("agv:graph=P3,n=1"), {})
    full = os.open("/dev/full", os.O_WRONLY)
    os.dup2(full, writer._stream.fileno())
    os.close(full)
    writer.write("go/coordinator", encode(Go(1, "sense")), round_number=1, wall_ns=0)
    with pytest.raises(RecordingFull, match="after 1 messages: No space left"):
        writer.flush()
    with pytest.raises(RecordingFull, match="had to stop before"):
        writer.write("go/coordinator", b"", round_number=1, wall_ns=0)
    writer.close()
    assert read_recording(path).records == ()


def test_a_disk_that_is_full_at_the_very_end_is_told(tmp_path: Path) -> None:
    """The last bytes wait in a buffer until the file is closed."""
    writer = RecordingWriter(tmp_path / "a.mcap", scene_from_spec("agv:graph=P3,n=1"), {})
    writer.write("go/coordinator", encode(Go(1, "sense")), round_number=1, wall_ns=0)
    full = os.open("/dev/full", os.O_WRONLY)
    os.dup2(full, writer._stream.fileno())
    os.close(full)
    with pytest.raises(RecordingFull, match="after 1 messages: No space left"):
        writer.close()


@pytest.mark.parametrize("way", ["removed", "moved", "replaced", "with its folder"])
def test_a_file_that_is_gone_is_told_and_written_no_further(way: str, tmp_path: Path) -> None:
    """At the next flush, and at the latest at the end."""
    for most in (EVERY, 1):
        folder = tmp_path / f"{most}"
        path = folder / "a.mcap"
        writer = RecordingWriter(path, scene_from_spec("agv:graph=P3,n=1"), {})
        if way == "with its folder":
            shutil.rmtree(folder)
        elif way == "moved":
            path.rename(folder / "b.mcap")
        else:
            path.unlink()
            if way == "replaced":
                path.write_text("other")
        told = rf"a\.mcap: recording stopped after {most} messages: its file was removed or moved$"
        with pytest.raises(RecordingFull, match=told):
            for number in range(1, most + 1):
                data = encode(Go(number, "sense"))
                writer.write("go/coordinator", data, round_number=number, wall_ns=0)
            if most == EVERY:
                writer.flush()
            writer.close()
        writer.close()
        assert way != "replaced" or path.read_text() == "other"


@pytest.mark.parametrize("left", [0, 100])
@pytest.mark.parametrize("flushes", [0, 1, 2])
def test_a_file_that_is_cut_is_told(flushes: int, left: int, tmp_path: Path) -> None:
    """At the next flush or at the end: the sizes are in the error, and nothing more is written."""
    for most in (EVERY, 1):
        path = tmp_path / f"{most}.mcap"
        writer = RecordingWriter(path, scene_from_spec("agv:graph=P3,n=1"), {})
        told = rf"stopped after {flushes * EVERY + most} messages: its file was cut to {left}"
        with pytest.raises(RecordingFull, match=rf"{told} bytes, expected at least \d+$"):
            for number in range(1, flushes * EVERY + most + 1):
                data = encode(Go(number, "sense"))
                if number == flushes * EVERY + 1:
                    os.truncate(path, left)
                writer.write("go/coordinator", data, round_number=number, wall_ns=0)
                if number % EVERY == 0:
                    writer.flush()
            writer.close()
        writer.close()


def test_closing_twice_is_closing_once(tmp_path: Path) -> None:
    """A closed recording stays as it is."""
    path = tmp_path / "a.mcap"
    with RecordingWriter(path, scene_from_spec("agv:graph=P3,n=1"), {}) as writer:
        writer.close()
        before = path.read_bytes()
    assert path.read_bytes() == before
    assert read_recording(path).problems == ()


def test_where_no_file_can_be_no_file_is_made(tmp_path: Path) -> None:
    """A folder, and a file in place of a folder, are refused by name."""
    scene = scene_from_spec("agv:graph=P3,n=1")
    (tmp_path / "file").write_text("")
    for path in (tmp_path, tmp_path / "file" / "a.mcap"):
        with pytest.raises(InputError, match=r"cannot be written|exists already") as caught:
            RecordingWriter(path, scene, {})
        assert str(path) in str(caught.value)
    assert [each.name for each in tmp_path.iterdir()] == ["file"]


def test_a_round_that_no_recording_has_is_refused(tmp_path: Path) -> None:
    """Log times are whole numbers of 64 bits: what is none is told with its message."""
    path = tmp_path / "rounds.mcap"
    data = encode(Go(1, "sense"))
    with RecordingWriter(path, scene_from_spec("agv:graph=P3,n=1"), {}) as writer:
        writer.write("go/coordinator", data, round_number=(1 << 64) - 1, wall_ns=0)
        for number in (-1, 1 << 64):
            with pytest.raises(
                InputError, match=rf"message 1 \(go/coordinator\) is of round {number},"
            ):
                writer.write("go/coordinator", data, round_number=number, wall_ns=0)
    assert [record.round for record in read_recording(path).records] == [(1 << 64) - 1]


@pytest.mark.nightly
def test_as_many_topics_as_there_are_numbers(tmp_path: Path) -> None:
    """The last channel is written and read; one more is refused, and the file is whole."""
    path = tmp_path / "topics.mcap"
    data = encode(Go(1, "sense"))
    with RecordingWriter(path, scene_from_spec("agv:graph=P3,n=1"), {}) as writer:
        for number in range(TOPICS_MAX):
            writer.write(f"go/process_{number}", data, round_number=1, wall_ns=0)
        with pytest.raises(InputError, match="one more topic than a recording can have"):
            writer.write("go/coordinator", data, round_number=1, wall_ns=0)
    found = read_recording(path)
    assert (len(found.records), found.problems) == (TOPICS_MAX, ())
