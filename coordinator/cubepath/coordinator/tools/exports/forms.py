"""Tables written as CSV, Parquet, JSON and JSON Lines.

Sites are JSON in CSV and Parquet, `[0,1]`, and lists in JSON.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Mapping
from typing import IO, Any

import msgspec

from cubepath.coordinator.tools.exports.rows import DOCUMENTS, SITES, TEXTS, Table
from cubepath.protocol.core.errors import InputError

Write = Callable[[IO[bytes], Table, Mapping[str, str]], int]
"""Writes a table with the parameters of its recording, as far as the form has room for them;
returns the number of rows."""


def write_csv(stream: IO[bytes], table: Table, _parameters: Mapping[str, str]) -> int:
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


def write_parquet(stream: IO[bytes], table: Table, parameters: Mapping[str, str]) -> int:
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


def write_json(stream: IO[bytes], table: Table, _parameters: Mapping[str, str]) -> int:
    """Write a table as one JSON list of objects, a line each."""
    count = 0
    for line in _lines(table):
        stream.write(b",\n" if count else b"[")
        stream.write(line)
        count += 1
    stream.write(b"]\n" if count else b"[]\n")
    return count


def write_jsonl(stream: IO[bytes], table: Table, _parameters: Mapping[str, str]) -> int:
    """Write a table as JSON Lines: an object a line."""
    count = 0
    for line in _lines(table):
        stream.write(line)
        stream.write(b"\n")
        count += 1
    return count


def _lines(table: Table) -> Iterator[bytes]:
    encode, decode = msgspec.json.Encoder().encode, msgspec.json.decode
    names = table.columns
    nested = [number for number, name in enumerate(names) if name in (*SITES, *DOCUMENTS)]
    for rows in table.batches:
        for row in rows:
            values = list(row)
            for number in nested:
                try:
                    values[number] = decode(values[number])
                except msgspec.DecodeError as error:
                    where = f"message {row[names.index('sequence')]}"
                    raise InputError(f"{where}: {error}") from None
            yield encode(dict(zip(names, values, strict=True)))


WRITERS: Mapping[str, Write] = {
    "csv": write_csv,
    "parquet": write_parquet,
    "json": write_json,
    "jsonl": write_jsonl,
}
"""The forms of tables by name, which are their suffixes too."""
