"""Replaying recordings that begin on the way, or have some messages of a run alone."""

import json
from dataclasses import replace as with_fields
from pathlib import Path

import pytest
from msgspec import structs

from cubepath.coordinator.commands.main import main
from cubepath.coordinator.playback.player import Player, replay
from cubepath.coordinator.playback.selection import RecordedStates
from cubepath.coordinator.playback.timeline import Timeline, TimelinePosition
from cubepath.coordinator.runs.contents import info
from cubepath.coordinator.verification.recording import verify
from cubepath.coordinator.verification.recovery import recover
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.recordings.cutting import filter_recording, split_recording
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.wire.messages import Reports, decode, encode
from processes.command_line import GOLDEN
from samples.recordings import new_path

HEX = GOLDEN / "hex-5.mcap"
AGV = GOLDEN / "agv-6.mcap"
FREE = GOLDEN / "hex-free-5.mcap"


def cut(
    source: Path, first: int | None = None, until: int | None = None, exclude: tuple[str, ...] = ()
) -> Path:
    """Return what is left of a golden recording."""
    filter_recording(source, out := new_path(), first=first, until=until, exclude=exclude)
    return out


def test_a_recording_that_begins_late_is_compared_from_its_first_whole_round_on() -> None:
    """Reports of that round say where modules stood; the numbers are of what is there."""
    found = replay(cut(AGV, first=5))
    assert (found.agrees, found.same, found.complete) == (True, False, False)
    assert (found.rounds_compared, found.rounds, found.differences) == (12, 12, ())
    assert found.not_compared == ("rounds 1 to 4", "cubes", "summary")
    told = read_recording(AGV).moves()["round"]
    assert found.moves == int((told >= 5).sum())
    whole = len(read_recording(AGV).records)
    assert f"of {whole} messages (from 5)" in str(found.lacking)


def test_what_differs_in_a_late_recording_is_found() -> None:
    """A round of other moves than on record, though nothing before it is known."""
    recording = read_recording(cut(HEX, first=5))
    records = list(recording.records)
    place = next(n for n, each in enumerate(records) if each.kind == "edges" and each.round == 7)
    records[place] = with_fields(records[place], data=b'{"kind":"edges","round":7,"moves":[]}')
    found = replay(with_fields(recording, records=records))
    assert found.differences == ("round 7: other moves were gathered than are on record",)
    assert not found.agrees


def test_a_beginning_is_the_same_as_far_as_it_goes(tmp_path: Path) -> None:
    """Not complete, and no difference: cut by rounds, split, or cut off by damage."""
    first, *_ = split_recording(HEX, tmp_path, parts=3)
    for path, rounds in ((cut(HEX, until=10), 10), (first, 9)):
        found = replay(path)
        assert (found.same, found.complete, found.rounds_compared) == (True, False, rounds)
        assert found.result == "the same as recorded, as far as it goes"


def test_what_was_left_out_by_topic_is_not_compared() -> None:
    """Without edges the results are, without cubes the rounds, without reports nothing."""
    no_edges = replay(cut(HEX, exclude=("edges",)))
    assert (no_edges.not_compared, no_edges.agrees) == (("rounds 1 to 29",), True)
    assert no_edges.result == "the same as recorded; not compared: rounds 1 to 29"
    no_cubes = replay(cut(HEX, exclude=("cube",)))
    assert (no_cubes.not_compared, no_cubes.rounds_compared) == (("cubes",), 29)
    no_reports = replay(cut(HEX, exclude=("reports",)))
    assert no_reports.not_compared == ("rounds 1 to 29", "cubes", "summary")
    assert no_reports.agrees


def test_reports_that_cannot_be_are_told_with_their_file_and_round() -> None:
    """Of the run as it is numbered on record, also where it is gathered from a later round on."""
    recording = read_recording(cut(HEX, first=5))
    records = list(recording.records)
    place, record = next(
        each for each in enumerate(records) if each[1].kind == "reports" and each[1].round == 7
    )
    message = decode(record.data)
    assert isinstance(message, Reports)
    report = message.parts[0]
    parts = [structs.replace(report, site=[9, 9]), *message.parts[1:]]
    records[place] = with_fields(record, data=encode(structs.replace(message, parts=parts)))
    why = (
        rf"{recording.path}: round 7: report of module_{report.module}: it ends at \[9,9\], and the"
        r" moves take it to \["
    )
    with pytest.raises(CheckError, match=why):
        replay(with_fields(recording, records=records))


@pytest.mark.parametrize("first", [None, 5])
def test_levels_are_compared_only_from_the_start_of_a_run(first: int | None) -> None:
    """Of a part without rounds nothing is, since edges are written at the end; it is no failure."""
    found = replay(cut(FREE, first=first, until=None if first else 5))
    assert found.agrees
    assert not found.same
    assert found.not_compared[0].startswith("levels 1 to ")
    assert found.rounds_compared == 0
    assert replay(FREE).rounds_compared == 19


@pytest.mark.parametrize("path", [HEX, FREE], ids=lambda path: path.stem)
def test_who_begins_at_the_start_or_goes_back_there_has_all_compared(path: Path) -> None:
    """By --from, and by a seek from the middle."""
    found = replay(path, begin=0)
    assert (found.same, found.not_compared, found.after) == (True, (), 0)
    with Player(path) as player:
        player.step("round", 3)
        player.seek(0)
        player.play()
        again = player.wait(10)
    assert (again.same, again.path_digest) == (True, found.path_digest)
    assert again.messages > found.messages


def test_the_numbers_of_a_part_say_from_where_on_they_count() -> None:
    """After a jump; what was compared before it is counted by the rounds that were compared."""
    with Player(HEX) as player:
        player.step("round", 5)
        player.seek(12)
        player.play()
        found = player.wait(10)
    assert (found.after, found.rounds, found.rounds_compared) == (11, 18, 23)
    late = replay(cut(HEX, first=5))
    assert (late.after, late.rounds) == (4, 25)


def test_who_seeks_in_a_late_recording_is_told_where_modules_stand() -> None:
    """Before its first whole round, in which one was reported in part, and after it."""
    whole, late = (
        RecordedStates(Timeline(read_recording(each))) for each in (HEX, cut(HEX, first=5))
    )
    reels = [Timeline(read_recording(each)) for each in (HEX, cut(HEX, first=5))]
    for number in (5, 6, 20):
        marks = [reel.find(TimelinePosition(step=number)) for reel in reels]
        assert late.at(marks[1]) == whole.at(marks[0])
    with Player(cut(HEX, first=5)) as player:
        player.seek(12)
        player.play()
        assert player.wait(10).not_compared[0] == "rounds 1 to 11"


def test_parts_say_that_they_are_not_complete_and_how_much_of_a_run_they_hold() -> None:
    """`info` as `verify` does; whole rounds or levels are counted wherever a part begins."""
    for path, whole in (
        (cut(HEX, first=5), 25),
        (cut(HEX, until=10), 10),
        (cut(FREE, first=5), 15),
    ):
        assert not info(path)["complete"]
        assert not verify(path).complete
        out = new_path()
        assert recover(path, out).rounds == whole
        assert verify(out) == verify(path)
    assert verify(cut(FREE, first=5)).rounds == 15


@pytest.mark.slow
def test_one_line_says_what_is_missing(capsys: pytest.CaptureFixture[str]) -> None:
    """With exit code 0, and in the document."""
    late = str(cut(HEX, first=5))
    assert main(["replay", late, "--json"]) == 0
    said = capsys.readouterr()
    messages = [len(read_recording(each).records) for each in (late, HEX)]
    lacking = "{} of {} messages (from 5)".format(*messages)
    assert said.err == f"cubepath: {late}: {lacking}\n"
    assert json.loads(said.out)["lacking"] == lacking
