"""Places of a recording: found without reading what lies before, and the same as by reading all."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.coordinator.playback.selection import RecordedStates
from cubepath.coordinator.playback.timeline import (
    START,
    Cursor,
    Timeline,
    TimelinePosition,
    read_pace,
    read_spot,
)
from cubepath.coordinator.runs.gatherer import Gatherer
from cubepath.coordinator.runs.gathering import gathered
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.recordings import recording as recording_module
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.wire.free_messages import decode_free
from cubepath.protocol.wire.messages import Report, decode
from processes.command_line import GOLDEN
from samples.free_runs import free_run, results, write
from samples.recordings import recorded, with_records

WHOLE = read_recording(GOLDEN / "hex-5.mcap")


@pytest.fixture(autouse=True)
def _small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Recordings in memory have chunks of seven messages, so that ends of chunks are met."""
    monkeypatch.setattr(recording_module, "_UNSTORED", 7)


def marks(reel: Timeline) -> list[Cursor]:
    """Return all places, the end last."""
    found = []
    each = reel.next(START)
    while each is not None:
        found.append(each[0])
        each = reel.next(Cursor(each[0].chunk, each[0].place + 1))
    return [*found, reel.end]


def timed(rounds: list[tuple[int, int]]) -> Recording:
    """Return a recording with messages of these rounds, each so many milliseconds later."""
    wall, records = 5 * 10**9, []
    for number, later in rounds:
        wall += later * 10**6
        records.append(Record("go/coordinator", b"{}", number, wall, 0))
    return with_records(WHOLE, records)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 6), st.integers(0, 3)), max_size=40),
    st.integers(0, 7),
    st.integers(0, 60),
    st.booleans(),
)
def test_places_are_those_found_by_reading_all(
    rounds: list[tuple[int, int]], step: int, ms: int, after: bool
) -> None:
    """Rounds in any order, times that never go back: the first message that is late enough."""
    reel = Timeline(timed(rounds))
    records = list(reel.recording.records)
    places = marks(reel)

    def first(late: list[bool]) -> Cursor:
        return places[late.index(True)] if any(late) else reel.end

    by_round = [each.round >= step + after for each in records]
    assert reel.find(TimelinePosition(step=step), after=after) == first(by_round)
    at = ms / 1000
    by_time = [reel.time_of(each) > at if after else reel.time_of(each) >= at for each in records]
    assert reel.find(TimelinePosition(seconds=at), after=after) == first(by_time)
    assert [mark for mark, _ in reel.backward(reel.end)] == places[-2::-1]
    assert [record for _, record in reel.backward(reel.end)] == records[::-1]


def test_a_place_is_found_without_reading_what_lies_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of thirty chunks a round takes one, and a time no more than halving takes."""
    reel = Timeline(timed([(number, 1) for number in range(210)]))
    read: list[int] = []
    plain = Timeline.chunk

    def counted(self: Timeline, number: int) -> Any:
        read.append(number)
        return plain(self, number)

    assert reel.time_at(reel.end) > 0  # the ends are looked at once
    monkeypatch.setattr(Timeline, "chunk", counted)
    reel.find(TimelinePosition(step=150))
    assert set(read) == {150 // 7}
    read.clear()
    reel.find(TimelinePosition(seconds=0.15))
    assert len(set(read)) <= 6


def stepped(reel: Timeline) -> list[tuple[Cursor, tuple[Any, ...]]]:
    """Return where modules stand at each place, by the gatherer of runs."""
    recording = reel.recording
    gatherer = Gatherer(recording.scene)
    found = []
    for mark in marks(reel):
        found.append((mark, (gatherer.rounds, tuple(gatherer.sites))))
        if mark != reel.end:
            for part in reel.chunk(mark.chunk)[mark.place].parts():
                if isinstance(report := decode(part.data), Report):
                    gatherer.receive(report)
    return found


@pytest.mark.few(1)
@pytest.mark.slow
@pytest.mark.parametrize("spec", ["hex:n=4", "agv:graph=grid4x4,n=7"])
def test_the_state_at_every_place_is_the_gatherers(spec: str) -> None:
    """Of batches in a file and of single reports in memory, at every message of a run."""
    rule = "chain" if spec.startswith("hex") else "tswap"
    recording = recorded(spec, rule, rounds=10)
    several = recorded(spec, rule, rounds=10, processes=2) if spec.startswith("hex") else recording
    for each in (recording, with_records(several, several.records), WHOLE):
        reel = Timeline(each)
        states = RecordedStates(reel)
        for mark, (step, sites) in stepped(reel)[::-1]:
            found = states.at(mark)
            assert (found.step, found.sites) == (step, sites)
            assert found.on >= set(sites)


@pytest.mark.slow
def test_the_state_of_a_run_without_rounds_is_that_of_its_commits(tmp_path: Path) -> None:
    """At every twentieth place what gathering only the messages before it gives."""
    scene, messages = free_run("agv:graph=grid6x6,n=6")
    path = write(tmp_path / "a.mcap", scene, [*messages, *results(scene, messages, 3)])
    for recording in (
        read_recording(path),
        with_records(read_recording(path), read_recording(path).records),
    ):
        reel = Timeline(recording)
        states = RecordedStates(reel)
        places = marks(reel)
        for index in [*range(0, len(places), 20), len(places) - 1][::-1]:
            sites = list(scene.start)
            versions = [0] * len(sites)
            for record in recording.records[:index]:
                message = decode_free(record.data)
                for moved in getattr(message, "parts", [message]):
                    for module, _, to, version in getattr(moved, "motion", ()):
                        if version > versions[module]:
                            versions[module] = version
                            sites[module] = site_from_json(to)
            assert list(states.at(places[index]).sites) == sites
        assert list(states.at(reel.end).sites) == gathered(recording).sites


def test_levels_are_found_where_log_time_is_the_wall_clock(tmp_path: Path) -> None:
    """A level begins with the first commit of it or of a later one; times are those of the log."""
    scene, messages = free_run("agv:graph=grid6x6,n=6")
    whole = [*messages, *results(scene, messages, 3)]
    reel = Timeline(read_recording(write(tmp_path / "a.mcap", scene, whole, wall=True)))
    assert reel.by_wall
    records = list(reel.recording.records)
    levels = [
        decode_free(each.data).level if each.kind == "commit" else 0  # type: ignore[union-attr]
        for each in records
    ]
    places = marks(reel)
    for level in (1, 2, max(levels)):
        late = next(place for place, each in enumerate(levels) if each >= level)
        assert reel.find(TimelinePosition(step=level)) == places[late]
        assert reel.step_at(places[late]) >= level
        assert reel.step_at(places[late - 1]) < level
    assert reel.find(TimelinePosition(step=max(levels) + 1)) == reel.end
    assert reel.step_at(reel.end) == max(levels)


def test_an_empty_recording_has_its_end_alone() -> None:
    """Nothing is read, and nothing is found."""
    reel = Timeline(timed([]))
    assert reel.end == START == reel.settled(START) == reel.find(TimelinePosition(step=3))
    assert (reel.seconds, reel.step_at(START), reel.time_at(START)) == (0.0, 0, 0.0)


@pytest.mark.parametrize(
    "text", ["", "x", "-1", "1.5", "3.5", "s", ".s", "1e3", "2x", "1s2", "\u0661"]
)
def test_what_is_no_place_is_refused(text: str) -> None:
    """In one line that says what is one."""
    with pytest.raises(InputError, match=r"expected a round or level such as 12, or a time such"):
        read_spot(text)


@pytest.mark.parametrize("text", ["", "x", "0", "0x", "-1", "nan", "inf", "1e999", "2X", "1xx"])
def test_what_is_no_rate_is_refused(text: str) -> None:
    """In one line that says what is one."""
    with pytest.raises(InputError, match=r"rate=.*: expected rounds or levels a second such as 10"):
        read_pace(text)


def test_places_and_rates_are_written_as_they_are_read() -> None:
    """What is shown can be typed in again."""
    for text in ("12", "0", "3.5s", "0.25s"):
        assert str(read_spot(text)) == text
    for text in ("10", "2x", "max", "0.5x"):
        assert str(read_pace(text)) == text
    assert str(read_pace("2", by_wall=True)) == "2x"
