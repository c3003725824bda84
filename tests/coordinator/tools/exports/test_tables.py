"""Tables of recordings: whatever the form, read back they are what the recording says."""

import csv
import json
import sys
from dataclasses import replace
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any

import msgspec
import pyarrow.parquet as pq
import pytest
from hypothesis import given, strategies as st

from cubepath.coordinator.tools.exports.exporting import export, table_of
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.recordings.cutting import MessageSelection, filter_recording
from cubepath.protocol.recordings.recording import read_recording
from cubepath.protocol.recordings.writing import RecordingWriter
from processes.command_line import GOLDEN
from samples.recordings import new_path

PATHS = sorted(GOLDEN.glob("*.mcap"))
FORMS = ("csv", "parquet", "json", "jsonl")
SITES = ("at", "from", "to", "site")


def read_back(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a table, by libraries of others, with sites as sites."""
    match path.suffix:
        case ".csv":
            with path.open(newline="") as file:
                rows: list[dict[str, Any]] = list(csv.DictReader(file))
        case ".parquet":
            rows = pq.read_table(path).to_pylist()
        case ".json":
            rows = json.loads(path.read_text())
        case _:
            rows = [json.loads(line) for line in path.read_text().splitlines()]
    return [{name: read(name, value) for name, value in row.items()} for row in rows]


def read(name: str, value: Any) -> Any:
    """Return a value of a column."""
    if name in (*SITES, "message") and isinstance(value, str) and value[:1] in '[{"0123456789-':
        value = json.loads(value)
    if name in SITES:
        return site_from_json(value)
    if isinstance(value, str) and name not in ("generator", "outcome", "kind", "sender"):
        return int(value)
    return value


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_moves_and_claims_read_back_are_those_of_the_recording(path: Path, form: str) -> None:
    """Row by row and column by column, in the same order."""
    recording = read_recording(path)
    for table, columns in (("moves", recording.moves()), ("claims", recording.claims())):
        out = new_path(f".{form}")
        told = export(recording, out, table=table)
        expected = [
            dict(zip(columns, row, strict=True))
            for row in zip(*(values.tolist() for values in columns.values()), strict=True)
        ]
        assert read_back(out) == expected
        assert (told.what, told.form, told.count) == (table, form, len(expected))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("path", [PATHS[0], GOLDEN / "hex-free-5.mcap"], ids=lambda path: path.stem)
def test_messages_read_back_are_those_of_the_recording(path: Path, form: str) -> None:
    """Each with its times, its sender, and all of its fields."""
    out = new_path(f".{form}")
    export(path, out, table="messages")
    assert [tuple(row.values()) for row in read_back(out)] == [
        (
            *(record.round, record.wall_ns, record.sequence, *record.topic.split("/")),
            len(record.data),
            json.loads(record.data),
        )
        for record in read_recording(path).records
    ]


@pytest.mark.thorough
@given(
    st.sampled_from(PATHS),
    st.sampled_from(["moves", "claims", "rounds", "messages"]),
    st.integers(0, 30),
    st.integers(0, 30),
)
def test_a_range_of_rounds_takes_their_rows(path: Path, name: str, first: int, more: int) -> None:
    """Both ends are included, whatever table is asked for."""
    recording = read_recording(path)
    wanted = MessageSelection(first=first, until=first + more)
    some = table_of(recording, name, wanted)
    every = table_of(recording, name)
    assert some.columns == every.columns
    rows = [row for batch in every.batches for row in batch]
    found = [row for batch in some.batches for row in batch]
    assert found == [row for row in rows if first <= row[0] <= first + more]


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_rounds_add_up_to_the_recording(path: Path) -> None:
    """Messages, bytes, moves and claims, each counted in one round; and the times of each."""
    recording = read_recording(path)
    table = table_of(recording, "rounds")
    rows = [dict(zip(table.columns, row, strict=True)) for batch in table.batches for row in batch]
    assert [row["round"] for row in rows] == sorted({row["round"] for row in rows})
    claims = recording.claims()["outcome"].tolist()
    assert [sum(row[name] for row in rows) for name in table.columns[1:6]] == [
        len(recording.records),
        sum(len(record.data) for record in recording.records),
        len(recording.moves()["round"]),
        claims.count("granted"),
        claims.count("lost"),
    ]
    for row in rows:
        walls = [
            each.wall_ns for each in recording.written(rounds=range(row["round"], row["round"] + 1))
        ]
        assert (row["first_wall_ns"], row["last_wall_ns"]) == (min(walls), max(walls))


@pytest.mark.parametrize("kinds", [("claim",), ("verdict", "report"), ("ready",)])
def test_parts_of_batches_are_kinds_of_messages(kinds: tuple[str, ...]) -> None:
    """What is asked for by kind is what the recording gives by kind."""
    recording = read_recording(GOLDEN / "agv-6.mcap")
    table = table_of(recording, "messages", kinds=kinds)
    found = [json.loads(row[-1]) for batch in table.batches for row in batch]
    said = [each.message for each in recording.messages(kinds)]
    assert found == msgspec.json.decode(msgspec.json.encode(said))


@cache
def chunked(name: str, size: int) -> Path:
    """Return a recording with chunks of so many messages."""
    whole = read_recording(GOLDEN / f"{name}.mcap")
    out = new_path()
    with RecordingWriter(
        out, whole.scene, whole.parameters, whole.schedule, written_as=whole.format
    ) as writer:
        for number, each in enumerate(whole.records):
            if number % size == 0:
                writer.flush()
            writer.write(each.topic, each.data, round_number=each.round, wall_ns=each.wall_ns)
    return out


@pytest.mark.parametrize("size", [1, 7, 50])
@pytest.mark.parametrize("name", ["moves", "claims", "rounds"])
def test_rows_come_while_the_file_is_read(name: str, size: int) -> None:
    """However the file is cut into chunks the rows are the same, and come some at a time."""
    whole = table_of(read_recording(GOLDEN / "agv-6.mcap"), name)
    recording = read_recording(chunked("agv-6", size))
    batches = [batch for batch in table_of(recording, name).batches if batch]
    assert list(chain(*batches)) == list(chain(*whole.batches))
    assert len(batches) > 5


def test_parameters_go_with_parquet() -> None:
    """They are the metadata of the schema."""
    export(GOLDEN / "hex-5.mcap", out := new_path(".parquet"))
    told = pq.read_schema(out).metadata
    assert told[b"rule"] == b"chain"
    assert told[b"system"] == b"hex:n=5"


def test_a_recording_without_messages_has_empty_tables() -> None:
    """All columns, and no row, in every form."""
    like = read_recording(GOLDEN / "hex-5.mcap")
    with RecordingWriter(log := new_path(), like.scene, like.parameters):
        pass
    for form in FORMS:
        assert export(log, out := new_path(f".{form}"), table="claims").count == 0
        assert read_back(out) == []
    assert pq.read_schema(new_parquet(log)).names == list(like.claims())


def new_parquet(log: Path) -> Path:
    """Return the claims of a recording as Parquet."""
    export(log, out := new_path(".parquet"), table="claims")
    return out


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"table": "mvoes"}, r"unknown table 'mvoes' \(did you mean 'moves'\?\)"),
        ({"form": "xlsx"}, "unknown form 'xlsx', expected one of csv, parquet"),
        ({"table": "messages", "kinds": ["clam"]}, r"unknown kind 'clam' \(did you mean 'claim'"),
        ({"form": "moves", "first": 3}, "a moves file has all moves"),
        ({"table": "claims", "form": "moves"}, "a moves file has all moves"),
    ],
)
def test_what_cannot_be_exported_is_told(options: dict[str, Any], why: str) -> None:
    """In one line, and nothing is written."""
    out = new_path("").parent / "out.csv"
    with pytest.raises(InputError, match=why):
        export(GOLDEN / "hex-5.mcap", out, **options)
    assert not out.exists()


def test_what_is_no_json_is_named_with_its_file() -> None:
    """A message that nobody can decode is an error of the recording, and nothing is left."""
    like = read_recording(GOLDEN / "hex-5.mcap")
    log = new_path()
    with RecordingWriter(log, like.scene, like.parameters) as writer:
        writer.write("go/coordinator", b"{", round_number=1, wall_ns=0)
    out = new_path(".jsonl")
    with pytest.raises(InputError, match=rf"{log}: message 0: "):
        export(log, out, table="messages")
    assert not out.exists()


def test_levels_are_not_made_of_the_wall_clock() -> None:
    """A run without rounds whose log time is the wall clock has no table of rounds."""
    recording = read_recording(GOLDEN / "hex-free-5.mcap")
    walled = replace(recording, parameters={**recording.parameters, "log_time": "wall"})
    with pytest.raises(InputError, match="its log time is the wall clock"):
        list(table_of(walled, "rounds").batches)
    for table in ("claims", "messages"):
        assert any(table_of(walled, table).batches)
        with pytest.raises(InputError, match="so only its moves have levels: expected no range"):
            table_of(walled, table, MessageSelection(until=3))
    assert any(table_of(walled, "moves", MessageSelection(until=3)).batches)


@pytest.mark.parametrize(
    ("table", "kind", "batch"), [("moves", "report", "reports"), ("claims", "claim", "bundle")]
)
def test_what_was_left_out_makes_no_empty_table(table: str, kind: str, batch: str) -> None:
    """That there is nothing on record is told, and is not taken for that nothing happened."""
    filter_recording(GOLDEN / "hex-5.mcap", path := new_path(), exclude=[batch])
    with pytest.raises(InputError, match=rf"no {kind} on record, .* \(filtered without {batch}\)"):
        export(path, new_path(".csv"), table=table)


def test_parquet_says_what_it_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without pyarrow there is one line with how to install it."""
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"pip install 'cubepath\[experiments\]'"):
        export(GOLDEN / "hex-5.mcap", new_path(".parquet"))
