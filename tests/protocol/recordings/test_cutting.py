"""Recordings filtered, split and merged: the same messages, and each file says what it lacks."""

from collections import Counter
from collections.abc import Iterable
from fnmatch import fnmatch
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings, strategies as st

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.cutting import filter_recording, merge_recordings, split_recording
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.recordings.writing import RecordingWriter
from processes.command_line import GOLDEN
from samples.recordings import new_path

PATHS = sorted(GOLDEN.glob("*.mcap"))
NAMES = [path.stem for path in PATHS]


@cache
def golden(name: str) -> Recording:
    """Return one of the recordings that are kept."""
    return read_recording(GOLDEN / f"{name}.mcap")


def written(like: Recording, records: Iterable[Record]) -> Path:
    """Return a recording of the same run with these messages, numbered anew."""
    out = new_path()
    with RecordingWriter(
        out, like.scene, like.parameters, like.schedule, written_as=like.format
    ) as writer:
        for each in records:
            writer.write(each.topic, each.data, round_number=each.round, wall_ns=each.wall_ns)
    return out


ways = st.one_of(
    st.fixed_dictionaries({"parts": st.integers(1, 12)}),
    st.fixed_dictionaries({"rounds": st.integers(1, 30)}),
    st.fixed_dictionaries({"seconds": st.floats(0.01, 1.0)}),
    st.fixed_dictionaries({"size": st.integers(60_000, 200_000)}),
)


@pytest.mark.thorough
@settings(max_examples=10)
@given(st.sampled_from(NAMES), ways, st.randoms(use_true_random=False))
def test_parts_in_any_order_make_the_recording(name: str, way: dict[str, Any], random: Any) -> None:
    """Whatever they are split by: all messages, numbers, times and parameters, none twice."""
    whole = golden(name)
    parts = list(split_recording(whole, new_path(""), **way))
    said = [record for path in parts for record in read_recording(path).records]
    assert said == list(whole.records)
    if "size" in way:
        assert all(path.stat().st_size <= way["size"] for path in parts)
    if "parts" in way:
        assert len(parts) == way["parts"]
    again = [random.choice(parts) for _ in range(random.randrange(3))]
    random.shuffle(parts)
    out = new_path()
    assert merge_recordings([*parts, *again], out) == len(whole.records)
    merged = read_recording(out)
    assert list(merged.records) == list(whole.records)
    assert (merged.parameters, merged.format) == (whole.parameters, whole.format)


@pytest.mark.parametrize("rounds", [1, 7])
def test_parts_by_rounds_hold_so_many(rounds: int) -> None:
    """From round 1 on, with what comes before it in the first part; no round lies in two parts."""
    found = [
        {record.round for record in read_recording(path).records}
        for path in split_recording(golden("agv-6"), new_path(""), rounds=rounds)
    ]
    assert [max(part) for part in found[:-1]] == [*range(rounds, max(found[-1]), rounds)]
    assert sum(map(len, found)) == len({record.round for record in golden("agv-6").records})


patterns = st.sampled_from(
    [
        "*",
        "re*",
        "report",
        "ready/process_?",
        "go/*",
        "*/coordinator",
        "[h-k]*",
        "nothing",
        "commit",
    ]
)


@given(
    st.sampled_from(NAMES),
    st.lists(patterns, max_size=2),
    st.lists(patterns, max_size=2),
    st.integers(0, 30),
    st.integers(0, 30),
)
def test_a_filter_takes_what_fits(
    name: str, topics: list[str], exclude: list[str], first: int, more: int
) -> None:
    """By topic or kind, and by round; what is taken keeps its bytes, times and number.

    A pattern that matches nothing on record is refused, whatever the others match.
    """

    def fits(record: Record, globs: list[str]) -> bool:
        return any(fnmatch(record.topic, each) or fnmatch(record.kind, each) for each in globs)

    expected = [
        record
        for record in golden(name).records
        if (not topics or fits(record, topics))
        and not fits(record, exclude)
        and first <= record.round <= first + more
    ]
    out = new_path()
    options: dict[str, Any] = {"topics": topics, "exclude": exclude}
    options |= {"first": first, "until": first + more}
    there = golden(name).records
    astray = any(not any(fits(record, [each]) for record in there) for each in topics + exclude)
    if astray or not expected:
        why = "nothing on record matches" if astray else "found no such message, expected some"
        with pytest.raises(InputError, match=why):
            filter_recording(golden(name), out, **options)
        assert not out.exists()
        return
    assert filter_recording(golden(name), out, **options) == len(expected)
    found = read_recording(out)
    assert list(found.records) == expected
    assert not found.problems
    told = found.parameters.get("whole_messages")
    assert told == (
        None if expected == list(golden(name).records) else str(golden(name).counts().messages)
    )


def test_filters_that_leave_nothing_out_between_them_make_the_recording() -> None:
    """What one filter takes and another leaves out is put together again by number."""
    whole = golden("hex-5")
    one, other, out = new_path(), new_path(), new_path()
    filter_recording(whole, one, topics=["re*"])
    filter_recording(whole, other, exclude=["re*"])
    half = new_path()
    filter_recording(one, half, until=3)
    assert read_recording(half).parameters["filtered"] == "topics re*; until 3"
    merge_recordings([half, other], out)
    assert read_recording(out).parameters["whole_messages"] == str(len(whole.records))
    merge_recordings([out, one], again := new_path())
    assert list(read_recording(again).records) == list(whole.records)
    assert read_recording(again).parameters == whole.parameters


@pytest.mark.thorough
@settings(max_examples=15)
@given(st.sampled_from(NAMES), st.integers(0, 2**20), st.floats(0.5, 1.0))
def test_two_recorders_have_heard_one_run(name: str, late: int, share: float) -> None:
    """Each lost some; together they have what either has, as often as the one with most."""
    whole = list(golden(name).records)
    cut = int(share * len(whole))
    one = [each for number, each in enumerate(whole) if number < cut or number % 3]
    other = [
        Record(each.topic, each.data, each.round, each.wall_ns + late, each.sequence)
        for number, each in enumerate(whole)
        if number >= cut or number % 2
    ]
    if not one or not other:
        return
    paths = [written(golden(name), each) for each in (one, other)]
    out = new_path()
    merge_recordings(paths, out)
    found = list(read_recording(out).records)
    said = [(each.topic, each.data) for each in found]
    mine = Counter((each.topic, each.data) for each in one)
    theirs = Counter((each.topic, each.data) for each in other)
    assert Counter(said) == mine | theirs
    assert [each.sequence for each in found] == list(range(len(found)))
    assert is_within([(each.topic, each.data) for each in one], said)


def is_within(some: list[Any], all_of_them: list[Any]) -> bool:
    """Return whether one list is the other with items left out."""
    rest = iter(all_of_them)
    return all(each in rest for each in some)


def test_files_one_after_another_keep_what_is_said_twice() -> None:
    """Equal messages of files whose times do not overlap are different messages."""
    whole = list(golden("hex-free-5").records)
    wall = sorted(each.wall_ns for each in whole)[len(whole) // 2]
    halves = [[each for each in whole if (each.wall_ns > wall) == later] for later in (False, True)]
    paths = [written(golden("hex-free-5"), half) for half in halves]
    assert merge_recordings(paths[::-1], new_path()) == len(whole)


def test_files_of_one_recorder_make_one() -> None:
    """Each says its number, and from which round on it is whole; together they begin first."""
    whole = golden("hex-5")
    paths = []
    for number, begins in enumerate(("1", "12")):
        told = {**whole.parameters, "part": str(number), "attached": begins}
        paths.append(new_path())
        with RecordingWriter(paths[-1], whole.scene, told, written_as=whole.format) as writer:
            for each in whole.records:
                if (each.round >= 12) == bool(number):
                    writer.write(
                        each.topic, each.data, round_number=each.round, wall_ns=each.wall_ns
                    )
    count = merge_recordings(paths[::-1], out := new_path())
    assert count == len(whole.records)
    found = read_recording(out)
    assert list(found.records) == list(whole.records)
    assert found.parameters == {**whole.parameters, "attached": "1"}


def test_other_runs_are_not_merged() -> None:
    """Another scene, seed or course of the run is named in one line, and nothing is written."""
    whole = golden("agv-3")
    out = new_path()
    with pytest.raises(InputError, match=r"agv-6.mcap: another scene than in .*agv-3.mcap"):
        merge_recordings([GOLDEN / "agv-3.mcap", GOLDEN / "agv-6.mcap"], out)
    told = {**whole.parameters, "seed": "7"}
    with RecordingWriter(
        other := new_path(), whole.scene, told, whole.schedule, written_as=whole.format
    ):
        pass
    with pytest.raises(InputError, match="seed='7', other than in"):
        merge_recordings([GOLDEN / "agv-3.mcap", other], out)
    records = [
        Record(each.topic, b'{"kind":"edges","round":3,"moves":[]}', 3, each.wall_ns + 1, 0)
        if each.kind == "edges" and each.round == 3
        else each
        for each in whole.records
    ]
    with pytest.raises(InputError, match="another edges of round 3 than in"):
        merge_recordings([GOLDEN / "agv-3.mcap", written(whole, records)], out)
    late = [
        Record(each.topic, each.data, each.round, each.wall_ns + 10**12, 0)
        for each in whole.records
    ]
    with pytest.raises(InputError, match="another edges of round 1 than in"):
        merge_recordings([written(whole, late), GOLDEN / "agv-3.mcap"], out)
    assert not out.exists()


@pytest.mark.parametrize(
    ("way", "why"),
    [
        ({}, "expected one of parts, rounds"),
        ({"parts": 2, "rounds": 1}, "expected one of parts, rounds"),
        ({"parts": 9999}, "cannot split 241 messages into 9999 parts"),
        ({"size": 1000}, "has no room for scene, parameters and message"),
    ],
)
def test_a_split_that_cannot_be_leaves_nothing(way: dict[str, Any], why: str) -> None:
    """One line says what was found and expected, and no part is left."""
    folder = new_path("")
    with pytest.raises(InputError, match=why):
        split_recording(golden("agv-3"), folder, **way)
    assert not folder.exists() or not list(folder.iterdir())


def test_no_recording_is_overwritten_and_no_part_is_left() -> None:
    """Where the third part exists already, it stays, and the first two are removed."""
    folder = new_path("")
    folder.mkdir()
    (folder / "agv-3-002.mcap").write_text("mine")
    with pytest.raises(InputError, match=r"agv-3-002.mcap: exists already"):
        split_recording(golden("agv-3"), folder, parts=4)
    assert [path.name for path in folder.iterdir()] == ["agv-3-002.mcap"]
    for write in (filter_recording, lambda log, out: merge_recordings([log], out)):
        with pytest.raises(InputError, match="exists already"):
            write(GOLDEN / "agv-3.mcap", folder / "agv-3-002.mcap")
        with pytest.raises(InputError, match="is the recording itself"):
            write(GOLDEN / "agv-3.mcap", GOLDEN / "agv-3.mcap")


def test_a_damaged_recording_is_not_cut() -> None:
    """It says so, and how to recover it, since its gaps would be taken for those of the cut."""
    cut = new_path()
    cut.write_bytes((GOLDEN / "agv-3.mcap").read_bytes()[:15000])
    for write in (filter_recording, lambda log, out: merge_recordings([log], out)):
        with pytest.raises(InputError, match="log recover"):
            write(cut, new_path())
    with pytest.raises(InputError, match="log recover"):
        split_recording(cut, new_path(""), parts=2)
