"""Exporting a recording: the form of the output file, and the tables, some rows at a time.

`Recording.moves` and `Recording.claims` define the rows. They are read repeatedly for the rounds
that are complete, so memory does not grow with the recording. Without rounds a commit may be
repeated at the very end, so moves and claims are read in one go. Sites are JSON in CSV and Parquet,
`[0,1]`, and lists in JSON. A message on any key stands beside its attachment, as `_text` writes it.
"""

import csv
import io
from base64 import b64encode
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import IO, Any, TypeAlias

import msgspec

from cubepath.coordinator.shortening.conversion import convert
from cubepath.coordinator.tools.exports import viewers
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.input_files import Source
from cubepath.protocol.core.output_files import same_file, written_whole
from cubepath.protocol.core.sites import site_text
from cubepath.protocol.recordings import cutting
from cubepath.protocol.recordings.description import LEFT_OUT
from cubepath.protocol.recordings.plain_messages import ATTACHMENT
from cubepath.protocol.recordings.recording import Recording, read_undamaged, rounds_in_turn
from cubepath.protocol.recordings.stored_messages import Record

Rows: TypeAlias = list[tuple[Any, ...]]
"""Rows of numbers and texts, in the order of the columns."""
SITES = ("at", "from", "to", "site")
"""Columns of sites, as JSON."""
DOCUMENTS = ("message", "attachment")
"""Columns of JSON documents; of messages on any keys also of other texts."""
TEXTS = (*SITES, *DOCUMENTS, "generator", "outcome", "kind", "sender")
"""Columns of texts; all others hold whole numbers of at most 64 bits."""
TABLES = ("moves", "claims", "messages", "rounds")

_MADE_OF = {
    ("moves", "lockstep"): ("report",),
    ("moves", "free"): ("commit", "commits", "turns"),
    ("claims", "lockstep"): ("claim",),
}
"""The kinds of messages that a table is made of."""
_WHY = (*LEFT_OUT, cutting.FILTERED, cutting.SPLIT)


ALL = cutting.MessageSelection()


@dataclass(frozen=True, slots=True)
class RecordingTable:
    """A table: the names of its columns, and its rows, some at a time."""

    columns: tuple[str, ...]
    batches: Iterator[Rows]


def table_of(
    recording: Recording,
    name: str = "moves",
    selection: cutting.MessageSelection = ALL,
    kinds: tuple[str, ...] = (),
) -> RecordingTable:
    """Return a table of a recording; its rows are read while they are asked for.

    `selection` has the range of rounds, and for messages the topics. `kinds` are for messages: the
    parts of batches are kinds too.

    InputError if there is no such table or kind, if topics are asked of another table than that of
    messages, if what the table is made of was left out of the recording, if levels are asked of
    messages that have none, and, while rows are read, where a message cannot be decoded.

    >>> found = table_of(read_recording("logs/golden/hex-5.mcap"), "rounds")
    >>> found.columns[:3], next(found.batches)[1][:3]
    (('round', 'messages', 'bytes'), (1, 22, 3599))
    """
    if name not in TABLES:
        near = did_you_mean(name, TABLES)
        raise InputError(f"unknown table {name!r}{near}, expected one of {', '.join(TABLES)}")
    if name != "messages" and (selection.topics or selection.exclude or kinds):
        raise InputError(f"table {name} has no topics and kinds, expected table messages")
    if kinds and not recording.of_keys:
        recording.messages(kinds)  # refuses unknown kinds
    if name in {"claims", "messages"}:
        check_levels(recording, selection)
    _check_there(recording, name)
    if name == "messages" and recording.of_keys:
        cutting.check_topics(recording, cutting.MessageSelection(kinds), of="kind")
        return RecordingTable(_ON_KEYS, _messages_on_keys(recording, selection, kinds))
    if name == "messages":
        return RecordingTable(_MESSAGES, _messages(recording, selection, kinds))
    if name == "rounds":
        return RecordingTable(_ROUNDS, _within(_rounds(recording), selection))
    columns = _columns(recording.moves if name == "moves" else recording.claims, recording)
    return RecordingTable(columns, _within(_derived(recording, name), selection))


def check_levels(recording: Recording, selection: cutting.MessageSelection) -> None:
    """Raise InputError if a range of levels is asked of messages that have wall clock times."""
    asked = not recording.of_keys and (selection.first is not None or selection.until is not None)
    if asked and recording.clock == "free" and recording.parameters.get("log_time") == "wall":
        raise InputError(
            f"{recording.path}: its log time is the wall clock, so only its moves have levels:"
            " expected no range"
        )


def _check_there(recording: Recording, name: str) -> None:
    """Raise InputError if a table would be empty for want of what was left out."""
    kinds = _MADE_OF.get((name, recording.clock))
    left = cutting.left_out(recording) or any(key in recording.parameters for key in LEFT_OUT)
    if kinds is None or not left or next(recording.of_kind(*kinds), None) is not None:
        return
    why = [f"{key} {value}" for key, value in recording.parameters.items() if key in _WHY]
    raise InputError(
        f"{recording.path}: no {' or '.join(kinds)} on record, expected some for table {name}"
        f" ({'; '.join(why)})"
    )


def _columns(made: Callable[[], Mapping[str, Any]], recording: Recording) -> tuple[str, ...]:
    """Return the columns of moves or claims, which those of no message at all have too."""
    return tuple(getattr(replace(recording, records=()), made.__name__)())


def _within(batches: Iterable[Rows], selection: cutting.MessageSelection) -> Iterator[Rows]:
    """Yield the rows of a range of rounds; the round is the first column."""
    first = 0 if selection.first is None else selection.first
    last = inf if selection.until is None else selection.until
    for rows in batches:
        yield [row for row in rows if first <= row[0] <= last]


def _derived(recording: Recording, name: str) -> Iterator[Rows]:
    for records in rounds_in_turn(recording):
        some = replace(recording, records=records)
        columns = some.moves() if name == "moves" else some.claims()
        lists = [
            [site_text(value) for value in values] if column in SITES else values.tolist()
            for column, values in columns.items()
        ]
        yield list(zip(*lists, strict=True))


_MESSAGES = ("round", "wall_ns", "sequence", "kind", "sender", "bytes", "message")


def _messages(
    recording: Recording, selection: cutting.MessageSelection, kinds: tuple[str, ...]
) -> Iterator[Rows]:
    for records, _ in recording.blocks():
        found: Iterable[Record] = filter(selection.keeps, records)
        if kinds:
            found = replace(recording, records=tuple(found)).of_kind(*kinds)
        yield [_message(recording, record) for record in found]


_ON_KEYS = (*_MESSAGES, "attachment")
_BASE64 = "base64:"


def _messages_on_keys(
    recording: Recording, selection: cutting.MessageSelection, kinds: tuple[str, ...]
) -> Iterator[Rows]:
    attached: str | None = None  # it stands right before its message
    for records, _ in recording.blocks():
        rows: Rows = []
        for record in filter(selection.keeps, records):
            if record.topic.endswith(ATTACHMENT):
                attached = _text(record.data)
                continue
            if not kinds or record.topic in kinds:
                rows.append((*_message(recording, record), attached))
            attached = None
        yield rows


def _text(data: bytes) -> str:
    """Return bytes as text, or in base64 what is no UTF-8, has a NUL or looks like base64."""
    try:
        found = data.decode()
    except UnicodeDecodeError:
        found = _BASE64
    if found.startswith(_BASE64) or "\0" in found:
        return _BASE64 + b64encode(data).decode()
    return found


def _message(recording: Recording, record: Record) -> tuple[Any, ...]:
    kind, sender = record.topic, ""
    if not recording.of_keys:
        kind, _, sender = record.topic.partition("/")
    data = record.data
    where = f"{recording.path}: message {record.sequence} ({record.topic})"
    if record.round >= 1 << 63 or record.wall_ns >= 1 << 63:
        raise InputError(f"{where}: a time of 64 bits, expected less than 2^63")
    try:
        text = _text(data) if recording.of_keys else data.decode()
    except UnicodeDecodeError as error:
        raise InputError(f"{where}: not UTF-8 text (byte {error.start})") from None
    return record.round, record.wall_ns, record.sequence, kind, sender, len(data), text


_ROUNDS = (
    "round",
    "messages",
    "bytes",
    "moves",
    "granted",
    "lost",
    "first_wall_ns",
    "last_wall_ns",
)


def _rounds(recording: Recording) -> Iterator[Rows]:
    """Yield a row for each round that has a message, and what its modules did."""
    if recording.clock == "free" and recording.parameters.get("log_time") == "wall":
        raise InputError(
            f"{recording.path}: its log time is the wall clock, so its messages have no levels"
        )
    for records in rounds_in_turn(recording):
        found: dict[int, list[int]] = {}
        for record in records:
            row = found.get(record.round)
            if row is None:
                row = [0, 0, 0, 0, 0, record.wall_ns, record.wall_ns]
                found[record.round] = row
            row[0] += 1
            row[1] += len(record.data)
            row[5] = min(row[5], record.wall_ns)
            row[6] = max(row[6], record.wall_ns)
        some = replace(recording, records=records)
        moves = some.moves()
        for number, wall_ns in zip(moves["round"].tolist(), moves["wall_ns"].tolist(), strict=True):
            # Without rounds a commit may be reported after a higher level was reached.
            found.setdefault(number, [0, 0, 0, 0, 0, wall_ns, wall_ns])[2] += 1
        claims = some.claims()
        for number, outcome in zip(claims["round"].tolist(), claims["outcome"], strict=True):
            if outcome:
                found[number][3 if outcome == "granted" else 4] += 1
        yield [(number, *found[number]) for number in sorted(found)]


Write = Callable[[IO[bytes], RecordingTable, Mapping[str, str]], int]
"""Writes a table with the parameters of its recording, as far as the form has room for them;
returns the number of rows."""


def write_csv(stream: IO[bytes], table: RecordingTable, _parameters: Mapping[str, str]) -> int:
    """Write a table as CSV: a line of names, UTF-8, and lines end with a line feed."""
    text = io.TextIOWrapper(stream, "utf-8", newline="", write_through=True)
    count = 0
    try:
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(table.columns)
        for rows in table.batches:
            writer.writerows(rows)
            count += len(rows)
    finally:
        text.detach()
    return count


def write_parquet(stream: IO[bytes], table: RecordingTable, parameters: Mapping[str, str]) -> int:
    """Write a table as Parquet; the parameters are the metadata of its schema.

    InputError if pyarrow is missing.
    """
    try:
        import pyarrow as pa  # noqa: PLC0415 - an extra
        import pyarrow.parquet as pq  # noqa: PLC0415 - an extra
    except ImportError:
        raise InputError(
            "Parquet takes the library pyarrow: pip install 'cubepath[experiments]'"
        ) from None
    kinds = [pa.string() if name in TEXTS else pa.int64() for name in table.columns]
    schema = pa.schema(list(zip(table.columns, kinds, strict=True)), metadata=dict(parameters))
    count = 0
    with pq.ParquetWriter(stream, schema, compression="zstd") as writer:
        for rows in _grouped(table.batches):
            columns = zip(*rows, strict=True) if rows else ((),) * len(kinds)
            arrays = [pa.array(each, kind) for each, kind in zip(columns, kinds, strict=True)]
            writer.write_table(pa.table(arrays, schema=schema))
            count += len(rows)
    return count


_GROUP = 1 << 16
"""Rows of a group of Parquet, in which columns stand together."""


def _grouped(batches: Iterator[list[Any]]) -> Iterator[list[Any]]:
    pending: list[Any] = []
    for rows in batches:
        pending += rows
        if len(pending) >= _GROUP:
            yield pending
            pending = []
    yield pending


def write_json(stream: IO[bytes], table: RecordingTable, _parameters: Mapping[str, str]) -> int:
    """Write a table as one JSON list of objects, a line each."""
    count = 0
    for count, line in enumerate(_lines(table), 1):
        stream.write((b"[" if count == 1 else b",\n") + line)
    stream.write(b"]\n" if count else b"[]\n")
    return count


def write_jsonl(stream: IO[bytes], table: RecordingTable, _parameters: Mapping[str, str]) -> int:
    """Write a table as JSON Lines: an object a line."""
    count = 0
    for line in _lines(table):
        stream.write(line + b"\n")
        count += 1
    return count


def _lines(table: RecordingTable) -> Iterator[bytes]:
    encode, decode = msgspec.json.Encoder().encode, msgspec.json.decode
    names = table.columns
    nested = [number for number, name in enumerate(names) if name in (*SITES, *DOCUMENTS)]
    on_keys = names == _ON_KEYS
    for rows in table.batches:
        for row in rows:
            values = list(row)
            for number in nested:
                if on_keys:
                    values[number] = _nested(values[number])
                    continue
                try:
                    values[number] = decode(values[number])
                except msgspec.DecodeError as error:
                    where = f"message {row[names.index('sequence')]}"
                    raise InputError(f"{where}: {error}") from None
            yield encode(dict(zip(names, values, strict=True)))


def _nested(text: str | None) -> Any:
    """Return what a text says if it is JSON; a string stands for itself, as what is none."""
    try:
        found = None if text is None else msgspec.json.decode(text)
    except (msgspec.DecodeError, RecursionError):
        return text
    return text if isinstance(found, str) else found


WRITERS: Mapping[str, Write] = {
    "csv": write_csv,
    "parquet": write_parquet,
    "json": write_json,
    "jsonl": write_jsonl,
}
"""The forms of tables by name, which are their suffixes too."""


MOVES = "moves"
VIEWERS = ("mcap", "rrd")
"""The forms for viewers, which have a time line and no table."""
FORMS = (*WRITERS, *VIEWERS, MOVES)
"""The forms in which a recording is written, by name."""


@dataclass(frozen=True, slots=True)
class ExportResult:
    """What was written, in which form, and how many of them.

    That is "moves", "claims", "messages" or "rounds".

    >>> found = export("logs/golden/hex-5.mcap", "rounds.jsonl", table="rounds")
    >>> found.what, found.form, found.count
    ('rounds', 'jsonl', 30)
    """

    what: str
    form: str
    count: int


def form_of(out: Path, form: str | None) -> str:
    """Return the form that is asked for, or that the suffix of a file stands for.

    InputError if there is no such form.
    """
    found = out.suffix.removeprefix(".").lower() if form is None else form
    if found in FORMS and (form is not None or found != MOVES):
        return found
    if form is not None:
        near = did_you_mean(form, FORMS)
        raise InputError(f"unknown form {form!r}{near}, expected one of {', '.join(FORMS)}")
    suffix = f"the suffix {out.suffix}" if out.suffix else "no suffix"
    expected = ", ".join(f".{each}" for each in FORMS if each != MOVES)
    raise InputError(f"{out}: found {suffix}, expected one of {expected}, or the form by name")


def export(
    source: Recording | Source,
    out: Path | str,
    *,
    form: str | None = None,
    table: str | None = None,
    first: int | None = None,
    until: int | None = None,
    topics: Sequence[str] = (),
    exclude: Sequence[str] = (),
    kinds: Sequence[str] = (),
    log_time: viewers.LogTime | None = None,
    round_seconds: float | None = None,
    foxglove: bool = False,
) -> ExportResult:
    """Write a table of a recording, or a file for viewers; return what was written.

    `form` is "csv", "parquet", "json" (one list), "jsonl" (an object a line), or "moves": a moves
    file, as `convert` writes it. By default it is the suffix of `out`. `table` is "moves" (the
    default), "claims", "messages" (the default on any keys) or "rounds"; docs/viewers.md has their
    columns, units and types. `first` and `until` are the first and the last round that is taken;
    `topics`, `exclude` (patterns) and `kinds` are for messages. Rows are read and written some at a
    time.

    Two forms more are for viewers, which have a time line: "mcap" holds the messages of the
    recording, and with `foxglove` the robot as well, as Foxglove's protobuf messages; "rrd" holds
    the robot as entities of rerun. Their log times are "round" (or "level"), where each lasts
    `round_seconds` (by default 1), which is the default, or "wall".

    InputError if the recording is damaged, a message cannot be decoded, a name is unknown, a
    library is missing, or `out` cannot be written; then nothing is left of it.

    >>> export("logs/golden/hex-5.mcap", "claims.csv", table="claims", until=3).count
    3
    >>> print(Path("claims.csv").read_text().splitlines()[1][:40])
    1,0,"[0,0]",pivot-2-right,"[1,-1]",grant
    """
    out = Path(out)
    recording = read_undamaged(source)
    if same_file(out, recording.path):
        raise InputError(f"{out}: is the recording itself, expected another file to write to")
    named = form_of(out, form)
    if table is None:
        table = "messages" if recording.of_keys else "moves"
    selection = cutting.MessageSelection(tuple(topics), tuple(exclude), first, until)
    if recording.of_keys and (table != "messages" or named in (*VIEWERS, "moves")):
        raise InputError(
            f"{recording.path}: messages on any keys, which Foxglove reads as they are: expected"
            " the table messages, or 'cubepath log filter' for a part"
        )
    cutting.check_topics(recording, selection)
    if named in VIEWERS:
        times = viewers.times_of(recording, log_time, round_seconds)
        of_messages = bool(selection.topics or selection.exclude)
        if table != "moves" or kinds or (of_messages and named == "rrd"):
            raise InputError(
                f"{out}: a file for viewers has no tables and no kinds, expected a choice by rounds"
                + ("" if named == "rrd" else " and topics")
            )
        return _viewed(recording, out, named, selection, times, in_space=foxglove)
    if log_time is not None or round_seconds is not None or foxglove:
        raise InputError(
            f"{out}: {named} has no time line and no space, expected .mcap or .rrd for them"
        )
    if named == MOVES:
        if table != "moves" or kinds or selection != ALL:
            raise InputError("moves: a moves file has all moves, expected no choice among them")
        return ExportResult(MOVES, MOVES, convert(recording.path, out).count)
    found = table_of(recording, table, selection, tuple(kinds))
    with written_whole(out) as stream:
        try:
            count = WRITERS[named](stream, found, recording.parameters)
        except InputError as error:
            raise _located(recording, error) from None
    return ExportResult(table, named, count)


def _viewed(
    recording: Recording,
    out: Path,
    form: str,
    selection: cutting.MessageSelection,
    times: viewers.ExportTimes,
    *,
    in_space: bool,
) -> ExportResult:
    """Write a file for viewers."""
    if form != "rrd":
        check_levels(recording, selection)
    with written_whole(out) as stream:
        if form == "rrd":
            rounds = viewers.write_rerun(stream, recording, times=times, selection=selection)
            return ExportResult("rounds", form, rounds)
        count = viewers.write_viewer_mcap(
            stream, recording, times=times, selection=selection, in_space=in_space
        )
    return ExportResult("messages", form, count)


def _located(recording: Recording, error: InputError) -> InputError:
    """Return an error that names the recording, if it does not yet."""
    where = f"{recording.path}: "
    known = str(error).startswith(where) or not str(error).startswith("message ")
    return error if known else InputError(f"{where}{error}")
