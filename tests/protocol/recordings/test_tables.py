"""Recordings as messages one after another, as arrays and as data frames."""

import sys
import tracemalloc
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, strategies as st

from cubepath.agents.environments.rollouts import play
from cubepath.agents.rules.registry import rule_named
from cubepath.coordinator.runs.gathering import gathered
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.salvaging import messages_in
from cubepath.protocol.recordings.stored_messages import kinds_of
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.wire.free_messages import decode_free
from cubepath.protocol.wire.messages import Presence, Report, decode, encode
from processes.command_line import GOLDEN
from samples.free_runs import free_recorded
from samples.recordings import new_path, recorded, with_records

CROWD = "agv:graph=C6,n=4"
PATHS = sorted(GOLDEN.glob("*.mcap"))


def golden(name: str) -> Recording:
    """Return one of the recordings that are kept."""
    return read_recording(GOLDEN / f"{name}.mcap")


def rows(columns: Any, *names: str) -> list[tuple[Any, ...]]:
    """Return rows of a table, of some columns."""
    return list(zip(*(columns[name].tolist() for name in names), strict=True))


# --- Messages ----------------------------------------------------------------------------------


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_all_messages_come_as_they_were_recorded(path: Path) -> None:
    """Under either clock and in every format, with their times and in their order."""
    recording = read_recording(path)
    read = decode_free if recording.clock == "free" else decode
    found = list(recording.messages())
    assert len(found) == len(recording.records) > 0
    for logged, record in zip(found, recording.records, strict=True):
        assert logged.message == read(record.data)
        assert logged[1:] == (record.round, record.wall_ns, record.topic, record.sequence)


@given(
    st.sampled_from(["hex-5", "agv-6", "hex-free-5"]),
    st.data(),
    st.integers(-3, 40),
    st.integers(-3, 40),
    st.sampled_from([1, 2, -1, -3]),
)
def test_some_messages_are_those_among_all(
    name: str, data: st.DataObject, begin: int, end: int, step: int
) -> None:
    """Of any kinds, parts of batches among them, and in any range of rounds."""
    recording = golden(name)
    kinds = data.draw(st.sets(st.sampled_from(sorted(kinds_of(recording.clock)))))
    rounds = range(begin, end, step)
    expected = [
        (record.kind, record.data, record.round, record.sequence)
        for record in recording.of_kind(*kinds)
        if record.round in rounds
    ]
    found = [
        (each.message.__struct_config__.tag, encode(each.message), each.round, each.sequence)
        for each in recording.messages(kinds, rounds)
    ]
    assert found == expected


def test_one_kind_and_one_round_need_no_collection() -> None:
    """A name and a number stand for themselves."""
    recording = recorded(CROWD, rounds=8)
    found = list(recording.messages("report", 3))
    assert [each.message.module for each in found] == [0, 1, 2, 3]
    assert {each.round for each in found} == {3}


def test_what_is_no_kind_is_refused_at_once() -> None:
    """Before anything is read; the kinds of runs without rounds are others."""
    for recording, kind, why in (
        (golden("hex-5"), "clam", r"unknown kind 'clam' \(did you mean 'claim'\?\), expected"),
        (
            golden("hex-free-5"),
            "claim",
            "unknown kind 'claim', expected some of attempt, certificate, commit",
        ),
    ):
        with pytest.raises(InputError, match=why):
            recording.messages(kind)


def long_recording(count: int) -> Path:
    """Return the path of a recording of that many messages, some to a round."""
    path = new_path()
    with RecordingWriter(path, golden("hex-5").scene, {}) as writer:
        for number in range(count):
            said = Presence(number // 100, number, f"a long way to {number}" * 40)
            writer.write("presence/module_0", encode(said), round_number=number // 100, wall_ns=0)
    return path


def test_a_chunk_is_in_memory_and_no_more() -> None:
    """To go through all messages takes a fraction of the memory to hold them."""
    recording = read_recording(long_recording(6_000))
    peaks = []
    ways: list[Callable[[Iterable[object]], int]] = [
        lambda found: sum(1 for _ in found),
        lambda found: len(list(found)),
    ]
    for through in ways:
        tracemalloc.start()
        assert through(recording.messages("presence")) == 6_000
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[0] < peaks[1] / 4


def test_chunks_without_the_rounds_are_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a range of rounds those chunks alone are unpacked that hold some."""
    recording = read_recording(long_recording(6_000))
    unpacked: list[Any] = []

    def counting(stored: Any, block: Any) -> Any:
        unpacked.append(block)
        return messages_in(stored, block)

    monkeypatch.setattr("cubepath.protocol.recordings.stored_messages.messages_in", counting)
    assert sum(1 for _ in recording.messages()) == 6_000
    whole, unpacked[:] = len(unpacked), []
    assert sum(1 for _ in recording.messages(rounds=range(30, 34))) == 400
    assert 0 < len(unpacked) <= 4 < whole


# --- Moves and claims --------------------------------------------------------------------------

RECORDINGS: dict[str, Callable[[], Recording]] = {
    "lockstep": lambda: recorded(CROWD, seed=1, rounds=12),
    "taking others along": lambda: recorded("arm:n=4", rounds=8),
    "golden": lambda: golden("agv-3"),
    "free": lambda: free_recorded("agv:graph=grid3x3,n=3"),
    "free, golden": lambda: golden("hex-free-5"),
}


@pytest.mark.parametrize("name", RECORDINGS)
def test_moves_are_those_that_are_gathered(name: str) -> None:
    """In the same order, and each leads from a site to a site by one of its moves there."""
    recording = RECORDINGS[name]()
    moves = recording.moves()
    again = gathered(recording)
    expected = [
        (step.round, move.module, move.generator, site_from_json(move.at))
        for step in again.steps
        for move in step.executed
    ]
    assert rows(moves, "round", "module", "generator", "at") == expected != []
    system = recording.scene.system
    for generator, at, before, after in rows(moves, "generator", "at", "from", "to"):
        made = [each for each in system.moves(before) if each is not None]
        assert (generator, at, after) in [(each.generator, each.at, each.target) for each in made]
    last = dict(zip(moves["module"].tolist(), moves["to"].tolist(), strict=True))
    if name != "taking others along":
        assert all(again.sites[module] == site for module, site in last.items())


def test_claims_have_the_outcomes_of_the_run() -> None:
    """The same were granted and lost when the run was played without messages."""
    recording = recorded(CROWD, seed=1, rounds=12)
    scene = recording.scene
    played = play(scene, rule_named("random", scene.system), seed=1, max_rounds=12)
    claims = recording.claims()
    expected = [
        (each.number, module, outcome)
        for each in played.rounds
        for module, outcome in sorted(
            [(module, "granted") for module in each.moves]
            + [(module, "lost") for module in each.lost]
        )
    ]
    assert rows(claims, "round", "module", "outcome") == expected
    assert set(claims["outcome"]) == {"granted", "lost"}


@pytest.mark.parametrize("name", RECORDINGS)
def test_claims_that_are_granted_are_the_moves(name: str) -> None:
    """Each move was claimed by its mover where it stood, and no other claim was granted."""
    recording = RECORDINGS[name]()
    free = recording.clock == "free"
    who = ("module", "generator", "at") if free else ("round", "module", "generator", "at")
    claims, moves = recording.claims(), recording.moves()
    granted = {name: column[claims["outcome"] == "granted"] for name, column in claims.items()}
    assert Counter(rows(granted, *who, "site")) == Counter(rows(moves, *who, "from"))
    assert {"granted"} <= set(claims["outcome"]) <= {"granted", "lost", ""}


def test_columns_have_their_types() -> None:
    """Numbers are int64, the rest are objects; an empty table has them too."""
    for name, make in RECORDINGS.items():
        recording = make()
        for some in (recording, with_records(recording, [])):
            for columns in (some.moves(), some.claims()):
                lengths = {len(column) for column in columns.values()}
                assert len(lengths) == 1, name
                texts = {key for key, column in columns.items() if column.dtype == object}
                assert texts <= {"generator", "at", "from", "to", "site", "outcome"}
                assert {columns[key].dtype for key in columns.keys() - texts} == {
                    np.dtype(np.int64)
                }


def test_of_a_damaged_recording_there_is_what_can_be_read(tmp_path: Path) -> None:
    """The first moves of a file that was cut; what is not on record has no outcome."""
    whole = golden("agv-6")
    data = (GOLDEN / "agv-6.mcap").read_bytes()
    path = tmp_path / "cut.mcap"
    seen = set()
    for share in range(30, 100, 7):
        path.write_bytes(data[: len(data) * share // 100])
        cut = read_recording(path)
        assert cut.problems
        names = ("round", "module", "generator", "at", "from", "to")
        found, expected = rows(cut.moves(), *names), rows(whole.moves(), *names)
        assert set(found) <= set(expected)
        seen.add(len(found))
        claims = rows(cut.claims(), "round", "module", "outcome")
        outcomes = {
            (number, who): out
            for number, who, out in rows(whole.claims(), "round", "module", "outcome")
        }
        assert all(out in ("", outcomes[number, who]) for number, who, out in claims)
    assert len(seen) > 3


def test_a_message_that_is_none_is_named() -> None:
    """By its number and topic, in one line; so is a site that is none."""
    recording = recorded(CROWD, rounds=3)
    records = list(recording.records)
    place = next(
        number
        for number, each in enumerate(records)
        if each.kind == "reports" and b'"granted"' in each.data
    )
    bad = msgspec.structs.replace  # structs of messages are frozen
    batch: Any = decode(records[place].data)
    odd = [
        bad(part, site={}, move=msgspec.convert({"generator": "a", "at": 1}, type(part.move)))
        if isinstance(part, Report) and part.move is not None
        else part
        for part in batch.parts
    ]
    for data, why in (
        (b"{}", "not a cubepath message"),
        (encode(bad(batch, parts=odd)), "a site is a JSON number, string or list, found {}"),
    ):
        changed = [*records]
        changed[place] = replace(records[place], data=data)
        broken = with_records(recording, changed)
        with pytest.raises(InputError) as error:
            broken.moves()
        (line,) = str(error.value).splitlines()
        topic = records[place].topic
        assert line.startswith(f"{recording.path}: message {place} ({topic}): ")
        assert why in line


# --- Data frames -------------------------------------------------------------------------------


@pytest.mark.slow
def test_frames_have_the_columns() -> None:
    """Of moves and claims those of the arrays, of messages what the counts say."""
    recording = golden("hex-5")
    for table, columns in (("moves", recording.moves()), ("claims", recording.claims())):
        frame = recording.frame(table)
        assert list(frame.columns) == list(columns)
        assert all(frame[name].tolist() == columns[name].tolist() for name in columns)
    messages = recording.frame("messages")
    counts = recording.counts()
    assert len(messages) == counts.messages
    by_kind = messages.groupby("kind")["bytes"].agg(["size", "sum"])
    assert {name: (kind.messages, kind.bytes) for name, kind in counts.kinds.items()} == {
        name: tuple(row)
        for name, row in zip(by_kind.index, by_kind.to_numpy().tolist(), strict=True)
    }


def test_there_are_three_tables() -> None:
    """Any other is refused in a line."""
    with pytest.raises(InputError) as error:
        golden("hex-5").frame("move")
    assert str(error.value) == (
        "unknown table 'move' (did you mean 'moves'?), expected one of moves, claims, messages"
    )


def test_without_pandas_there_are_no_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    """One line says what to install."""
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError) as error:
        golden("hex-5").frame()
    assert str(error.value) == (
        "data frames take the library pandas: pip install 'cubepath[experiments]'"
    )


def test_a_time_that_does_not_fit_is_named() -> None:
    """Recordings of others may have log times of 64 bits."""
    path = new_path()
    with RecordingWriter(path, golden("hex-5").scene, {}) as writer:
        writer.write("go/a", b"{}", round_number=2**64 - 1, wall_ns=0)
    with pytest.raises(InputError, match="round 18446744073709551615: expected less than 2"):
        read_recording(path).frame("messages")
