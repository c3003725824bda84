"""The folder of a sweep: Parquet files, each written whole as runs finish.

The folder has a dataset of runs and one of rounds, in parts. A part of rounds counts only if there
is a part of runs with the same name, which is written after it. So the sweep may be cut off at any
moment, and what is on disk is correct. Parts are written under another name first.
"""

import contextlib
import errno
import json
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from hashlib import sha256
from importlib import import_module
from math import inf
from pathlib import Path
from typing import IO, Any, Self

import msgspec
import numpy as np

from cubepath.coordinator.experiments.published import ReportNotes
from cubepath.coordinator.experiments.rows import (
    AGAIN,
    FAILURES,
    ROUND_COLUMNS,
    ROUND_MEASURES,
    RUN_COLUMNS,
    TIMEOUT,
    FinishedRun,
    Row,
    in_canonical_order,
)
from cubepath.coordinator.experiments.setting import OF_SCENES, RunBatch
from cubepath.protocol.core import output_files
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import file_within

MARK = "sweep.json"
_FORMAT = "cubepath-sweep-1"
_LOCK = ".lock"
_RUNS_MAX, _SECONDS_MAX = 256, 2.0
"""After this many runs, or this time, a part is written."""


def arrow() -> Any:
    """Return pyarrow with its Parquet; InputError says how to install it."""
    try:
        import_module("pyarrow.parquet")
        return import_module("pyarrow")
    except ImportError:
        raise InputError(
            "results of sweeps need pyarrow, expected it installed"
            " (pip install 'cubepath[experiments]')"
        ) from None


def table_of(rows: Sequence[Row], columns: Mapping[str, str]) -> Any:
    """Return rows as a pyarrow table with these columns."""
    pa = arrow()
    types = {"bool": pa.bool_(), "string": pa.string(), "int64": pa.int64()}
    schema = pa.schema([(name, types.get(kind) or pa.float64()) for name, kind in columns.items()])
    values = {name: [row[name] for row in rows] for name in columns}
    return pa.table(values, schema=schema)


def _rounds_table(runs: Sequence[FinishedRun]) -> Any:
    """Return the rounds of runs as a pyarrow table, made from their arrays."""
    pa = arrow()
    counts = [each.run["rounds"] or 0 for each in runs]
    ids = pa.array([each.run["id"] for each in runs], pa.string())
    columns = {
        "id": ids.take(pa.array(np.repeat(np.arange(len(runs)), counts))),
        "round": np.concatenate([np.arange(1, count + 1) for count in counts]),
    }
    for name in ROUND_MEASURES:
        parts = [
            pa.nulls(count, pa.int64()) if each.rounds[name] is None else each.rounds[name]
            for each, count in zip(runs, counts, strict=True)
        ]
        columns[name] = pa.concat_arrays([pa.array(part, pa.int64()) for part in parts])
    return pa.table(columns)


class SweepFolder:
    """A folder that is open for writing, by one sweep at a time."""

    def __init__(self, folder: Path) -> None:
        """Name the folder; nothing is done before it is entered."""
        self.folder = folder
        self._lock: IO[bytes] | None = None
        self._locked_first = False
        self._waiting: list[FinishedRun] = []
        self._written_s = 0.0

    def __enter__(self) -> Self:
        """Make the folder, or take up an earlier sweep; InputError if neither can be."""
        arrow()
        output_files.check_output_folder(self.folder)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._lock_it()
            self._check()
            for name in ("runs", "rounds"):
                file_within(self.folder, name).mkdir(exist_ok=True)
                for part in (self.folder / name).glob(".*.part"):  # of a sweep that was killed
                    part.unlink()
        except BlockingIOError:
            self._release()
            raise InputError(
                f"{self.folder}: another sweep is writing there, expected it to end first"
            ) from None
        except OSError as error:
            self._release()
            raise output_files.unwritable(self.folder, error) from None
        except InputError:
            if self._locked_first:  # it is somebody else's, and is left as it was
                (self.folder / _LOCK).unlink(missing_ok=True)
            self._release()
            raise
        self._written_s = time.monotonic()
        return self

    def _lock_it(self) -> None:
        """Lock the folder, or raise BlockingIOError: it is looked into by one sweep at a time."""
        self._locked_first = not (self.folder / _LOCK).exists()
        self._lock = output_files.locked_file(self.folder / _LOCK)

    def _check(self) -> None:
        """Raise InputError if the folder is that of something else; mark a new one."""
        mark = self.folder / MARK
        if mark.exists():
            read_mark(self.folder)
            return
        held = sorted(each.name for each in self.folder.iterdir() if each.name != _LOCK)
        if held:
            raise InputError(
                f"{self.folder}: holds {held[0]!r} and no {MARK}, expected a new or empty folder,"
                " or that of a sweep"
            )
        self._mark([], ReportNotes())

    def _mark(self, versions: Sequence[str], notes: ReportNotes) -> None:
        document = {"format": _FORMAT, "versions": list(versions), "notes": notes}
        with output_files.written_whole(self.folder / MARK) as stream:
            stream.write(msgspec.json.format(msgspec.json.encode(document), indent=1))

    def begin(
        self,
        batches: Iterable[RunBatch],
        timeout_s: float | None = None,
        notes: ReportNotes | None = None,
    ) -> dict[str, str | None]:
        """Note that these are played now; return the recordings of finished runs by their ids.

        The `notes` are for reports; without any, those of the sweep before are kept.

        "" is that of a run that failed and has none, None that of one that may have one yet.
        One that died or was prevented is none of them: it may have been the machine. Nor is one
        that was over its limit of time, if the limit is longer now, or there is none.
        """
        now = dict.fromkeys(_version(batch) for batch in batches)
        before, noted = read_mark(self.folder)
        self._mark([*(each for each in before if each not in now), *now], notes or noted)
        known: dict[str, str | None] = {}
        for part in self._whole_parts():
            for row in _read(part, ("id", "ended", "recording", "seconds")):
                late = row["ended"] == TIMEOUT and row["seconds"] >= (timeout_s or inf)
                if late or row["ended"] not in AGAIN:
                    none = "" if row["ended"] in FAILURES else None
                    known[row["id"]] = row["recording"] or known.get(row["id"]) or none
        return known

    def _whole_parts(self) -> list[Path]:
        """Return the parts of runs that can be read, as those of their rounds.

        Others are put aside, and what was in them is played again, as if it had been cut off.
        """
        found = []
        for part in parts_of(self.folder):
            both = part, self.folder / "rounds" / part.name
            if all(map(_is_whole, both)):
                found.append(part)
                continue
            for path in both:  # nobody who reads the dataset looks at hidden files
                with contextlib.suppress(FileNotFoundError):
                    path.rename(path.with_name(f".{path.name}.damaged"))
        return found

    def replace(self, rows: Sequence[Row]) -> None:
        """Keep these rows of runs for those that are there; their rounds stay as they are."""
        if rows:
            self.write()
            content = "".join(f"{row['id']} {row['configuration']}" for row in rows)
            name = f"{sha256(content.encode()).hexdigest()[:16]}-again"
            self._write("rounds", name, table_of([], ROUND_COLUMNS))
            self._write("runs", name, table_of(rows, RUN_COLUMNS))

    def add(self, rows: Iterable[FinishedRun]) -> None:
        """Keep the rows of finished runs, and write a part if one is due."""
        self._waiting += rows
        late = time.monotonic() - self._written_s > _SECONDS_MAX
        if len(self._waiting) >= _RUNS_MAX or (self._waiting and late):
            self.write()

    def write(self) -> None:
        """Write what is not yet written."""
        if not self._waiting:
            return
        runs = [each.run for each in self._waiting]
        name = sha256("".join(row["id"] for row in runs).encode()).hexdigest()[:16]
        self._write("rounds", name, _rounds_table(self._waiting))
        self._write("runs", name, table_of(runs, RUN_COLUMNS))
        self._waiting.clear()
        self._written_s = time.monotonic()

    def _write(self, what: str, name: str, table: Any) -> None:
        path = file_within(self.folder, f"{what}/{name}.parquet")
        with output_files.written_whole(path) as stream:
            arrow().parquet.write_table(table, stream)
            stream.flush()
            os.fsync(stream.fileno())

    def __exit__(self, *_: object) -> None:
        """Write the rest, and let others in."""
        try:
            self.write()
        finally:
            self._release()

    def _release(self) -> None:
        if self._lock is not None:
            self._lock.close()
            self._lock = None


def read_mark(folder: Path) -> tuple[list[str], ReportNotes]:
    """Return the versions whose runs a folder has, the last one last, and what a report notes.

    A version is that of the code, with what the scene and the rule were then. InputError if it is
    no sweep.
    """
    mark = file_within(folder, MARK)
    try:
        document = json.loads(mark.read_bytes())
        if document["format"] == _FORMAT:
            return document["versions"], msgspec.convert(document.get("notes", {}), ReportNotes)
    except FileNotFoundError:
        raise InputError(f"{folder}: has no {MARK}, expected the folder of a sweep") from None
    except OSError as error:
        raise InputError(f"{mark}: cannot be read: {error.strerror or error}") from None
    except (ValueError, KeyError, TypeError):
        pass
    raise InputError(f"{mark}: expected that of a sweep, of the format {_FORMAT}")


def _version(batch: RunBatch) -> str:
    return f"{batch.code} {batch.setting.scene} {batch.setting.source}"


def parts_of(folder: Path) -> list[Path]:
    """Return the parts of the dataset of runs, in the order of their names.

    InputError if one, or that of its rounds, is not in the folder: a link leads out of it.
    """
    found = sorted(file_within(folder, "runs").glob("[!.]*.parquet"))
    for part in found:
        for what in ("runs", "rounds"):
            file_within(folder, f"{what}/{part.name}")
    return found


def read_runs(folder: Path, *, all_versions: bool = False) -> list[Row]:
    """Return the rows of all runs of a folder in canonical order.

    Of runs that were played with several versions of the code, the scene or the rule, those of the
    last one are returned, or with `all_versions` all. Of several rows of a run it is one that was
    played, then one with a recording, then that for which most was searched. InputError if the
    folder is no sweep's, or is damaged.
    """
    places = {version: place for place, version in enumerate(read_mark(folder)[0])}
    found: dict[str, tuple[tuple[object, ...], Row]] = {}
    for part in parts_of(folder):
        for row in _read(part, RUN_COLUMNS):
            try:
                configuration = json.loads(row["configuration"])
                version = (
                    f"{row['code']} {configuration.pop('scene')} {configuration.pop('source')}"
                )
                searched = [configuration.pop(name) for name in OF_SCENES][:2]
            except (ValueError, KeyError, TypeError, AttributeError):
                raise InputError(
                    f"{part}: run {row['id']}: expected the configuration of a run, found"
                    f" {row['configuration']!r}"
                ) from None
            key = row["id"] if all_versions else json.dumps(configuration, sort_keys=True)
            rank = (
                places.get(version, -1),
                row["ended"] not in AGAIN,
                row["recording"] is not None,
                *searched,
                row["id"],
            )
            if key not in found or found[key][0] <= rank:
                found[key] = rank, row
    return in_canonical_order(row for _, row in found.values())


def read_rounds(folder: Path, ids: Iterable[str] | None = None) -> list[Row]:
    """Return the rows of rounds, those of these runs or all, ordered by run and round."""
    wanted = None if ids is None else set(ids)
    rows: dict[tuple[str, int], Row] = {}
    for part in parts_of(folder):
        for row in _read(folder / "rounds" / part.name, ROUND_COLUMNS):
            if wanted is None or row["id"] in wanted:
                rows[row["id"], row["round"]] = row
    return [rows[key] for key in sorted(rows)]


def _is_whole(path: Path) -> bool:
    """Return whether a part is there, and undamaged; InputError if it cannot be looked at."""
    pa = arrow()
    try:
        pa.parquet.read_table(path)
    except (OSError, pa.ArrowException) as error:
        if not _is_damage(error):
            raise unreadable(path, error) from None
        return False
    return True


def _is_damage(error: Exception) -> bool:
    """Return whether a file is missing or holds something else, and is not kept from us."""
    return getattr(error, "errno", None) in (None, errno.ENOENT)


def unreadable(path: Path, error: Exception) -> InputError:
    """Return the error for a part that cannot be read, which says how it is mended."""
    why = "no such file" if isinstance(error, FileNotFoundError) else str(error)
    more = "; the same sweep once more plays its runs again" if _is_damage(error) else ""
    return InputError(f"{path}: cannot be read: {' '.join(why.split())}{more}")


def _read(path: Path, columns: Iterable[str]) -> list[Row]:
    pa = arrow()
    try:
        found: list[Row] = pa.parquet.read_table(path, columns=list(columns)).to_pylist()
    except (OSError, pa.ArrowException) as error:
        raise unreadable(path, error) from None
    return found
