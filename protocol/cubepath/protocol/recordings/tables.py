"""Recordings as arrays and data frames: moves, claims and messages, one row each.

`Recording` documents the columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.recordings.stored_messages import LoggedMessage, messages_of
from cubepath.protocol.wire.free_messages import Attempt, Commit, CommitLog, Decision
from cubepath.protocol.wire.messages import Claim, Report, Verdict

if TYPE_CHECKING:
    import pandas as pd

    from cubepath.protocol.recordings.recording import Recording

Columns: TypeAlias = dict[str, NDArray[Any]]
"""A table: arrays of one length by the names of its columns."""

_encode = msgspec.json.Encoder().encode
_TEXTS = ("generator", "at", "from", "to", "site", "outcome", "kind", "sender")
"""Columns of objects; all others are int64."""
_TABLES = ("moves", "claims", "messages")


class _Rows:
    """Rows with a key each, of which the first counts, as columns."""

    def __init__(self, *names: str) -> None:
        self._names = names
        self._rows: dict[tuple[Any, ...], tuple[Any, ...]] = {}

    def add(self, key: tuple[Any, ...], *row: Any) -> None:
        self._rows.setdefault(key, row)

    def columns(self) -> Columns:
        """Return the rows in the order of their keys."""
        rows = [self._rows[key] for key in sorted(self._rows)]
        values: Iterable[tuple[Any, ...]] = (
            zip(*rows, strict=True) if rows else ((),) * len(self._names)
        )
        return {
            name: _column(name, column) for name, column in zip(self._names, values, strict=True)
        }


def _column(name: str, values: tuple[Any, ...]) -> NDArray[Any]:
    if name not in _TEXTS:
        try:
            return np.array(values, np.int64)
        except OverflowError:
            raise InputError(f"{name} {max(values)}: expected less than 2^63") from None
    found = np.empty(len(values), object)  # sites are tuples, which numpy would spread out
    found[:] = values
    return found


def moves_of(recording: Recording) -> Columns:
    """Return the moves of a run; `Recording.moves` documents it."""
    rows = _Rows("round", "module", "generator", "at", "from", "to", "wall_ns")
    if recording.clock == "free":
        for logged, moved in _commits(recording):
            if moved.generator is not None:
                _, before, after, _ = moved.motion[0]
                key = moved.level, moved.generator, _encode(moved.at), moved.keeper, moved.serial
                ends = moved.at, before, after
                rows.add(key, moved.level, moved.module, moved.generator, *ends, logged.wall_ns)
        return rows.columns()
    for logged in messages_of(recording, "report"):
        report: Report = logged.message
        if report.move is not None:
            number, module, move = report.round, report.module, report.move
            ends = move.at, report.before, report.site
            rows.add((number, module), number, module, move.generator, *ends, logged.wall_ns)
    return rows.columns()


def _commits(recording: Recording) -> Iterator[tuple[LoggedMessage, Commit]]:
    """Yield the commits of a run without rounds; some stand in several messages."""
    for logged in messages_of(recording, ("commit", "commits")):
        message: Commit | CommitLog = logged.message
        for moved in message.parts if isinstance(message, CommitLog) else (message,):
            yield logged, moved


def claims_of(recording: Recording) -> Columns:
    """Return the claims of a run, or its attempts; `Recording.claims` documents it."""
    return _attempts(recording) if recording.clock == "free" else _claims(recording)


def _claims(recording: Recording) -> Columns:
    rows = _Rows("round", "module", "site", "generator", "at", "wall_ns")
    outcomes: dict[tuple[int, int], str] = {}
    for logged in messages_of(recording, ("claim", "verdict", "report")):
        message: Claim | Verdict | Report = logged.message
        key = message.round, message.module
        if isinstance(message, Claim):
            rows.add(key, *key, message.site, message.generator, message.at, logged.wall_ns)
        elif isinstance(message, Verdict):
            outcomes[key] = "granted" if message.granted else "lost"
        elif message.claim != "none":
            outcomes[key] = message.claim
    return _with_outcomes(rows.columns(), outcomes, ("round", "module"))


def _attempts(recording: Recording) -> Columns:
    by = "module", "epoch", "number"
    rows = _Rows("round", *by, "site", "generator", "at", "wall_ns")
    outcomes: dict[tuple[int, int, int], str] = {}
    for logged in messages_of(recording, ("attempt", "forwarded", "decision", "commit", "commits")):
        for entry in _log_entries(logged.message):
            key = entry.module, entry.epoch, entry.number
            if isinstance(entry, Commit):
                outcomes[key] = "granted"
            elif isinstance(entry, Decision):
                outcomes.setdefault(key, "lost")
            elif entry.generator is not None:
                found = entry.site, entry.generator, entry.at
                rows.add(key, logged.round, *key, *found, logged.wall_ns)
    return _with_outcomes(rows.columns(), outcomes, by)


def _log_entries(message: Any) -> Iterable[Attempt | Decision | Commit]:
    """Return what a message tells of attempts: that one was made, refused or committed."""
    if isinstance(message, CommitLog):
        return message.parts
    if isinstance(message, Decision) and message.commit is not None:
        return (message.commit,)
    if isinstance(message, Attempt | Decision | Commit):
        return (message,)
    return (message.attempt,)


def _with_outcomes(columns: Columns, outcomes: Mapping[Any, str], by: tuple[str, ...]) -> Columns:
    keys = zip(*(columns[name].tolist() for name in by), strict=True)
    wall_ns = columns.pop("wall_ns")
    columns["outcome"] = _column("outcome", tuple(outcomes.get(key, "") for key in keys))
    return columns | {"wall_ns": wall_ns}


def _messages(recording: Recording) -> Columns:
    topics: dict[str, tuple[str, str]] = {}
    rows = []
    for record in recording.written():
        named = topics.get(record.topic)
        if named is None:
            kind, _, sender = record.topic.partition("/")
            named = (record.topic, "") if recording.of_keys else (kind, sender)
            topics[record.topic] = named
        rows.append((record.round, record.wall_ns, record.sequence, *named, len(record.data)))
    names = ("round", "wall_ns", "sequence", "kind", "sender", "bytes")
    values = zip(*rows, strict=True) if rows else ((),) * len(names)
    return {name: _column(name, column) for name, column in zip(names, values, strict=True)}


def frame_of(recording: Recording, table: str) -> pd.DataFrame:
    """Return a table as a data frame; `Recording.frame` documents it."""
    if table not in _TABLES:
        near = did_you_mean(table, _TABLES)
        raise InputError(f"unknown table {table!r}{near}, expected one of {', '.join(_TABLES)}")
    try:
        import pandas as pd  # noqa: PLC0415 - an extra
    except ImportError:
        raise InputError(
            "data frames take the library pandas: pip install 'cubepath[experiments]'"
        ) from None
    made = {"moves": moves_of, "claims": claims_of, "messages": _messages}[table]
    return pd.DataFrame(made(recording))
