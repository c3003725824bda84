"""Recordings of runs with rounds whose log times are the wall clock: read, nothing is different."""

from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given, strategies as st
from mcap.reader import NonSeekingReader

from cubepath.coordinator.playback.player import replay
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import run
from cubepath.coordinator.verification.recording import verify
from cubepath.protocol.recordings.cutting import filter_recording
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.writing import RecordingWriter
from processes.command_line import GOLDEN
from samples.recordings import new_path, recorded

NAMES = ["hex-5", "agv-6", "agv-3", "arm-6"]


@cache
def by_round(name: str) -> Recording:
    """Return a recording that is kept."""
    return read_recording(GOLDEN / f"{name}.mcap")


@cache
def by_wall(name: str) -> Path:
    """Return a recording that is kept as it would be by the wall clock, in small chunks."""
    like = by_round(name)
    parameters = {**like.parameters, "log_time": "wall"}
    with RecordingWriter(
        out := new_path(), like.scene, parameters, like.schedule, written_as=like.format
    ) as writer:
        for number, each in enumerate(like.records):
            if number % 40 == 0:
                writer.flush()
            writer.write(each.topic, each.data, round_number=each.round, wall_ns=each.wall_ns)
    return out


def log_times(path: Path) -> list[int]:
    """Return the log times of a file as another library reads them, in the order of writing."""
    with path.open("rb") as file:
        found = NonSeekingReader(file).iter_messages(log_time_order=False)
        return [message.log_time for _, _, message in found]


@pytest.mark.parametrize("name", NAMES)
def test_other_tools_see_the_wall_clock_and_we_the_rounds(name: str) -> None:
    """Log times are nanoseconds in the file; messages, rounds and checks are the same."""
    whole = by_round(name)
    assert log_times(by_wall(name)) == [record.wall_ns for record in whole.records]
    found = read_recording(by_wall(name))
    assert list(found.records) == list(whole.records)
    assert verify(found) == verify(whole)
    for records, least in found.blocks():
        assert list(records) or least > 0


@given(st.sampled_from(NAMES), st.integers(0, 30), st.integers(0, 5))
def test_rounds_are_found(name: str, first: int, more: int) -> None:
    """A range of rounds has the messages of these, whatever chunks they stand in."""
    wanted = range(first, first + more)
    found = list(read_recording(by_wall(name)).written(rounds=wanted))
    assert found == [record for record in by_round(name).records if record.round in wanted]


def test_what_is_to_come_is_known() -> None:
    """Rounds are complete when nothing of them is to come, as without the wall clock."""
    ahead = [(list(records), least) for records, least in read_recording(by_wall("hex-5")).blocks()]
    assert len(ahead) > 10
    for (_, least), (records, _) in pairwise(ahead):
        assert all(record.round >= least for record in records)
    assert [least for _, least in ahead] == sorted(least for _, least in ahead)


def test_what_is_cut_stays_so() -> None:
    """A filter by rounds takes these, and log times stay the wall clock."""
    filter_recording(by_wall("hex-5"), out := new_path(), first=3, until=4)
    expected = [record for record in by_round("hex-5").records if record.round in (3, 4)]
    assert list(read_recording(out).records) == expected
    assert log_times(out) == [record.wall_ns for record in expected]


def test_a_truncated_file_is_read_as_far_as_it_goes() -> None:
    """What is salvaged has its rounds, too."""
    (cut := new_path()).write_bytes(by_wall("hex-5").read_bytes()[:20000])
    found = list(read_recording(cut).records)
    assert found
    assert found == list(by_round("hex-5").records)[: len(found)]


def test_a_log_time_that_is_neither_is_found() -> None:
    """A log time beside the wall clock of its message, and a message without a round."""
    like = by_round("hex-5")
    parameters = {**like.parameters, "log_time": "round"}
    with RecordingWriter(
        out := new_path(), like.scene, parameters, written_as=like.format
    ) as writer:
        for each in like.records:
            writer.write(each.topic, each.data, round_number=each.round + 7, wall_ns=each.wall_ns)
    shifted = read_recording(out)
    walled = replace(shifted, parameters={**parameters, "log_time": "wall"})
    (check,) = [check for check in verify(walled).checks if check.name == "messages"]
    assert "(ready/process_0, round 7) is ready/process_0 of round 0" in check.detail
    with RecordingWriter(
        bad := new_path(), like.scene, {"log_time": "wall"}, written_as=like.format
    ) as writer:
        writer.write("go/coordinator", b"{}", round_number=1, wall_ns=77)
    assert [record.round for record in read_recording(bad).records] == [77]
    assert not verify(bad).ok


@pytest.mark.thorough
def test_a_run_recorded_both_ways_is_one_run() -> None:
    """It verifies and replays, and has the same moves; its parameters say which it is."""
    log = new_path()
    run(
        Plan(
            "hex:n=4",
            "chain",
            seed=5,
            hesitate=0.3,
            processes=0,
            max_rounds=20,
            log=log,
            log_time="wall",
        )
    )
    found = read_recording(log)
    assert found.parameters["log_time"] == "wall"
    assert log_times(log) == [record.wall_ns for record in found.records]
    assert verify(found).ok
    assert replay(found).same
    other = recorded("hex:n=4", "chain", seed=5, hesitate=0.3, rounds=20)
    assert "log_time" not in other.parameters
    moves = [
        list(zip(*(each.moves()[name] for name in ("round", "module", "to")), strict=True))
        for each in (found, other)
    ]
    assert moves[0] == moves[1]
    assert verify(found).path_digest == verify(other).path_digest
