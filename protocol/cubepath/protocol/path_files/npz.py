"""The binary form of moves and cubes: a table of actions and numbers into it, as one .npz file.

docs/files.md describes each array. Nothing in such a file is code: it is read without pickles, and
its content is checked before it is used.

It touches only the files it is given, and knows nothing of shortening.
"""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import InputFile, Source, opened
from cubepath.protocol.core.names import GeneratorPlacement, Json
from cubepath.protocol.core.output_files import written_whole
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.path_files.action_tables import Listed, actions_of, table_of
from cubepath.protocol.path_files.moves import CubeName, MoveName, named_action
from cubepath.protocol.path_files.numbered import NumberedPath
from cubepath.protocol.path_files.supports import TabledActions

_MAGIC = b"PK\x03\x04"
_MOVES = "cubepath-moves-1"
_CUBES = "cubepath-cubes-1"
_T = TypeVar("_T")
_encode = msgspec.json.Encoder().encode
_names = msgspec.json.Decoder(list[str | int | GeneratorPlacement]).decode
_values = msgspec.json.Decoder(list[Json]).decode
Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class NumberedCubes:
    """A cube path in numbers: the moves of a path that remain, cube by cube.

    `starts` has shape (cubes + 1,) and `moves` (reduced moves,), both int64: cube i has the moves
    ``moves[starts[i]:starts[i + 1]]``, as places in the path from 0.
    """

    starts: NDArray[np.int64]
    moves: NDArray[np.int64]


def write_moves_npz(target: Path, path: NumberedPath) -> None:
    """Write a path; the file is complete or unchanged. InputError if it cannot be written."""
    _write(target, _path_arrays(_MOVES, path))


def write_cubes_npz(target: Path, path: NumberedPath, cubes: NumberedCubes) -> None:
    """Write the cubes of a path, with the moves that remain; as `write_moves_npz`."""
    left = NumberedPath(
        path.actions,
        path.action_names,
        path.stated,
        path.numbers[cubes.moves],
        # In a cube a move is not always made from the same local state as in the path.
        np.full(len(cubes.moves), -1, dtype=np.int8),
        None if path.names is None else [path.names[move] for move in cubes.moves.tolist()],
        path.supports,
    )
    places = {"cube_starts": cubes.starts, "places": cubes.moves}
    _write(target, {**_path_arrays(_CUBES, left), **places})


def is_npz(file: InputFile) -> bool:
    """Return whether a file begins like an .npz file."""
    return file.head(len(_MAGIC)) == _MAGIC


def read_moves_npz(source: Source) -> NumberedPath:
    """Return the path in a file; whether its moves are admissible is not checked.

    Raises InputError, as ``FILE: ARRAY: what was found, what was expected``, if the file is damaged
    or its arrays do not fit together.
    """
    with opened(source) as file:
        arrays = _read(file, _MOVES)
    return _refusing(file, lambda: _path(arrays))


def read_cubes_npz(source: Source) -> tuple[tuple[CubeName, ...], ...]:
    """Return the cubes in a file as the names of their moves; errors as in `read_moves_npz`."""
    with opened(source) as file:
        arrays = _read(file, _CUBES)

    def cubes() -> tuple[tuple[CubeName, ...], ...]:
        path = _path(arrays)
        starts = _starts(arrays, "cube_starts", len(path.numbers), least=1).tolist()
        count = len(path.numbers)
        places = _integers(arrays, "places", 0, 1 << 62, size=count).astype(np.int64)
        names = path.cube_names(np.arange(count), places)
        return tuple(tuple(names[begin:end]) for begin, end in pairwise(starts))

    return _refusing(file, cubes)


def holds_cubes(source: Source) -> bool:
    """Return whether a file has cubes rather than moves; InputError if it does not say."""
    with opened(source) as file:
        return _format(file, _load(file, ["format"])) == _CUBES


def _path_arrays(form: str, path: NumberedPath) -> dict[str, NDArray[Any]]:
    table = table_of(path.supports, path.action_names)
    arrays: dict[str, NDArray[Any]] = {
        "format": np.array(form),
        "sites": _json(table.sites),
        "names": _json(path.action_names),
    }
    for part, (starts, sites) in table.parts.items():
        if part in {"free", "guard"} and not len(sites):
            continue
        arrays[f"{part}_starts"], arrays[f"{part}_sites"] = starts, sites
    if not all(path.stated):
        arrays["stated"] = np.array(path.stated, dtype=np.bool_)
    arrays["moves"] = path.numbers
    if (path.ends >= 0).any():
        arrays["ends"] = path.ends
    if path.names is not None and any(
        name != path.action_names[number]
        for name, number in zip(path.names, path.numbers.tolist(), strict=True)
    ):
        arrays["move_names"] = _json(path.names)
    return arrays


def _json(value: object) -> NDArray[np.uint8]:
    return np.frombuffer(_encode(value), dtype=np.uint8)


def _write(target: Path, arrays: Arrays) -> None:
    with written_whole(target) as stream:
        np.savez(stream, allow_pickle=False, **arrays)


def _load(file: InputFile, only: Collection[str] | None = None) -> Arrays:
    """Return the arrays of a file, or only those with these names, if present."""
    try:
        with np.load(file.from_start(), allow_pickle=False) as found:
            return {name: found[name] for name in found.files if only is None or name in only}
    except OSError as error:
        raise InputError(f"{file.path}: {error.strerror or error}") from None
    except (ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error, struct.error) as error:
        raise InputError(f"{file.path}: damaged, or no .npz file: {error}") from None


def _read(file: InputFile, form: str) -> Arrays:
    arrays = _load(file)
    found = _format(file, arrays)
    if found != form:
        raise InputError(f"{file.path}: format: found {found!r}, expected {form!r}")
    return arrays


def _format(file: InputFile, arrays: Arrays) -> str:
    found = arrays.get("format")
    if found is None or found.ndim or found.dtype.kind != "U":
        raise InputError(f"{file.path}: no array 'format' with a text, expected a file of cubepath")
    return str(found)


def _refusing(file: InputFile, make: Callable[[], _T]) -> _T:
    try:
        return make()
    except InputError as error:
        raise InputError(f"{file.path}: {error}") from None


def _path(arrays: Arrays) -> NumberedPath:
    sites = [site_from_json(value) for value in _decoded(arrays, "sites", _values)]
    if len(set(sites)) != len(sites):
        raise InputError("sites: a site is there twice, expected each once")
    names = _decoded(arrays, "names", _names)
    count = len(names)
    stated = _flags(arrays, count)
    lists = {
        part: _lists(arrays, part, len(sites), count, optional=part in {"free", "guard"})
        for part in ("support", "trace", "before", "after", "free", "guard")
    }
    bare = not any(len(lists[part][1]) for part in ("free", "guard"))
    tabled = actions_of(sites, lists, names, stated) if bare else None
    actions, turned = _one_by_one(sites, lists, names, stated) if tabled is None else tabled
    numbers = _integers(arrays, "moves", 0, count)
    ends = np.full(len(numbers), -1, dtype=np.int8)
    if "ends" in arrays:
        ends = _integers(arrays, "ends", -1, 2, size=len(numbers)).astype(np.int8)
        # The file counts from `before`; an action has its local states in an order of its own.
        ends = np.where(ends >= 0, ends ^ turned[numbers], ends)
    given = None
    if "move_names" in arrays:
        given = _decoded(arrays, "move_names", _names)
        if len(given) != len(numbers):
            raise InputError(f"move_names: found {len(given)}, expected {len(numbers)}")
    table = actions.supports if isinstance(actions, TabledActions) else None
    return NumberedPath(actions, names, stated, numbers.astype(np.int32), ends, given, table)


def _one_by_one(
    sites: Sequence[Site],
    lists: Mapping[str, Listed],
    names: Sequence[MoveName],
    stated: Sequence[bool],
) -> tuple[Sequence[Action], NDArray[np.bool_]]:
    """Return the actions, and for each whether its `before` is its second local state."""
    rows = {part: _rows(sites, found) for part, found in lists.items()}
    actions = [
        _action(number, name, stated[number], {part: rows[part][number] for part in rows})
        for number, name in enumerate(names)
    ]
    if len(set(actions)) != len(actions):
        raise InputError("actions: two are equal, expected each once")
    turned = [
        told and action.ends[0] != frozenset(before)
        for action, told, before in zip(actions, stated, rows["before"], strict=True)
    ]
    return actions, np.array(turned, dtype=np.bool_)


def _action(number: int, name: MoveName, stated: bool, parts: dict[str, list[Site]]) -> Action:  # noqa: FBT001 - a flag of the file
    guards = parts["guard"]
    wrong = ""
    if not parts["trace"]:
        wrong = "the trace is empty, a move changes something"
    elif len(guards) % 2:
        wrong = f"guards of {len(guards)} sites, expected pairs"
    elif not stated and isinstance(name, GeneratorPlacement):
        wrong = "a generator and no local states, expected an id"
    if wrong:
        raise InputError(f"action {number}: {wrong}")
    try:
        if not stated and not isinstance(name, GeneratorPlacement):
            return named_action(name, parts["support"], parts["trace"])
        return Action(
            parts["support"],
            parts["trace"],
            parts["before"],
            parts["after"],
            free=parts["free"],
            guards=zip(guards[::2], guards[1::2], strict=True),
            label=_encode(name).decode(),
        )
    except InputError as error:
        raise InputError(f"action {number}: {error}") from None


def _flags(arrays: Arrays, count: int) -> list[bool]:
    if "stated" not in arrays:
        return [True] * count
    found = arrays["stated"]
    if found.shape != (count,) or found.dtype != np.bool_:
        raise InputError(f"stated: found {_kind(found)}, expected {count} booleans")
    return [bool(each) for each in found]


def _lists(arrays: Arrays, part: str, sites: int, count: int, *, optional: bool) -> Listed:
    if optional and f"{part}_starts" not in arrays:
        return np.zeros(count + 1, dtype=np.int64), np.zeros(0, dtype=np.int64)
    numbers = _integers(arrays, f"{part}_sites", 0, sites)
    return _starts(arrays, f"{part}_starts", len(numbers), size=count + 1), numbers


def _rows(sites: Sequence[Site], lists: Listed) -> list[list[Site]]:
    starts, numbers = lists
    found = [sites[number] for number in numbers.tolist()]
    return [found[begin:end] for begin, end in pairwise(starts.tolist())]


def _starts(
    arrays: Arrays, name: str, total: int, *, size: int | None = None, least: int = 0
) -> NDArray[np.int64]:
    found = _integers(arrays, name, 0, total + 1, size=size)
    if not len(found) or found[0] != 0 or found[-1] != total or (np.diff(found) < least).any():
        raise InputError(f"{name}: expected numbers that rise from 0 to {total}")
    return found


def _integers(
    arrays: Arrays, name: str, low: int, stop: int, *, size: int | None = None
) -> NDArray[np.int64]:
    found = arrays.get(name)
    if found is None:
        raise InputError(f"no array {name!r}, expected one of integers")
    if found.ndim != 1 or found.dtype.kind not in "iu" or size not in {None, len(found)}:
        expected = "integers" if size is None else f"{size} integers"
        raise InputError(f"{name}: found {_kind(found)}, expected {expected}")
    wrong = np.flatnonzero((found < low) | (found >= stop))
    if len(wrong):
        where = int(wrong[0])
        raise InputError(f"{name}[{where}]: found {found[where]}, expected {low} to {stop - 1}")
    return found.astype(np.int64)


def _kind(found: NDArray[Any]) -> str:
    return f"an array of shape {found.shape} and type {found.dtype}"


def _decoded(arrays: Arrays, name: str, decode: Callable[[bytes], list[_T]]) -> list[_T]:
    found = arrays.get(name)
    if found is None or found.ndim != 1 or found.dtype != np.uint8:
        what = "no such array" if found is None else _kind(found)
        raise InputError(f"{name}: {what}, expected JSON text as bytes (uint8)")
    try:
        return decode(found.tobytes())
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{name}: {error}, expected a JSON list") from None
