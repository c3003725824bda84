"""Exporting a recording: which form a file has, and what is written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cubepath.coordinator.shortening.conversion import convert
from cubepath.coordinator.tools.exports.rerun_file import write_rerun
from cubepath.coordinator.tools.exports.rows import WRITERS, RowSelection, check_levels, table_of
from cubepath.coordinator.tools.exports.viewer_mcap import (
    ExportTimes,
    LogTime,
    times_of,
    write_viewer_mcap,
)
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.input_files import Source
from cubepath.protocol.core.output_files import same_file, written_whole
from cubepath.protocol.recordings.cutting import MessageSelection, check_topics
from cubepath.protocol.recordings.recording import Recording, read_undamaged

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
    table: str = "moves",
    first: int | None = None,
    until: int | None = None,
    topics: Sequence[str] = (),
    exclude: Sequence[str] = (),
    kinds: Sequence[str] = (),
    log_time: LogTime | None = None,
    round_seconds: float | None = None,
    foxglove: bool = False,
) -> ExportResult:
    """Write a table of a recording, or a file for viewers; return what was written.

    `form` is "csv", "parquet", "json" (one list), "jsonl" (an object a line), or "moves": a moves
    file, as `convert` writes it. By default it is the suffix of `out`. `table` is "moves",
    "claims", "messages" or "rounds"; docs/recordings.md has their columns, units and types. `first`
    and `until` are the first and the last round that is taken; `topics`, `exclude` (patterns) and
    `kinds` are for messages. Rows are read and written some at a time.

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
    wanted = RowSelection(
        table, MessageSelection(tuple(topics), tuple(exclude), first, until), tuple(kinds)
    )
    check_topics(recording, wanted.selection)
    if named in VIEWERS:
        times = times_of(recording, log_time, round_seconds)
        return _viewed(recording, out, named, wanted, times, in_space=foxglove)
    if log_time is not None or round_seconds is not None or foxglove:
        raise InputError(
            f"{out}: {named} has no time line and no space, expected .mcap or .rrd for them"
        )
    if named == MOVES:
        if wanted != RowSelection():
            raise InputError("moves: a moves file has all moves, expected no choice among them")
        return ExportResult(MOVES, MOVES, convert(recording.path, out).count)
    found = table_of(recording, wanted)
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
    wanted: RowSelection,
    times: ExportTimes,
    *,
    in_space: bool,
) -> ExportResult:
    """Write a file for viewers."""
    selection = wanted.selection
    of_messages = bool(selection.topics or selection.exclude)
    if wanted.table != RowSelection().table or wanted.kinds or (of_messages and form == "rrd"):
        raise InputError(
            f"{out}: a file for viewers has no tables and no kinds, expected a choice by rounds"
            + ("" if form == "rrd" else " and topics")
        )
    if form != "rrd":
        check_levels(recording, selection)
    with written_whole(out) as stream:
        if form == "rrd":
            rounds = write_rerun(stream, recording, times=times, selection=selection)
            return ExportResult("rounds", form, rounds)
        count = write_viewer_mcap(
            stream, recording, times=times, selection=selection, in_space=in_space
        )
    return ExportResult("messages", form, count)


def _located(recording: Recording, error: InputError) -> InputError:
    """Return an error that names the recording, if it does not yet."""
    where = f"{recording.path}: "
    known = str(error).startswith(where) or not str(error).startswith("message ")
    return error if known else InputError(f"{where}{error}")
